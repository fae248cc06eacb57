"""Our builds of pictures of the paper's kind beside the IoU of its own published ones.

`python -m examples.paper.kind [NAME ...]` builds each with default settings, every constraint on, and prints
the IoU of the written part's shadow. The paper's are measured from its figures (half of them without its
constraints) on its own pictures; ours are drawn to be of the same kind, not the same.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from examples.paper.pictures import PUBLISHED, paper_pictures
from examples.studies.accuracy_table import measure

__all__ = ["main"]


def main() -> int:
    """Print the table; 0 where every picture is above the paper's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    folder = asked.out or Path(tempfile.mkdtemp(prefix="knotfab-paper-"))
    folder.mkdir(parents=True, exist_ok=True)
    below = 0
    print("picture        paper   ours  failed checks  seconds")
    for name, image in paper_pictures().items():
        if asked.names and name not in asked.names:
            continue
        path = folder / f"{name.replace(' ', '-')}.png"
        image.save(path)
        got = measure(path, folder / path.stem, "--skip", "slicer")
        if got["report"] is None:
            print(f"{name:<14} {PUBLISHED[name]:.3f}  {got['error']}", flush=True)
            below += 1
            continue
        iou = got["report"]["views"][0]["iou"]
        failed = [c["name"] for c in got["report"]["checks"] if c["status"] == "fail"]
        below += iou <= PUBLISHED[name] or bool(failed)
        print(
            f"{name:<14} {PUBLISHED[name]:.3f}  {iou:.4f}  {len(failed):>13}  {got['seconds']:7.1f}",
            *failed,
            flush=True,
        )
    return int(below > 0)


if __name__ == "__main__":
    sys.exit(main())
