"""Whole builds of the hardest pictures: each must end with exit code 0, 1 or 2 and a clear sentence.

    python -m benchmarks.hardest_builds [--only WORD] [--out DIR] [--limit-s 900]

Each picture is built with `--print --accuracy draft` in a process of its own. A crash, a traceback, another
code or a build that is longer than the limit is a fault; any fault ends this with 1.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.hard.pictures import hard_pictures
from benchmarks.measurement import build_apart, make_folder, run_study, save_pictures


def main(*, only: str = "", out: Path | None = None, limit_s: float = 900.0) -> int:
    """Print one line a picture; 1 where any build ended as none may."""
    faults = 0
    print(f"{'picture':<14} {'code':>4} {'IoU':>7} {'CPU s':>7} {'wall s':>7}  said", flush=True)
    folder = make_folder(out, "hardest")
    drawn = {case.name: case.image() for case in hard_pictures() if only in case.name}
    for name, path in save_pictures(drawn, folder).items():
        options = ("--mount", "none", "--accuracy", "draft")
        built = build_apart(path, folder / name, *options, limit_s=limit_s)
        faults += not built.clear
        views = built.report["views"] if built.report else []
        iou = f"{min(v['iou'] for v in views):.4f}" if views else ""
        last = " ".join(built.said.split())[:300]
        print(
            f"{name:<14} {built.code:>4} {iou:>7} {built.cpu_s:>7.1f} {built.wall_s:>7.1f}  {last}",
            flush=True,
        )
    print(f"{faults} builds ended as none may")
    return int(faults > 0)


if __name__ == "__main__":
    run_study(main)
