"""All effects of a scene, judged before anything is simulated."""

from __future__ import annotations

from knotfab.effects.base import Decision, Effect, Situation
from knotfab.effects.bend import BEND
from knotfab.effects.clearance import CLEARANCE
from knotfab.effects.length import LENGTH
from knotfab.effects.penumbra import PENUMBRA
from knotfab.effects.perspective import PERSPECTIVE
from knotfab.effects.region import REGION

__all__ = ["EFFECTS", "judged", "survey"]

EFFECTS: tuple[Effect, ...] = (PERSPECTIVE, CLEARANCE, BEND, REGION, LENGTH, PENUMBRA)


def judged(effect: Effect, situation: Situation) -> Decision:
    """The effect's magnitude against its threshold: simulated only where it is larger."""
    magnitude, threshold = effect.magnitude(situation), effect.threshold(situation)
    return Decision(effect, magnitude, threshold, magnitude > threshold)


def survey(situation: Situation) -> dict[str, Decision]:
    """Every effect judged, by name."""
    return {effect.name: judged(effect, situation) for effect in EFFECTS}
