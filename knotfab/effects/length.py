"""Length budget: the centre lines together stay below what the material allows."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from knotfab.effects.base import Effect, EffectContext, Limits, State

__all__ = ["LENGTH"]

_GROWTH = 1.25  # a flow seldom lengthens a filling template by more


def magnitude(situation: EffectContext) -> float:
    """Expected length of the finished knots over the budget, mm; negative when below."""
    points, rings = situation.points, situation.rings
    length = float(np.linalg.norm(points[rings.next] - points, axis=1).sum())
    return _GROWTH * length - situation.limits.length


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of the excess in tube radii (paper, length loss)."""
    excess = (state.edge.norm(dim=-1).sum() - 0.99 * limits.length) / limits.radius
    squared: Tensor = excess.clamp_min(0) ** 2
    return squared


LENGTH = Effect("length", "mm", magnitude, lambda s: 0.0, "the budget binds", term)
