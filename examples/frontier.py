"""What accuracy costs in time: presets and points around them, on a few of the project's pictures.

`python -m examples.frontier [NAME ...]` prints, for each point, the mean IoU that the search reached and the
median seconds it took, side by side in one run.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from examples.pictures import pictures
from knotfab.design import problem_of, resolve_view
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Scene
from knotfab.search.search import Problem, search
from knotfab.search.settings import PRESETS, SearchSettings
from knotfab.target.read import read_target
from knotfab.template.filling import fill

__all__ = ["POINTS", "main"]

NAMES = ("knight", "smiley", "anchor", "ampersand", "cat", "wheel")
RADIUS = 0.0115  # of the frame's width


def _point(preset: str, **changes: float) -> SearchSettings:
    return PRESETS[preset].model_copy(update=changes)


POINTS = {
    "draft": PRESETS["draft"],
    "draft, half the iterations": PRESETS["draft"].scaled(0.5),
    "standard": PRESETS["standard"],
    "standard, 3/4 of the iterations": PRESETS["standard"].scaled(0.75),
    "standard, half the iterations": PRESETS["standard"].scaled(0.5),
    "standard, 256 px": _point("standard", fine_px=256),
    "standard, vertices 0.6 r apart": _point("standard", edge_radii=0.6),
    "standard, 512 px": _point("standard", fine_px=512),
    "fine": PRESETS["fine"],
}


def _problem(path: Path) -> Problem:
    target = read_target(path)
    scene = resolve(Scene(), [(target.width, target.height)])
    view = resolve_view(scene.views[0], target)
    return problem_of(scene.model_copy(update={"views": (view,)}), target)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES)
    asked = parser.parse_args()
    problems = []
    with tempfile.TemporaryDirectory() as folder:
        for name, image in pictures().items():
            if name in asked.names:
                path = Path(folder) / f"{name}.png"
                image.save(path)
                problem = _problem(path)
                width = problem.view.frame_width_mm
                assert width is not None
                radius = RADIUS * width
                problems.append((problem, radius, fill(problem.polygon, radius)))
    print(f"{'point':<32} IoU mean  least   seconds (median)  repairs")
    for label, settings in POINTS.items():
        ious, seconds, repairs = [], [], 0
        for problem, radius, template in problems:
            begun = time.perf_counter()
            result = search(problem, template, radius, settings)
            seconds.append(time.perf_counter() - begun)
            ious.append(result.iou_estimate)
            repairs += result.account.repairs
        print(
            f"{label:<32} {statistics.mean(ious):.4f}    {min(ious):.4f}  "
            f"{statistics.median(seconds):8.1f}  {repairs:16}",
            flush=True,
        )


if __name__ == "__main__":
    main()
