"""Our builds of pictures of the paper's kind beside the IoU of its own published ones.

`python -m paper.kind [NAME ...]` builds each with default settings, every constraint on, and prints
the IoU of the written part's shadow. The paper's are measured from its figures (half of them without its
constraints) on its own pictures; ours are drawn to be of the same kind, not the same.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.measurement import build_apart, failed_checks, make_folder, run_study, save_pictures
from paper.pictures import PUBLISHED, paper_pictures


def main(*names: str, out: Path | None = None) -> int:
    """Print the table; 0 where every picture is above the paper's."""
    folder = make_folder(out, "paper")
    below = 0
    print("picture        paper   ours  failed checks  seconds")
    for name, path in save_pictures(paper_pictures(), folder, names).items():
        built = build_apart(path, folder / path.stem, "--skip", "slicer")
        if built.report is None:
            print(f"{name:<14} {PUBLISHED[name]:.3f}  {built.said}", flush=True)
            below += 1
            continue
        iou = built.report["views"][0]["iou"]
        failed = failed_checks(built.report)
        below += iou <= PUBLISHED[name] or bool(failed)
        print(
            f"{name:<14} {PUBLISHED[name]:.3f}  {iou:.4f}  {len(failed):>13}  {built.wall_s:7.1f}",
            *failed,
            flush=True,
        )
    return int(below > 0)


if __name__ == "__main__":
    run_study(main)
