"""What is simulated and why: by magnitude, by the scene's own word, and never in silence."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.effects.base import Decision, Effect, EffectContext, decide
from knotfab.effects.survey import EFFECTS, survey
from knotfab.report.effects import tell_warnings
from knotfab_formats.scene import ResolvedView
from knotfab_formats.views import Switches

VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)
CONTEXT = EffectContext((VIEW,), np.zeros((4, 3)), 2.0, 0.25)


def effect(magnitude: float) -> Effect:
    return Effect("haze", "px", lambda _: magnitude, 4.0, "the air is hazy")


@pytest.mark.parametrize(
    ("magnitude", "forced", "simulated", "warned"),
    [
        (0.9, None, False, False),
        (1.1, None, True, False),
        (0.9, True, True, False),
        (1.1, False, False, True),
        (0.9, False, False, False),
    ],
)
def test_on_above_the_threshold_or_by_the_scenes_word(
    magnitude: float, forced: bool | None, simulated: bool, warned: bool
) -> None:
    found = decide(effect(magnitude), CONTEXT, {"haze": forced})
    assert (found.threshold, found.magnitude) == (1.0, magnitude)
    assert found.simulated == simulated
    side = "exceeds" if magnitude > 1 else "stays below"
    assert f"{magnitude:.3g} px {side} 1 px" in found.reason
    assert ("the air is hazy" in found.reason) == (simulated and forced is None)
    told = tell_warnings({"haze": found})
    assert len(told) == warned
    assert not warned or "haze is switched off, though its 1.1 px exceeds 1 px" in told[0]


def test_what_it_does_grows_from_nothing_at_the_threshold() -> None:
    at = [decide(effect(m), CONTEXT, {}).excess for m in (0.99, 1.0, 1.01, 2.0, 100.0)]
    assert at[0] == at[1] == 0 < at[2] < 0.01
    assert at[3] == pytest.approx(0.5) and at[4] == pytest.approx(0.99)
    for forced in (True, False):  # measured below the threshold, yet without a say
        assert decide(effect(0.5), CONTEXT, {"haze": forced}).excess == 0


def test_calls_and_seconds_are_counted_by_stage() -> None:
    found = Decision(effect(2.0), 2.0, 1.0)
    assert found.where == [] and found.calls == 0
    for _ in range(3):
        with found.called("depth"):
            pass
    found.count("verification", 101, 0.5)
    assert (found.calls, found.where) == (104, ["depth", "verification"])
    assert found.seconds >= 0.5


def test_judged_anew_nothing_is_taken_back() -> None:
    found = Decision(effect(0.0), 0.9, 1.0)
    found.keep_largest(Decision(effect(0.0), 0.5, 1.0))
    assert (found.magnitude, found.simulated) == (0.9, False)
    found.keep_largest(Decision(effect(0.0), 1.5, 1.2))
    found.keep_largest(Decision(effect(0.0), 0.1, 1.2))
    assert (found.magnitude, found.threshold, found.simulated) == (1.5, 1.2, True)


def test_every_effect_has_its_switch_and_only_these() -> None:
    assert [e.name for e in EFFECTS] == list(Switches.model_fields)
    assert list(survey(CONTEXT, dict(Switches()))) == [e.name for e in EFFECTS]


def test_what_an_earlier_search_spent_is_counted() -> None:
    earlier, later = Decision(effect(9.0), 9.0, 1.0), Decision(effect(4.0), 4.0, 1.0)
    earlier.count("depth", 300, 0.1)
    later.count("depth", 20, 0.2)
    later.count("search", 1, 0.3)
    later.add(earlier)
    assert (later.calls, later.magnitude, later.where) == (321, 9.0, ["depth", "search"])
    assert later.seconds == pytest.approx(0.6)
    assert (earlier.calls, earlier.where) == (300, ["depth"])
