"""Bend limit: no vertex bends tighter than the material, or the tube itself, allows."""

from __future__ import annotations

from torch import Tensor

from knotfab.geometry.kernels import bend_hinge
from knotfab.limits.base import Limit, Limits, State
from knotfab.render.known import known

__all__ = ["BEND"]

_OVERSHOOT = 1.06


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of curvature over what is allowed."""
    points = state.points.detach().cpu().numpy()
    total, gradient = bend_hinge(points, state.rings.next, limits.bend_radius * _OVERSHOOT)
    scale = state.spacing / limits.radius
    return known(scale * total, (state.points, scale * gradient))


BEND = Limit("bend", term)
