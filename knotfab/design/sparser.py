"""The best piece that keeps every limit, where the pictures' own filling cannot: fewer strands, or rings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from knotfab.base.errors import SceneError
from knotfab.design.prices import SHORT
from knotfab.problem import Problem, SearchResult, Start
from knotfab.render.forms import COMPILED, Forms
from knotfab.search.search import search
from knotfab.start.filling import Template
from knotfab.start.start import make_start
from knotfab_formats.search import SearchSettings

__all__ = ["search_sparser"]

# These settings leave the search nearly no steps.
_STILL = {**SHORT, "coarse_iterations": 0, "fine_iterations": 0, "settle_iterations": 2}
_WIDER = (1.5, 2.5, 4.0, 6.5, 10.0, 16.0)  # spacings of the strands that are tried, in tube radii


def search_sparser(
    problem: Problem,
    radius: float,
    knots: int | None,
    settings: SearchSettings,
    forms: Forms = COMPILED,
) -> SearchResult | None:
    """Return the first result that is feasible, None where there is none.

    The pictures are filled as by ever thicker tubes, whose strands lie further apart and bend less; a
    piece of one view at its depth and then flat. The last tries are rings.

    Args:
        radius: radius of the tube, mm. knots: as for `make_start`.
    """
    for asked, start, steps in _tries(problem, radius, knots, settings):
        result = search(asked, start, radius, settings.but(**steps), forms=forms)
        if result.feasible:
            return result
    return None


def _tries(
    problem: Problem, radius: float, knots: int | None, settings: SearchSettings
) -> Iterator[tuple[Problem, Start, dict[str, Any]]]:
    """Yield (problem, start, steps) in the order in which they are tried."""
    limits = problem.limits(radius)
    least = max(0.5 * limits.separation, limits.bend_radius) / radius
    wide = {*(w for w in _WIDER if w < least), *(least * w for w in _WIDER)}
    widest = 0.5 * float(np.sqrt(min(p.area for p in problem.polygons)))
    one = len(problem.views) == 1
    flat = replace(problem, depth_mm=None)
    short = settings.but(**SHORT)
    for spacing in sorted(wide):
        if 0.5 * least < spacing and spacing * radius < widest:
            for asked in (problem, flat) if one else (problem,):
                try:
                    yield asked, make_start(asked, radius, short, knots, spacing), SHORT
                except SceneError:  # no such curve, or no place for the knot that is asked for
                    continue
    if not one or problem.knot != "unknot":
        return
    # a ring whose edges were evened bends more than a circle: the first size that serves
    for size in (1.1, 1.3, 1.6):  # a last ring's size over the least that the bend limit allows
        ring = _ring(problem, size * least * radius, radius)
        yield flat, make_start(flat, radius, short, template=ring), _STILL


def _ring(problem: Problem, least: float, radius: float) -> Template:
    """Return the largest circle in the silhouette, or about its middle a larger one that may be bent so."""
    polygon = problem.polygons[0]
    line = shapely.maximum_inscribed_circle(polygon)
    middle = np.asarray(line.coords[0])
    size = max(line.length - radius, least, 2 * radius)
    turn = 2 * np.pi * np.arange(256) / 256
    ring = middle + size * np.stack([np.cos(turn), np.sin(turn)], 1)
    return Template((ring,), polygon, radius)
