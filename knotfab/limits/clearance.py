"""Clearance: strands keep two radii and a gap between their centre lines."""

from __future__ import annotations

import numpy as np

from knotfab.geometry.kernels import gap_hinge
from knotfab.limits.base import Felt, Limit, Limits, State

__all__ = ["CLEARANCE"]

_OVERSHOOT = 1.02  # aim a little wider than required, so the end is on the safe side


def term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge over segment pairs whose arc distance exceeds pi (r + c/2), in squared radii.

    (2r + c - d)+^2, with exact distances d between segments; 2 % are added to aim a little wide.
    """
    distance = limits.separation * _OVERSHOOT
    total, gradient = gap_hinge(
        state.points,
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
    return scale * total, scale * gradient


CLEARANCE = Limit("clearance", term)
