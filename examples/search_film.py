"""The film of a search: the shadow, and the tube seen from the side, as the flow goes on.

`python examples/search_film.py PICTURE FILM.gif` takes anything that `knotfab build` takes, such as
`text:♞`. The knot is an unknot in every picture: each step between them is certified.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from PIL import Image

from benchmarks.measurement import paint_comparison, read_question, run_study
from examples.side_view import beside, side_view, write_gif
from knotfab.base.arrays import Array
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.limits.terms import Felt, State
from knotfab.problem import Problem
from knotfab.render.image import image_at
from knotfab.search.flow import plan_of
from knotfab.search.objective import Term, Weights
from knotfab.search.search import search
from knotfab.start.start import make_start
from knotfab_formats.search import PRESETS

PANEL = 320  # px
EVERY = 5  # iterations between pictures
SHARE = 0.0125  # tube radius, of the frame's width
TURN_DEG = 60.0
LAST = 12  # times that the last picture is held
_SETTINGS = PRESETS["draft"].model_copy(
    update={
        "coarse_iterations": 70,
        "fine_iterations": 70,
        "settle_iterations": 40,
        "depth_candidates": 40,
        "tolerance_px": 0.25,
    }
)


class Watch(Term):
    """A term that adds nothing to the objective, and keeps the vertices of every so many calls."""

    def __init__(self, every: int) -> None:
        self.every, self.calls = every, 0
        self.seen: list[Array] = []

    def __call__(self, state: State, weights: Weights) -> Felt:
        if self.calls % self.every == 0:
            self.seen.append(state.points.copy())
        self.calls += 1
        return 0.0, np.zeros_like(state.points)


def watch_search(
    problem: Problem, radius: float, every: int = EVERY
) -> tuple[list[Array], Polylines]:
    """Return the vertices [(N, 3) mm] of every so many iterations of the flow, from the template on."""
    start, watch = make_start(problem, radius, _SETTINGS), Watch(every)
    # vertices stay the same from the first picture to the last, and nothing is repaired after it
    plan = replace(plan_of(_SETTINGS), keep_vertices=True, repairs=0, mendings=0)
    result = search(problem, start, radius, _SETTINGS, terms=(watch,), plan=plan)
    rings = polylines_of_sizes(tuple(len(c) for c in start.curves))
    return [np.concatenate(start.curves), *watch.seen, result.knots.points], rings


def film(problem: Problem, radius: float, every: int = EVERY) -> list[Image.Image]:
    """Return the pictures of a search: to the left the shadow, to the right the tube turned by 60 degrees."""
    stages, rings = watch_search(problem, radius, every)
    (view,) = problem.views
    image = image_at(view.view, view.mask, radius, PANEL)
    reach = 1.05 * max(float(np.linalg.norm(p, axis=1).max()) for p in stages) + radius
    wanted = image.target > 0.5
    found = []
    for points in stages:
        cast = image.seen(points, rings, radius)
        left = Image.fromarray(paint_comparison(cast, wanted))
        right = side_view(rings.split(points), radius, reach, left.height, TURN_DEG)
        found.append(beside(left, right))
    return found + found[-1:] * LAST


def main(source: str, path: Path, /) -> None:
    """Write the film of the search for one picture."""
    question = read_question(source)
    radius = round(SHARE * question.views[0].frame_width_mm, 3)
    pictures = film(question.with_depth(radius).problem, radius)
    write_gif(path, pictures, 80)
    print(f"{path}: {len(pictures)} pictures")


if __name__ == "__main__":
    run_study(main)
