"""Bend limit: no vertex bends tighter than the material, or the tube itself, allows."""

from __future__ import annotations

from knotfab.geometry.kernels import bend_hinge
from knotfab.limits.base import Felt, Limit, Limits, State

__all__ = ["BEND"]

_OVERSHOOT = 1.06


def term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge of curvature over what is allowed, and its gradient."""
    total, gradient = bend_hinge(state.points, state.rings.next, limits.bend_radius * _OVERSHOOT)
    scale = state.spacing / limits.radius
    return scale * total, scale * gradient


BEND = Limit("bend", term)
