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
import torch
from knotfab.search.steps import walked
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from examples.measurement import paint_comparison, read_problem
from examples.side_view import beside, side_view
from knotfab.effects.base import Situation
from knotfab.effects.survey import survey
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings
from knotfab.problem import Account, Problem
from knotfab.render.frame import Frame
from knotfab.render.picture import frame_mm, picture_at
from knotfab.render.threads import one_thread
from knotfab.render.tiled import render_tiled
from knotfab.scene.settings import PRESETS
from knotfab.search.objective import Objective
from knotfab.search.phases import objective_of, three_phases
from knotfab.sequence.gif import write_gif
from knotfab.start.filling import fill
from knotfab.start.lift import lifted

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
    limits, account = problem.limits(radius), Account()
    points, rings, _ = lifted(problem, fill(problem.polygon, radius), limits, _SETTINGS, account)
    seen = [points]
    for phase in three_phases(_SETTINGS):
        pixel_mm = max(frame_mm(problem.view)) / phase.pixels
        effects = survey(
            Situation(problem.view, limits, points, rings, pixel_mm, _SETTINGS.tolerance_px)
        )
        objective = objective_of(
            problem.view, problem.mask, limits, rings, effects, phase, _SETTINGS, "cpu"
        )

        def watch(
            x: Tensor, near: Neighbours, progress: float, base: Objective = objective
        ) -> Tensor:
            if base.calls % every == 0:
                seen.append(x.detach().numpy().copy())
            return base(x, near, progress)

        points = walked(points, rings, watch, limits, phase.walk, account, "cpu", None)
    return [*seen, points], rings


def film(problem: Problem, radius: float, every: int = EVERY) -> list[Image.Image]:
    """The pictures of a search: to the left the shadow, to the right the tube turned by 60 degrees."""
    stages, rings = watched(problem, radius, every)
    frame, target, _ = picture_at(problem.view, problem.mask, PANEL, True, "cpu")
    reach = 1.05 * max(float(np.linalg.norm(p, axis=1).max()) for p in stages) + radius
    wanted = target.numpy() > 0.5
    found = []
    for points in stages:
        left = _shadow(points, rings, frame, radius, wanted)
        right = side_view(rings.split(points), radius, reach, left.height, TURN_DEG)
        found.append(beside(left, right))
    return found + found[-1:] * LAST


def _shadow(
    points: Array, rings: Rings, frame: Frame, radius: float, wanted: NDArray[np.bool_]
) -> Image.Image:
    """The tube's shadow: black where it is wanted, red where not, blue where it is missing."""
    p = torch.as_tensor(points, dtype=torch.float32)
    with torch.no_grad():
        cast = (
            render_tiled(p, p[torch.as_tensor(rings.next)], frame, radius, 10.0, 5.0).numpy() > 0.5
        )
    return Image.fromarray(paint_comparison(cast, wanted))


def main(source: str, path: Path) -> None:
    """Write the film of the search for one picture."""
    _, problem = read_problem(source)
    assert problem.view.frame_width_mm is not None
    pictures = film(problem, round(SHARE * problem.view.frame_width_mm, 3))
    write_gif(path, pictures, 80)
    print(f"{path}: {len(pictures)} pictures")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python examples/search_film.py PICTURE FILM.gif")
    main(sys.argv[1], Path(sys.argv[2]))
