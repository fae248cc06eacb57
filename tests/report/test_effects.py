"""What a report says of effects: calls of design and verification together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from reports import verdict_of

from knotfab.effects.base import Decision
from knotfab.effects.penumbra import PENUMBRA
from knotfab.report.effects import list_effects, tell_move
from knotfab_formats.verdict import WorstMove

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
