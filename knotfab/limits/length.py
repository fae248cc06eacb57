"""Length budget: the centre lines together stay below what the material allows."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from knotfab.arrays import Array
from knotfab.geometry.polylines import Polylines
from knotfab.limits.base import Limit, Limits, State
from knotfab.render.known import known

__all__ = ["LENGTH"]

_AIM = 0.99  # share of the budget, so the end is on the safe side


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of the excess in tube radii (paper, length loss)."""
    edge = state.edge.detach().cpu().numpy()
    length = np.linalg.norm(edge, axis=1)
    excess = max(0.0, float(length.sum()) - _AIM * limits.length) / limits.radius
    along = edge / np.maximum(length, 1e-300)[:, None]
    slope = (2 * excess / limits.radius) * (along[state.rings.previous] - along)
    return known(excess**2, (state.points, slope))


def slack(points: Array, rings: Polylines, limits: Limits) -> float:
    """Vertices that go at most d each lengthen n edges by at most 2 d each."""
    length = float(np.linalg.norm(points[rings.next] - points, axis=1).sum())
    return (_AIM * limits.length - length) / (2 * len(points))


LENGTH = Limit("length", term, slack)
