"""Length budget: the centre lines together stay below what the material allows."""

from __future__ import annotations

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import Polylines
from knotfab.limits.base import Felt, Limit, Limits, State, total_length

__all__ = ["LENGTH"]

_AIM = 0.99  # share of the budget, so the end is on the safe side


def term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge of the excess in tube radii (paper, length loss)."""
    length, slope = total_length(state)
    excess = max(0.0, length - _AIM * limits.length) / limits.radius
    return excess**2, (2 * excess / limits.radius) * slope


def slack(points: Array, rings: Polylines, limits: Limits) -> float:
    """Vertices that go at most d each lengthen n edges by at most 2 d each."""
    length = float(np.linalg.norm(points[rings.next] - points, axis=1).sum())
    return (_AIM * limits.length - length) / (2 * len(points))


LENGTH = Limit("length", term, slack)
