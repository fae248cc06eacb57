"""Bend limit: no vertex bends tighter than the material, or the tube itself, allows."""

from __future__ import annotations

import torch
from torch import Tensor

from knotfab.effects.base import Effect, EffectContext, Limits, State
from knotfab.geometry.measures import bend_radii

__all__ = ["BEND"]

_OVERSHOOT = 1.06


def magnitude(situation: EffectContext) -> float:
    """Curvature of the tightest bend at the start, in units of what is allowed."""
    tightest = float(bend_radii(situation.points, situation.rings).min())
    return situation.limits.bend_radius / max(tightest, 1e-12)


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of curvature over what is allowed.

    The bend radius of a vertex is min(adjacent edges) / (2 tan(turning angle / 2)) (Rawdon 1998).
    """
    one, two = state.edge.norm(dim=-1), state.after.norm(dim=-1)
    cosine, product = (state.edge * state.after).sum(-1), one * two
    # 2 tan(theta / 2) = 2 sqrt((1 - cos theta) / (1 + cos theta))
    folded = (product + cosine).clamp_min(1e-9 * product.detach())
    curvature = 2 * ((product - cosine) / folded).clamp_min(1e-12).sqrt() / torch.minimum(one, two)
    hinge = (curvature * (limits.bend_radius * _OVERSHOOT) - 1).clamp_min(0)
    squared: Tensor = (hinge * hinge).sum() * (state.spacing / limits.radius)
    return squared


BEND = Effect(
    "bend",
    "of the limit",
    magnitude,
    lambda s: 0.25,
    "the curve turns, and the picture will ask it to turn tighter",
    term,
)
