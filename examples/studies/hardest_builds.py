"""Whole builds of the hardest pictures: each must end with exit code 0, 1 or 2 and a clear sentence.

    python -m examples.studies.hardest_builds [--only WORD] [--out DIR] [--limit-s 900]

Each picture is built with `--print --accuracy draft` in a process of its own. A crash, a traceback, another
code or a build that is longer than the limit is a fault; any fault ends this with 1.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from examples.hard_cases.pictures import hard_pictures
from examples.measurement import build_apart, make_folder, save_pictures


def main(argv: list[str] | None = None) -> int:
    """Print one line a picture; 1 where any build ended as none may."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="pictures whose name holds this word")
    parser.add_argument("--out", type=Path, help="folder to keep the builds in")
    parser.add_argument("--limit-s", type=float, default=900.0)
    asked = parser.parse_args(argv)
    faults = 0
    print(f"{'picture':<14} {'code':>4} {'IoU':>7} {'CPU s':>7} {'wall s':>7}  said", flush=True)
    folder = make_folder(asked.out, "hardest")
    drawn = {case.name: case.image() for case in hard_pictures() if asked.only in case.name}
    for name, path in save_pictures(drawn, folder).items():
        options = ("--mount", "none", "--accuracy", "draft")
        built = build_apart(path, folder / name, *options, limit_s=asked.limit_s)
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
    sys.exit(main())
