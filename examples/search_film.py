"""The film of a search: the shadow, and the tube seen from the side, as the flow goes on.

`python examples/search_film.py PICTURE FILM.gif` takes anything that `knotfab build` takes, such as
`text:♞`. The knot is an unknot in every picture: each step between them is certified.
"""

from __future__ import annotations

import sys
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from examples.questions import cast_shadow
from examples.side_view import beside, side_view
from knotfab.design.question import ask
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings
from knotfab.problem import Problem
from knotfab.render.threads import one_thread
from knotfab.scene.model import Scene
from knotfab.scene.settings import PRESETS
from knotfab.search.flow import Between, flow
from knotfab.search.phases import three_phases
from knotfab.search.state import begin
from knotfab.sequence.gif import write_gif
from knotfab.start.start import make_start
from knotfab.target.read import read_target

__all__ = ["film", "watched"]

Array = NDArray[np.float64]

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


@one_thread()
def watched(problem: Problem, radius: float, every: int = EVERY) -> tuple[list[Array], Rings]:
    """The vertices [(N, 3) mm] of every so many iterations of the flow, from the template on."""
    state = begin(problem, make_start(problem, radius, _SETTINGS), radius, _SETTINGS)
    limits, seen = state.limits, list[Array]()
    for phase in three_phases(_SETTINGS):
        objective = state.objective(phase)
        update = state.between(objective, phase)

        def watch(
            x: Array, near: Neighbours, iteration: int, progress: float, update: Between = update
        ) -> None:
            if iteration % every == 0:
                seen.append(x)
            update(x, near, iteration, progress)

        state.points = flow(
            state.points,
            state.rings,
            objective,
            radius,
            phase.walk,
            separation=limits.separation,
            between=watch,
        ).points
    return [*seen, state.points], state.rings


def film(problem: Problem, radius: float, every: int = EVERY) -> list[Image.Image]:
    """The pictures of a search: to the left the shadow, to the right the tube turned by 60 degrees."""
    stages, rings = watched(problem, radius, every)
    image = problem.views[0].image_at(radius, PANEL)
    reach = 1.05 * max(float(np.linalg.norm(p, axis=1).max()) for p in stages) + radius
    found = []
    for points in stages:
        left = _shadow(*cast_shadow(points, rings, radius, image))
        right = side_view(rings.split(points), radius, reach, left.height, TURN_DEG)
        found.append(beside(left, right))
    return found + found[-1:] * LAST


def _shadow(cast: NDArray[np.bool_], wanted: NDArray[np.bool_]) -> Image.Image:
    """The tube's shadow: black where it is wanted, orange where not, blue where it is missing."""
    image = np.full((*wanted.shape, 3), 255, dtype=np.uint8)
    image[wanted & cast] = (30, 30, 34)
    image[cast & ~wanted] = (224, 122, 62)
    image[wanted & ~cast] = (120, 170, 214)
    return Image.fromarray(image)


def main(source: str, path: Path) -> None:
    """Write the film of the search for one picture."""
    question = ask(Scene(), [read_target(source)])
    radius = round(SHARE * question.views[0].frame_width_mm, 3)
    pictures = film(question.with_depth(radius).problem, radius)
    write_gif(path, pictures, 80)
    print(f"{path}: {len(pictures)} pictures")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python examples/search_film.py PICTURE FILM.gif")
    main(sys.argv[1], Path(sys.argv[2]))
