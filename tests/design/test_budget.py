"""Time budgets: the least, what is spared, and a search by the clock that its scene repeats."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from knotfab.base.progress import Progress
from knotfab.design import design
from knotfab.design.budget import Budget, require_budget, spare
from knotfab.design.design import design_knots, price_design
from knotfab.picture.read import read_target
from knotfab.scene.catalogue import resolve
from knotfab_formats.errors import InputError
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS

TINY = {"coarse_px": 64, "fine_px": 96, "depth_candidates": 4, "radius_candidates": 2}


@pytest.mark.parametrize(
    ("least", "asked"),
    [
        (5.0, {"views": 1, "free": False}),
        (12.0, {"views": 2, "free": False}),
        (12.0, {"views": 1, "free": True}),
        (24.0, {"views": 1, "free": False, "frames": 6}),
    ],
)
def test_less_than_the_least_is_refused(least: float, asked: dict[str, Any]) -> None:
    require_budget(least, **asked)
    with pytest.raises(InputError, match=f"at least {least:g} s") as caught:
        require_budget(0.99 * least, **asked)
    assert caught.value.exit_code == 2


def test_what_is_spared_is_never_more_and_never_what_is_given() -> None:
    for own in PRESETS.values():
        for seconds in (0.1, 4.0, 9.0, 100.0):
            less = spare(own, seconds, given={"fine_px"})
            assert less.fine_px == own.fine_px
            assert all(
                getattr(less, key) <= getattr(own, key)
                for key in ("coarse_px", "depth_candidates", "radius_candidates", "mesh_sides")
            )
    assert spare(PRESETS["fine"], 100.0) == PRESETS["fine"]
    for seconds, like in ((0.1, "sketch"), (4.0, "draft"), (100.0, "standard")):
        less = spare(PRESETS["standard"], seconds)
        assert less.radius_give == PRESETS[like].radius_give
        assert less.settle_edge_radii == PRESETS[like].settle_edge_radii
        assert spare(PRESETS["standard"], seconds, {"radius_give"}).radius_give == 0.004
    assert spare(PRESETS["sketch"], 4.0) == PRESETS["sketch"]  # never a thinner tube either


def test_what_follows_the_search_is_kept_back() -> None:
    budget = Budget(time.perf_counter() + 20.0, after_s=4.0, after_vertex_s=0.001)
    assert budget.search_s(2000) == pytest.approx(14.0, abs=0.5)


def test_more_is_given_only_while_what_follows_does_not_fit() -> None:
    def vertices(give: float) -> int:  # a thicker tube has fewer
        return int(4000 * (1.0 - 20.0 * give))

    asked = []
    for left in (30.0, 5.0, 2.6, 0.0):
        budget = Budget(time.perf_counter() + left, after_s=1.0, after_vertex_s=0.001)
        given = budget.thicker(0.0, vertices)
        count = vertices(given)
        asked.append(given)
        assert given == 0.03 or budget.search_s(count) > 0.0
        assert budget.thicker(0.04, vertices) == 0.04  # never less than what is given anyway
    assert asked == sorted(asked) and asked[0] == 0.0 and asked[-1] == 0.03


def test_no_price_is_asked_once_the_budget_is_spent(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(design, "price_limits", lambda *_: asked.append(True) or ())
    knots = SimpleNamespace(radius_mm=2.0, knots=[SimpleNamespace(points=np.zeros((9, 3)))])
    made = design.Design(None, knots, None, None, 1.0, PRESETS["draft"])  # type: ignore[arg-type]
    unmet: Any = SimpleNamespace(feasible=False, feasibility="broken", iou_estimate=0.5)
    question: Any = SimpleNamespace(problem=None, roomy=lambda: None)
    made = replace(made, result=unmet)
    for left, prices in ((-1.0, 0), (60.0, 1)):
        budget = Budget(time.perf_counter() + left)
        start: Any = object()
        found = price_design(made, question, start, unmet, Progress("quiet"), budget=budget)
        assert found.unmet == unmet.feasibility and len(asked) == prices


@pytest.mark.slow
def test_the_scene_of_a_build_by_the_clock_repeats_it() -> None:
    target = read_target("text:♥")
    made = design_knots(
        resolve(Scene(search=TINY)), [target], budget=Budget(time.perf_counter() + 1.5)
    )
    again = design_knots(made.scene, [target])
    np.testing.assert_array_equal(made.knots.points, again.knots.points)
    assert again.scene == made.scene
