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
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from examples.side_view import side_view
from knotfab.design import problem_of, resolve_view
from knotfab.effects.base import Situation
from knotfab.effects.survey import survey
from knotfab.render.frame import Frame
from knotfab.render.tiled import render_tiled
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Scene
from knotfab.search.depth import choose_depth, lift
from knotfab.search.flow import FlowSettings, flow
from knotfab.search.legibility import stretched
from knotfab.search.neighbours import Neighbours
from knotfab.search.objective import Objective, Weights
from knotfab.search.picture import frame_mm, picture_at
from knotfab.search.polyline import Rings, rings_of_sizes
from knotfab.search.search import Problem
from knotfab.search.threads import one_thread
from knotfab.sequence.gif import write_gif
from knotfab.target.read import read_target
from knotfab.template.filling import even_samples, fill

__all__ = ["film", "watched"]

Array = NDArray[np.float64]

PANEL = 320  # px
EVERY = 5  # iterations between pictures
SHARE = 0.0125  # tube radius, of the frame's width
TURN_DEG = 60.0
LAST = 12  # times that the last picture is held
_PHASES = (
    (160, 70, Weights(), (1.5, 3.0), (0.15, 0.06)),
    (256, 70, Weights(clearance=3.0, bend=0.5), (3.0, 6.0), (0.06, 0.02)),
    (256, 40, Weights(clearance=20.0, bend=5.0, region=50.0), (6.0, 6.0), (0.03, 0.01)),
)


@one_thread()
def watched(problem: Problem, radius: float, every: int = EVERY) -> tuple[list[Array], Rings]:
    """The vertices [(N, 3) mm] of every so many iterations of the flow, from the template on."""
    light = problem.view.light_distance_mm
    limits = problem.limits(radius)
    template = fill(problem.polygon, radius)
    extent = problem.depth_mm or 3.0 * radius
    depth = choose_depth(
        template.curves, radius, light, extent, stretched(problem.mask), 40, seed=0
    )
    parts = [
        even_samples(lift(curve, z, light), 0.45 * radius)
        for curve, z in zip(template.curves, depth.depths, strict=True)
    ]
    points, rings = np.concatenate(parts), rings_of_sizes(tuple(len(p) for p in parts))
    seen = [points]
    for pixels, iterations, weights, tau, rates in _PHASES:
        pixel_mm = max(frame_mm(problem.view)) / pixels
        effects = survey(Situation(problem.view, limits, points, rings, pixel_mm, 0.25))
        frame, target, _ = picture_at(problem.view, problem.mask, pixels, True, "cpu")
        objective = Objective(
            frame, target, rings, limits, effects, weights, tau, radius / pixel_mm, 3
        )

        def watch(
            x: Tensor, near: Neighbours, progress: float, base: Objective = objective
        ) -> Tensor:
            if base.calls % every == 0:
                seen.append(x.detach().numpy().copy())
            return base(x, near, progress)

        walk = FlowSettings(iterations=iterations, rate=rates[0], rate_end=rates[1])
        points = flow(points, rings, watch, radius, walk, separation=limits.separation).points
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
        both = Image.new("RGB", (left.width + right.width, left.height), "white")
        both.paste(left, (0, 0))
        both.paste(right, (left.width, 0))
        found.append(both)
    return found + found[-1:] * LAST


def _shadow(
    points: Array, rings: Rings, frame: Frame, radius: float, wanted: NDArray[np.bool_]
) -> Image.Image:
    """The tube's shadow: black where it is wanted, orange where not, blue where it is missing."""
    p = torch.as_tensor(points, dtype=torch.float32)
    with torch.no_grad():
        cast = (
            render_tiled(p, p[torch.as_tensor(rings.next)], frame, radius, 10.0, 5.0).numpy() > 0.5
        )
    image = np.full((*wanted.shape, 3), 255, dtype=np.uint8)
    image[wanted & cast] = (30, 30, 34)
    image[cast & ~wanted] = (224, 122, 62)
    image[wanted & ~cast] = (120, 170, 214)
    return Image.fromarray(image)


def main(source: str, path: Path) -> None:
    """Write the film of the search for one picture."""
    target = read_target(source)
    scene = resolve(Scene(), [(target.width, target.height)])
    view = resolve_view(scene.views[0], target)
    problem = problem_of(scene.model_copy(update={"views": (view,)}), target)
    assert view.frame_width_mm is not None
    pictures = film(problem, round(SHARE * view.frame_width_mm, 3))
    write_gif(path, pictures, 80)
    print(f"{path}: {len(pictures)} pictures")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python examples/search_film.py PICTURE FILM.gif")
    main(sys.argv[1], Path(sys.argv[2]))
