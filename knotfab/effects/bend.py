"""Bend limit: no vertex bends tighter than the material, or the tube itself, allows."""

from __future__ import annotations

from torch import Tensor

from knotfab.effects.base import Effect, EffectContext, Limits, State
from knotfab.geometry.kernels import bend_hinge
from knotfab.geometry.measures import bend_radii
from knotfab.render.known import known

__all__ = ["BEND"]

_OVERSHOOT = 1.06


def magnitude(situation: EffectContext) -> float:
    """Curvature of the tightest bend at the start, in units of what is allowed."""
    tightest = float(bend_radii(situation.points, situation.rings).min())
    return situation.limits.bend_radius / max(tightest, 1e-12)


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of curvature over what is allowed."""
    points = state.points.detach().cpu().numpy()
    total, gradient = bend_hinge(points, state.rings.next, limits.bend_radius * _OVERSHOOT)
    scale = state.spacing / limits.radius
    return known(scale * total, (state.points, scale * gradient))


BEND = Effect(
    "bend",
    "of the limit",
    magnitude,
    lambda s: 0.25,
    "the curve turns, and the picture will ask it to turn tighter",
    term,
)
