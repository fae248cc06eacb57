"""The choice of the tube radius: the largest that draws the picture nearly as well as any."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from questions import ask_views
from shapely import MultiPolygon, Point

from knotfab.base.errors import SceneError
from knotfab.design import radius as module
from knotfab.design.budget import Budget
from knotfab.design.candidates import line_radius, line_width
from knotfab.design.question import Question, ask
from knotfab.design.radius import _Trials, choose_radius
from knotfab.picture.read import read_target
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS
from knotfab_formats.views import View

DRAFT = PRESETS["draft"]


@pytest.fixture(scope="module")
def question() -> Question:
    return ask(resolve(Scene()), [read_target("text:♥")])


@pytest.mark.slow
def test_the_largest_of_those_that_draw_it_well_is_taken(question: Question) -> None:
    choice = choose_radius(question, DRAFT)
    drawn = {t.radius_mm: t.template_iou for t in choice.trials}
    well = max(drawn.values()) - DRAFT.radius_give
    assert len(drawn) > 4 and choice.radius_mm == max(r for r, iou in drawn.items() if iou >= well)
    assert choice.template is not None and choice.template.radius == choice.radius_mm
    more = choose_radius(question, DRAFT.model_copy(update={"radius_give": 0.1}))
    assert more.radius_mm > choice.radius_mm and drawn[more.radius_mm] >= max(drawn.values()) - 0.1


@pytest.mark.slow
def test_a_spent_budget_takes_a_thicker_tube_within_its_give(question: Question) -> None:
    free = choose_radius(question, DRAFT)
    unhurried = choose_radius(question, DRAFT, budget=Budget(time.perf_counter() + 1000.0))
    assert unhurried.radius_mm == free.radius_mm
    spent = choose_radius(question, DRAFT, budget=Budget(time.perf_counter() - 1.0))
    drawn = {trial.radius_mm: trial.template_iou for trial in free.trials}
    assert spent.radius_mm > free.radius_mm
    assert drawn[spent.radius_mm] >= max(drawn.values()) - 0.03


@pytest.mark.slow
def test_a_radius_without_a_place_for_the_knot_is_passed_over(
    question: Question, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = choose_radius(question, DRAFT).radius_mm
    tried: list[float] = []

    def make(problem: Any, radius: float, *others: Any, **more: Any) -> object:
        tried.append(radius)
        if radius == first:
            raise SceneError("the knot", "there is no place for it", "Take a thinner tube.")
        return object()

    monkeypatch.setattr(module, "make_start", make)
    module._KEPT.clear()
    choice = choose_radius(question, DRAFT)
    assert tried == [first, choice.radius_mm] and choice.radius_mm != first

    def refuse(*others: Any, **more: Any) -> object:
        raise SceneError("the knot", "there is no place for it", "Take a thinner tube.")

    monkeypatch.setattr(module, "make_start", refuse)
    module._KEPT.clear()
    with pytest.raises(SceneError, match="no place for it"):
        choose_radius(question, DRAFT)


def test_a_tube_that_cannot_close_in_a_dot_is_not_taken_for_it(tmp_path: Path) -> None:
    """A loop smaller than any ring covers a disc as wide as its tube, which no tube draws."""
    v, u = np.mgrid[:300, :300]
    dot = np.hypot(v - 149.5, u - 149.5) < 12.5
    Image.fromarray(np.where(dot, 0, 255).astype(np.uint8)).save(tmp_path / "dot.png")
    question = ask(resolve(Scene()), [read_target(tmp_path / "dot.png")])
    disc = 12.5 / question.views[0].px_per_mm(300)
    choice = choose_radius(question, DRAFT)
    assert choice.radius_mm < 0.55 * disc
    thick = [t.template_iou for t in choice.trials if t.radius_mm > 0.8 * disc]
    assert thick and max(thick) < 0.6


def test_of_worse_radii_the_better_comes_first(
    question: Question, monkeypatch: pytest.MonkeyPatch
) -> None:
    ious = iter([0.97, 0.98, 0.979, 0.96, 0.99, 0.991, 0.95, 0.94, 0.9, 0.9, 0.9, 0.9])
    known: dict[float, float] = {}

    def score(self: Any, radius: float) -> float:
        known[radius] = known.get(radius) or next(ious)
        return known[radius]

    order: list[float] = []

    def begin(self: Any, radius: float) -> float:
        order.append(radius)
        return 0.0 if len(order) < len(known) else 1.0

    monkeypatch.setattr(module._Trials, "score", score)
    monkeypatch.setattr(module._Trials, "begin", begin)
    monkeypatch.setattr(module, "_WORKERS", 1)
    choose_radius(question, DRAFT)
    well = [r for r in order if known[r] >= 0.991 - DRAFT.radius_give]
    assert order[: len(well)] == sorted(well, reverse=True)
    rest = [known[r] for r in order[len(well) :]]
    assert rest == sorted(rest, reverse=True) and len(order) == len(known)


@given(st.floats(0.3, 4.0), st.floats(150.0, 1500.0), st.floats(20.0, 300.0))
def test_the_tube_along_a_line_is_no_thinner_than_asked(
    radius: float, light: float, wall: float
) -> None:
    view = View(light_distance_mm=light, wall_distance_mm=wall)
    asked = round(radius, 2)
    again = line_radius(view.model_copy(update={"thicken_mm": line_width(view, asked)}))
    assert asked <= again < asked + 2e-3


@pytest.mark.parametrize(
    ("starts", "tried", "taken"),
    [
        ([0.9], 1, 0),
        ([0.6, 0.8, 0.9], 3, 2),
        ([0.6, 0.795, 0.8], 3, 1),  # as thin as can be printed, and hardly better
    ],
)
def test_thinner_tubes_are_tried_until_a_start_will_do(
    starts: list[float], tried: int, taken: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    disc = MultiPolygon([Point(0, 0).buffer(40.0)])
    asked = Question(resolve(Scene()), ask_views([disc] * 3, 0.0, 60.0, 120.0))
    begun: list[float] = []

    def begin(_: _Trials, radius: float) -> float:
        begun.append(radius)
        return starts[len(begun) - 1]

    monkeypatch.setattr(_Trials, "begin", begin)
    choice = choose_radius(asked, DRAFT)
    assert len(begun) == tried and begun == sorted(begun, reverse=True)
    assert choice.radius_mm == begun[taken] and begun[-1] >= asked.scene.printer.min_tube_radius_mm


def test_several_pictures_get_no_thinner_tube_than_will_do(monkeypatch: pytest.MonkeyPatch) -> None:
    disc = MultiPolygon([Point(0, 0).buffer(40.0)])
    asked = Question(resolve(Scene()), ask_views([disc] * 2, 0.0, 90.0))
    monkeypatch.setattr(_Trials, "score", lambda _, radius: 1.0 if radius < 1.3 else 0.5)
    monkeypatch.setattr(_Trials, "begin", lambda _, radius: 1.0 - 0.1 * radius)
    tried = choose_radius(asked, DRAFT)
    begun = [t.radius_mm for t in tried.trials if not np.isnan(t.trial_iou)]
    thin = [t.radius_mm for t in tried.trials if t.template_iou == 1.0]
    assert len(begun) == 1 < len(thin) and tried.radius_mm == begun[0] == max(thin)
