"""Where a search starts: template curves at their depths, or circles; a knot tied in. Of known type."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotfab.effects.base import Limits
from knotfab.effects.region import tube_outside
from knotfab.errors import SceneError
from knotfab.geometry.polylines import Rings, rings_of_sizes
from knotfab.problem import Account, Problem
from knotfab.scene.knot_names import knot_name
from knotfab.scene.settings import SearchSettings
from knotfab.search.inn import circles
from knotfab.start.depth import DepthChoice, choose_depth, lift
from knotfab.start.filling import Template, even_samples, simple_curves
from knotfab.start.legibility import stretched
from knotfab.start.tie import Room, tie

__all__ = ["circled", "lifted"]

Array = NDArray[np.float64]

_FLAT_RADII = 3.0  # depth of a flat piece: strands pass over each other, no more


def lifted(
    problem: Problem, template: Template, limits: Limits, settings: SearchSettings, account: Account
) -> tuple[Array, Rings, DepthChoice | None]:
    """The template's curves at their depths, evenly sampled: unknots by inspection."""
    light = problem.view.light_distance_mm
    flat = problem.depth_mm is None
    extent = _FLAT_RADII * limits.radius if problem.depth_mm is None else problem.depth_mm
    depth = choose_depth(
        template.curves,
        limits.radius,
        light,
        extent,
        stretched(problem.mask),
        1 if flat else settings.depth_candidates,
        settings.seed,
    )
    step = settings.edge_radii * limits.radius
    parts = [
        even_samples(lift(c, d, light), step)
        for c, d in zip(template.curves, depth.depths, strict=True)
    ]
    shadows = [p[:, :2] / (1.0 - p[:, 2:] / light) for p in parts]
    if not simple_curves(shadows):
        # even samples cut corners; the template's own vertices are simple as they stand
        parts = [lift(c, d, light) for c, d in zip(template.curves, depth.depths, strict=True)]
        shadows = list(template.curves)
    if not simple_curves(shadows):
        raise SceneError(
            "the filling template",
            "its curves cross each other",
            "This is a fault of knotfab: please report the picture",
        )
    account.template = (
        "simple and disjoint seen from the light: an unlink of unknots, by inspection"
    )
    account.types = ("unknot",) * len(parts)
    if problem.knot != "unknot":
        parts = _tied(problem, parts, limits, account)
    return np.concatenate(parts), rings_of_sizes(tuple(len(p) for p in parts)), depth


def circled(
    problem: Problem, template: Template, limits: Limits, account: Account
) -> tuple[Array, Rings]:
    """A circle for each of the template's curves: unknots that are not linked."""
    if problem.knot != "unknot":
        raise SceneError(
            "scene key [search] network_start",
            f"a circle is an unknot, and a {problem.knot} is asked for",
            'Use network_start = "filling", which has the knot tied in',
        )
    parts = circles(template.curves, limits.radius, 2.0 * limits.separation)
    account.template = "one circle a knot, in parallel planes: an unlink of unknots, by inspection"
    account.types = ("unknot",) * len(parts)
    return np.concatenate(parts), rings_of_sizes(tuple(len(p) for p in parts))


def _tied(problem: Problem, parts: list[Array], limits: Limits, account: Account) -> list[Array]:
    """The curves with the knot that is asked for tied into the longest of them."""
    wanted = knot_name(problem.knot)
    if not wanted.factors:
        return parts

    def outside(points: Array) -> float:
        ahead = np.roll(points, -1, axis=0)
        return float(tube_outside(points, ahead, limits.region, limits.radius)[1].max())

    room = Room(
        problem.polygon,
        problem.view.light_distance_mm,
        limits.radius,
        max(0.5 * limits.separation, limits.bend_radius),
        outside,
    )
    tied = tie(tuple(parts), wanted.factors, room)
    account.types = tuple(
        wanted.promise if k == tied.component else "unknot" for k in range(len(parts))
    )
    account.template += (
        f"; and a {wanted.promise} tied into knot {tied.component}, before or behind all strands that "
        "it hides: their connected sum"
    )
    return list(tied.curves)
