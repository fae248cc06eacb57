"""The knots of a report: as they will be, once their material has shrunk."""

from collections.abc import Sequence
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest
from pieces import knots, ring
from reports import report_with, verdict_of

from knotfab.effects.base import Decision
from knotfab.effects.penumbra import PENUMBRA
from knotfab.part.assemble import enlarge_knots
from knotfab.problem import CertificateLog
from knotfab.report.effects import list_effects, tell_move
from knotfab.report.report import _study, plan_next_step, print_of, report_of, tell_stages
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Material
from knotfab_formats.report import NextStep, Report
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.search import PRESETS, search_settings
from knotfab_formats.verdict import WorstMove

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0, picture="picture-front.png")


def told(tmp_path: Any, percent: float) -> Report:
    """The report of a ring of 30 mm that has no part."""
    keys: Any = {"views": (VIEW,), "material": Material(shrinkage_percent=percent)}
    feasibility = SimpleNamespace(figures={})
    result = SimpleNamespace(effects={}, guards={}, feasibility=feasibility, log=CertificateLog())
    made: Any = SimpleNamespace(
        scene=resolve(Scene(**keys)),
        knots=knots(ring(30.0, n=80, wave=0.0)),
        result=result,
        radius=None,
        opening_iou=1.0,
        settings=search_settings("draft", {}),
        bounds=(),
        binding=(),
        unmet=None,
    )
    request = Request(made.scene, (), tmp_path)
    found = verdict_of(), (), (), print_of(made, (), ())
    return report_of(request, made, enlarge_knots(made), *found, ())


@pytest.mark.parametrize("percent", [3.0, 12.5])
def test_knots_are_reported_as_they_will_have_shrunk(tmp_path: Any, percent: float) -> None:
    as_is, shrunk = told(tmp_path, 0.0), told(tmp_path, percent)
    assert as_is.settings.tube_radius_mm == shrunk.settings.tube_radius_mm == 2.0
    for key in ("length_mm", "thickness_mm", "min_bend_radius_mm", "curvature_90_radii"):
        one, other = (getattr(found.knots[0], key) for found in (shrunk, as_is))
        assert one == pytest.approx(other, rel=1e-6), key
    thick = [report.settings.thickness_mm for report in (as_is, shrunk)]
    assert thick[0] == pytest.approx(thick[1])


# A report says where the time went, and what the next better setting would take of this piece.


TIMINGS = {"search": 10.0, "verify": 5.0, "picture": 0.1, "total": 15.1}
VIEWS: list[dict[str, Any]] = [{"iou": 0.9, "iou_frame": 0.98}, {"iou": 0.99, "iou_drawn": 0.96}]


def report(accuracy: str, views: Sequence[dict[str, Any]] = VIEWS, **settings: Any) -> Report:
    preset = PRESETS.get(accuracy, PRESETS["standard"])
    settings = {"accuracy": accuracy, "search": preset.scaled(2).model_dump(), **settings}
    return report_with(views=views, settings=settings)


def test_each_step_scales_this_piece_as_the_measured_ones() -> None:
    steps = _study()["steps"]
    for own, better in pairwise(steps):
        step = plan_next_step(report(own["accuracy"]), TIMINGS)
        assert step is not None and step.accuracy == better["accuracy"]
        assert better["accuracy"] in step.sentence
        # the view that is worst, as it was to be drawn
        assert step.iou_gain == pytest.approx(0.04 * (1 - better["error"] / own["error"]))
        ratios = {s: better["seconds"][s] / own["seconds"][s] for s in ("search", "verify")}
        more = 10.0 * (ratios["search"] - 1) + 5.0 * (ratios["verify"] - 1)
        assert step.seconds_more == pytest.approx(more, abs=0.2)


def test_no_promise_is_beyond_the_views_or_of_negative_time() -> None:
    def bounded(bound: float) -> NextStep:
        views = [VIEWS[0], {**VIEWS[1], "bound": bound}]
        step = plan_next_step(report("draft", views), {**TIMINGS, "search": 0.0, "verify": 0.0})
        assert step is not None
        return step

    assert 0 < bounded(0.961).iou_gain < 0.001
    assert "in about the same time" in bounded(0.961).sentence
    assert bounded(0.95).iou_gain == 0.0
    assert "hardly nearer" in bounded(0.95).sentence


def test_nothing_is_promised_beyond_the_best_nor_in_a_budget() -> None:
    best = _study()["steps"][-1]["accuracy"]
    for told in (report(best), report("draft", time_budget_s=10.0), report("unheard of")):
        assert plan_next_step(told, TIMINGS) is None


@pytest.mark.parametrize(
    "key", ["coarse_px", "fine_px", "coarse_iterations", "fine_iterations", "settle_iterations"]
)
def test_other_iterations_or_pixels_get_no_promise(key: str) -> None:
    search = PRESETS["standard"].scaled(2).model_dump()
    told = report("standard", search={**search, key: search[key] - 1})
    assert plan_next_step(told, TIMINGS) is None
    again = report("standard", VIEWS[:1], search={**PRESETS["standard"].model_dump(), key: 96})
    assert plan_next_step(again, TIMINGS) is None


def test_the_stages_that_took_most_are_named_the_longest_first() -> None:
    said = tell_stages({"picture": 0.1, "search": 4.0, "verify": 5.0, "total": 9.4})
    assert said == "9.4 s: verify 5.0, search 4.0"
    assert tell_stages({"total": 2.0}) == "2.0 s"


# What a report says of effects: calls of design and verification together.


SOFT = {
    "widest_px": 9.0, "iou": 0.99, "brightness_error": 0.0, "hard_error": 0.0, "samples": 19,
}  # fmt: skip


def test_an_effects_line_counts_the_design_and_the_verification() -> None:
    decision = Decision(PENUMBRA, 9.0, 1.0)
    decision.count("depth", 300, 0.1)
    result: Any = SimpleNamespace(effects={"penumbra": decision})
    verdict = verdict_of([{"penumbra": SOFT}, {}], seconds={"penumbra": 1.5})
    (line,) = list_effects(result, verdict)
    assert (line.calls, line.seconds) == (319, 1.6)
    assert line.where == ("depth", "verification")
    (line,) = list_effects(result, verdict_of())
    assert (line.calls, line.where) == (300, ("depth",))
    assert decision.calls == 300


def test_an_effect_that_nothing_ran_is_not_called_simulated() -> None:
    result: Any = SimpleNamespace(effects={"penumbra": Decision(PENUMBRA, 9.0, 1.0)})
    (line,) = list_effects(result, verdict_of())
    assert not line.simulated and line.reason.endswith("; nothing ran it")
    (line,) = list_effects(result, verdict_of([{"penumbra": SOFT}]))
    assert line.simulated and "nothing" not in line.reason


def test_a_move_is_told_in_words() -> None:
    off: Any = SimpleNamespace(lamp_mm=5.0, turn_deg=1.5)

    def told(of: str, way: str, kind: str = "shadow") -> str:
        return tell_move(WorstMove(0.9, 0.95, of, way), off, kind)

    assert told("lamp", "up") == "the lamp 5 mm up or down"
    assert told("lamp", "right", "eye") == "the eye 5 mm to the side"
    hung = tell_move(WorstMove(0.9, 0.95, "turn", "up"), off, "shadow", 80.0)
    assert hung == "one thread 2.1 mm nearer the wall than the other"
    assert told("turn", "axis") == "the piece turned by 1.5° like a wheel"
