"""What a limit costs: named with its price, in one view and in several."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from questions import ask_heart, ask_views, start_and_search
from shapely import MultiPolygon, Point

from knotfab.design.design import design_knots
from knotfab.design.retries import SHORT, better, price_limits, start_without_bumps
from knotfab.knots import Knot, Knots
from knotfab.picture.read import read_target
from knotfab.problem import Problem
from knotfab.report.report import check_limits, tell_binding
from knotfab.scene.catalogue import resolve
from knotfab.start.start import make_start
from knotfab_formats.errors import plain
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS, SearchSettings

pytestmark = pytest.mark.slow


def test_several_views_have_their_prices_too(monkeypatch: pytest.MonkeyPatch) -> None:
    few = {"coarse_px": 64, "fine_px": 64, "coarse_iterations": 40, "settle_iterations": 20}
    for name, value in {**few, "fine_iterations": 0}.items():
        monkeypatch.setitem(SHORT, name, value)
    settings = PRESETS["draft"].model_copy(update=few)
    disc = MultiPolygon([Point(0, 0).buffer(40.0)])
    problem = ask_views([disc, disc], 0.0, 90.0, pixels=100, length=480.0)
    start = make_start(problem, 5.0, settings)
    result = start_and_search(problem, 5.0, settings, start, repairs=0)
    [price] = price_limits(problem, start, result, settings, problem.region)
    assert price.limits == ("length",)
    assert price.asked[0] == 480.0 and price.needed[0] > 600.0
    assert price.iou_without > price.iou + 0.05
    assert "the length budget" in price.sentence.lower()


def test_a_length_budget_below_need_is_named_with_its_price(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    few = {"coarse_px": 96, "fine_px": 96, "coarse_iterations": 12, "settle_iterations": 8}
    for name, value in {**few, "fine_iterations": 4, "depth_candidates": 1}.items():
        monkeypatch.setitem(SHORT, name, value)
    given = {
        "schema": 1,
        "piece": {"tube_radius_mm": 5.0},
        "material": {"max_length_mm": 600.0},
        "accuracy": {"name": "draft"},
        "search": {
            **{"coarse_px": 96, "fine_px": 128, "depth_candidates": 4},
            **{"coarse_iterations": 20, "fine_iterations": 10, "settle_iterations": 10},
        },
        "views": [{"picture": "heart.png"}],
    }
    made = design_knots(resolve(Scene.model_validate(given)), [read_target("text:♥")])
    [price] = made.binding
    assert price.limits == ("length",) and price.met_without
    assert price.iou_without > price.iou + 0.2
    assert price.needed[0] > 600.0
    assert made.result.feasible
    assert made.result.feasibility.length_mm <= 600.0
    assert "max_length_mm = 600 mm" in tell_binding(made)[0]
    assert json.loads(json.dumps(plain(price)))["keys"] == ["[material] max_length_mm"]
    assert check_limits(made).status == ("pass" if made.unmet is None else "fail")


# A search that came to bumps gets another start, which draws the same picture; no other search
# does.


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
