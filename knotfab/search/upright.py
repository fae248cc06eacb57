"""Pull strands into arches that print without supports, with the light's axis upwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.limits.terms import Felt, State
from knotfab.search.objective import Term, Weights

FLANK_DEG = 48.0  # angle from the bed below which edges cost
_FLAT = 3.0  # cost of a level edge one tube radius long, over 0.6
_VALLEY = 1.0  # cost of a valley one tube radius above the floor
_PEAK = 0.3  # cost of a vertex one tube radius above the top


@dataclass(frozen=True)
class Upright(Term):
    """The length of edges flatter than `FLANK_DEG`, times their squared lack of slope, in tube radii.

    Edges on the floor may be flat. Valleys are pulled to the floor, and vertices above the top down to it.
    `up` (3,) is a unit vector, along which `floor_mm` and `top_mm` are heights of centre lines. The gradient
    is taken along `up` alone, so it hardly disturbs the picture.
    """

    radius_mm: float
    up: Array
    floor_mm: float
    top_mm: float

    def __call__(self, state: State, weights: Weights) -> Felt:
        radius, rings = self.radius_mm, state.rings
        height, rise = state.points @ self.up, state.edge @ self.up
        length = np.where(state.length > 0, state.length, 1.0)
        lack = np.maximum(0.0, np.sin(np.radians(FLANK_DEG)) - np.abs(rise) / length)
        # rises from 0 on the floor to 1 a tube radius above it
        free = np.clip((height + 0.5 * rise - self.floor_mm) / radius, 0.0, 1.0)
        share, grows = free * free * (3.0 - 2.0 * free), 6.0 * free * (1.0 - free) / radius
        flat = _FLAT * length * lack**2 / radius
        steeper = np.where(rise < 0, -1.0, 1.0) * (1.0 - (rise / length) ** 2)
        turn = _FLAT * share / radius * (rise / length * lack**2 - 2.0 * lack * steeper)
        lift = 0.5 * grows * flat
        pull = turn[rings.previous] - turn + lift + lift[rings.previous]

        valley = (height <= height[rings.next]) & (height < height[rings.previous])
        low = np.where(valley, height - self.floor_mm, 0.0) / radius
        high = np.maximum(0.0, height - self.top_mm) / radius
        total = float((share * flat).sum() + _VALLEY * (low @ low) + _PEAK * (high @ high))
        pull += 2.0 / radius * (_VALLEY * low + _PEAK * high)
        return total, pull[:, None] * self.up
