"""A search that came to bumps gets another start, which draws the same picture; no other search does."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from questions import ask_heart

from knotfab.design.bumps import better, start_without_bumps
from knotfab.knots import Knot, Knots
from knotfab.problem import Problem
from knotfab_formats.search import PRESETS, SearchSettings

RADIUS = 3.0
FEW = PRESETS["draft"].model_copy(update={"depth_candidates": 4})


@dataclass(frozen=True)
class Ended:
    """What is asked of how a search ended."""

    knots: Knots
    feasible: bool = True
    iou_estimate: float = 0.9


def ended(problem: Problem, beside_mm: float) -> Ended:
    """A curve in the middle of the picture, one point of which stands so far outside it."""
    middle = problem.polygons[0].representative_point()
    right = problem.polygons[0].bounds[2]
    points = np.array([[middle.x, middle.y, 0.0]] * 3)
    points[:2, 0] += (1.0, -1.0)
    points[2, :2] = _beside(problem, right, beside_mm)
    return Ended(Knots((Knot(points @ problem.views[0].axes, closed=True),), RADIUS))


def _beside(problem: Problem, right: float, beside_mm: float) -> tuple[float, float]:
    from shapely import Point
    from shapely.ops import nearest_points

    shape = problem.polygons[0]
    edge = nearest_points(shape, Point(right + 10.0, shape.centroid.y))[0]
    return (edge.x + beside_mm, edge.y)


@pytest.mark.slow
def test_a_strand_beside_the_picture_asks_for_another_start() -> None:
    problem = ask_heart()
    start = start_without_bumps(problem, ended(problem, RADIUS), RADIUS, FEW, None)  # type: ignore[arg-type]
    assert start is not None and start.types == ("unknot",) * len(start.curves)
    assert start.depth is not None
    heights = np.concatenate(start.depth.depths)
    assert np.ptp(heights) <= problem.depth_mm + 1e-6  # type: ignore[operator]


@pytest.mark.slow
def test_no_bump_no_other_start_nor_where_the_start_was_given() -> None:
    problem = ask_heart()
    inside, bump = ended(problem, 0.3 * RADIUS), ended(problem, RADIUS)
    cases: list[tuple[Problem, Ended, SearchSettings]] = [
        (problem, inside, FEW),
        (replace(problem, depth_mm=None), bump, FEW),
        (problem, bump, FEW.model_copy(update={"start": "knots.json"})),
        (problem, bump, FEW.model_copy(update={"free_view": True})),
        (problem, bump, FEW.model_copy(update={"network_start": "circle"})),
    ]
    for asked, came_to, settings in cases:
        assert start_without_bumps(asked, came_to, RADIUS, settings, None) is None  # type: ignore[arg-type]


@pytest.mark.slow
def test_limits_come_before_pictures() -> None:
    knots = ended(ask_heart(), 0.0).knots
    good, kept = Ended(knots, feasible=False, iou_estimate=0.99), Ended(knots, iou_estimate=0.9)
    assert better(kept, good) and not better(good, kept)  # type: ignore[arg-type]
    assert better(replace(kept, iou_estimate=0.95), kept)  # type: ignore[arg-type]
    assert not better(kept, kept)  # type: ignore[arg-type]
