"""Two and three pictures in one part: what each build reached, beside the bound of its hull.

`python -m examples.two_views --out DIR`: builds the pairs below from the project's own pictures,
by shadow and by eye, and prints a line a view. `--only NAME` builds one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from examples.pictures import pictures
from knotfab.build import Outcome, Request, build
from knotfab.hull.frames import spread_views
from knotfab.scene.model import Scene

__all__ = ["CASES", "build_case", "main"]

CASES: dict[str, tuple[str, ...]] = {
    "heart-teapot": ("heart", "teapot"),
    "cat-bird": ("cat", "bird"),
    "knight-face": ("knight", "face"),
    "heart-teapot-by-eye": ("heart", "teapot"),
    "heart-face-teapot": ("heart", "face", "teapot"),
}


def build_case(name: str, folder: Path) -> Outcome:
    """Draw the pictures of a case into `folder` and build them into `folder`/NAME."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = pictures()
    files = []
    for picture in CASES[name]:
        files.append(str(folder / f"{picture}.png"))
        drawn[picture].save(files[-1])
    scene = spread_views(Scene(), len(files))
    if name.endswith("by-eye"):
        views = tuple(v.model_copy(update={"kind": "eye"}) for v in scene.views)
        scene = scene.model_copy(update={"views": views})
    return build(Request(scene, files[0], folder / name, more=tuple(files[1:])))


def main(arguments: Sequence[str] | None = None) -> None:
    """Build, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", choices=CASES)
    given = parser.parse_args(arguments)
    for name in [given.only] if given.only else CASES:
        begun, spent = time.perf_counter(), time.process_time()
        outcome = build_case(name, given.out)
        for view, picture in zip(outcome.report["views"], CASES[name], strict=True):
            print(
                f"{name:20} {picture:8} {view['kind']:6} IoU {view['iou']:.4f}  "
                f"bound {view['bound']:.4f}  short of it {view['bound'] - view['iou']:.4f}"
            )
        radius = outcome.report["settings"]["tube_radius_mm"]
        print(
            f"{name:20} {outcome.report['status']}, tube radius {radius:.2f} mm, "
            f"{time.perf_counter() - begun:.0f} s ({time.process_time() - spent:.0f} CPU s)"
        )


if __name__ == "__main__":
    main()
