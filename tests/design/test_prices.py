"""What a limit costs: named with its price, in one view and in several."""

import json

import pytest
from questions import ask_views, start_and_search
from shapely import MultiPolygon, Point

from knotfab.design.design import design_knots
from knotfab.design.prices import SHORT, price_limits
from knotfab.picture.read import read_target
from knotfab.report.of_build import check_limits, tell_binding
from knotfab.scene.catalogue import resolve
from knotfab.start.start import make_start
from knotfab_formats.records import plain
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS

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
