"""All effects of a scene, judged before anything is simulated."""

from __future__ import annotations

from knotfab.effects.base import Decision, Effect, EffectContext
from knotfab.effects.bend import BEND
from knotfab.effects.clearance import CLEARANCE
from knotfab.effects.length import LENGTH
from knotfab.effects.penumbra import PENUMBRA
from knotfab.effects.region import REGION

__all__ = ["EFFECTS", "survey"]

EFFECTS: tuple[Effect, ...] = (CLEARANCE, BEND, REGION, LENGTH, PENUMBRA)


def survey(situation: EffectContext) -> dict[str, Decision]:
    """Each effect's magnitude against its threshold, by name: simulated only where it is larger."""
    decisions = {}
    for effect in EFFECTS:
        magnitude, threshold = effect.magnitude(situation), effect.threshold(situation)
        decisions[effect.name] = Decision(effect, magnitude, threshold, magnitude > threshold)
    return decisions
