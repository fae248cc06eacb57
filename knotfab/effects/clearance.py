"""Clearance: strands keep two radii and a gap between their centre lines."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from knotfab.effects.base import Effect, EffectContext, Limits, State
from knotfab.geometry.kernels import gap_hinge
from knotfab.geometry.measures import strand_gap
from knotfab.render.known import known

__all__ = ["CLEARANCE"]

_OVERSHOOT = 1.02  # aim a little wider than required, so the end is on the safe side


def magnitude(situation: EffectContext) -> float:
    """How far the closest strands are from what is required, mm; negative when there is room."""
    limits = situation.limits
    reach = 3.0 * limits.separation
    gap = strand_gap(situation.points, situation.rings, limits.separation, reach, straight=0.7).gap
    return limits.separation - gap


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge over segment pairs whose arc distance exceeds pi (r + c/2), in squared radii.

    (2r + c - d)+^2, with exact distances d between segments; 2 % are added to aim a little wide.
    """
    distance = limits.separation * _OVERSHOOT
    total, gradient = gap_hinge(
        state.points.detach().cpu().numpy(),
        state.rings.next,
        state.rings.start,
        state.rings.size,
        state.near.i,
        state.near.j,
        distance + 1.5 * state.spacing,
        0.5 * np.pi * limits.separation / state.spacing,
        distance,
    )
    scale = state.spacing / limits.radius**3
    return known(scale * total, (state.points, scale * gradient))


CLEARANCE = Effect(
    "clearance",
    "mm",
    magnitude,
    lambda s: -2.0 * s.limits.separation,
    "strands run side by side, closer than the flow could carry them together",
    term,
)
