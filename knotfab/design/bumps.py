"""Bumps: where one strand of a stroke had to step aside past another, and stands outside the picture.

Two strands that hide each other and change their order in depth pass beside each other: in a stroke as wide
as the tube there is no room for that but beside it. No step of a search undoes it, for that would lead the
one through the other; a start whose strands keep their order has none.
"""

from __future__ import annotations

import numpy as np
import shapely

from knotfab.base.errors import SceneError
from knotfab.problem import Problem, SearchResult, Start, TargetView
from knotfab.start.depth import lower
from knotfab.start.start import make_start
from knotfab_formats.search import SearchSettings

__all__ = ["better", "start_without_bumps"]

# radii of the tube: centre lines of a drawn stroke lie in it, that of a bump about a radius beside it
_OUTSIDE = 0.5


def start_without_bumps(
    problem: Problem,
    result: SearchResult,
    radius: float,
    settings: SearchSettings,
    knots: int | None,
) -> Start | None:
    """Give another start for a search that came to bumps, whose strands keep their order; None without bumps.

    Args:
        radius: radius of the tube, mm. knots: as for `make_start`.
    """
    one = len(problem.views) == 1
    given = settings.start or settings.free_view or settings.network_start == "circle"
    if not one or given or problem.depth_mm is None or problem.views[0].lines:
        return None
    if _farthest_outside(result, problem.views[0]) <= _OUTSIDE * radius:
        return None
    try:
        return make_start(problem, radius, settings, knots, parted=True)
    except SceneError:  # the knot that is asked for has no place there
        return None


def better(one: SearchResult, other: SearchResult) -> bool:
    """Tell whether one result is to be taken before another: by its limits, and then by its pictures."""
    if one.feasible != other.feasible:
        return one.feasible
    return one.iou_estimate > other.iou_estimate


def _farthest_outside(result: SearchResult, target: TargetView) -> float:
    """Measure how far centre lines stand outside the picture, mm in the plane of the scene's middle."""
    points = np.concatenate([knot.points for knot in result.knots.knots]) @ target.axes.T
    seen = lower(points, target.view.light_distance_mm)
    shapely.prepare(target.polygon)
    return float(shapely.distance(target.polygon, shapely.points(seen)).max())
