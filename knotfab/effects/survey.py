"""All effects of a scene, decided before anything is simulated."""

from __future__ import annotations

from collections.abc import Mapping

from knotfab.effects.base import Decision, Effect, EffectContext, decide
from knotfab.effects.misplacement import MISPLACEMENT
from knotfab.effects.penumbra import PENUMBRA
from knotfab.effects.shifts import LAYERS, SAG
from knotfab_formats.views import Switch

EFFECTS: tuple[Effect, ...] = (PENUMBRA, MISPLACEMENT, SAG, LAYERS)


def survey(context: EffectContext, switches: Mapping[str, Switch]) -> dict[str, Decision]:
    """Decide for each effect, by name, whether it is simulated; `switches` are the scene's own settings."""
    return {effect.name: decide(effect, context, switches) for effect in EFFECTS}
