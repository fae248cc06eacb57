"""Where the time went, and an estimate of the next better setting by this piece's own seconds."""

from itertools import pairwise
from typing import Any

import pytest

from knotfab.report.of_time import _study, add_next_step, tell_stages
from knotfab_formats.search import PRESETS


def report(accuracy: str, **settings: Any) -> dict[str, Any]:
    preset = PRESETS.get(accuracy, PRESETS["standard"])
    settings = {"search": preset.scaled(2).model_dump(), **settings}
    return {
        "views": [{"iou": 0.9, "iou_frame": 0.98}, {"iou": 0.99, "iou_drawn": 0.96}],
        "timings": {"search": 10.0, "verify": 5.0, "picture": 0.1, "total": 15.1},
        "settings": {"accuracy": accuracy, "time_budget_s": None, **settings},
    }


def test_each_step_scales_this_piece_as_the_measured_ones() -> None:
    steps = _study()["steps"]
    for own, better in pairwise(steps):
        told = report(own["accuracy"])
        add_next_step(told)
        step = told["next_step"]
        assert step["accuracy"] == better["accuracy"] and better["accuracy"] in step["sentence"]
        # the view that is worst, as it was to be drawn
        assert step["iou_gain"] == pytest.approx(0.04 * (1 - better["error"] / own["error"]))
        ratios = {s: better["seconds"][s] / own["seconds"][s] for s in ("search", "verify")}
        more = 10.0 * (ratios["search"] - 1) + 5.0 * (ratios["verify"] - 1)
        assert step["seconds_more"] == pytest.approx(more, abs=0.2)
        assert "estimate" in step["sentence"]


def test_no_promise_is_beyond_the_views_or_of_negative_time() -> None:
    told = report("draft")
    told["views"][1]["bound"] = 0.961
    told["timings"] |= {"search": 0.0, "verify": 0.0}
    add_next_step(told)
    assert 0 < told["next_step"]["iou_gain"] < 0.001
    assert "in about the same time" in told["next_step"]["sentence"]
    told["views"][1]["bound"] = 0.95
    add_next_step(told)
    assert told["next_step"]["iou_gain"] == 0.0
    assert "hardly nearer" in told["next_step"]["sentence"]


def test_nothing_is_promised_beyond_the_best_nor_in_a_budget() -> None:
    best = _study()["steps"][-1]["accuracy"]
    for told in (report(best), report("draft", time_budget_s=10.0), report("unheard of")):
        add_next_step(told)
        assert "next_step" not in told


@pytest.mark.parametrize(
    "key", ["coarse_px", "fine_px", "coarse_iterations", "fine_iterations", "settle_iterations"]
)
def test_other_iterations_or_pixels_get_no_promise(key: str) -> None:
    told = report("standard")
    told["settings"]["search"][key] -= 1
    add_next_step(told)
    assert "next_step" not in told
    again = report("standard", search={**PRESETS["standard"].model_dump(), key: 96})
    again["views"] = again["views"][:1]
    add_next_step(again)
    assert "next_step" not in again


def test_the_stages_that_took_most_are_named_the_longest_first() -> None:
    said = tell_stages({"picture": 0.1, "search": 4.0, "verify": 5.0, "total": 9.4})
    assert said == "9.4 s: verify 5.0, search 4.0"
    assert tell_stages({"total": 2.0}) == "2.0 s"
