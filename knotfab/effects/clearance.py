"""Clearance: strands keep two radii and a gap between their centre lines."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from knotfab.effects.base import Effect, EffectContext, Limits, State
from knotfab.geometry.measures import strand_gap
from knotfab.geometry.neighbours import closest_parameters
from knotfab.geometry.polylines import dot

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
    start, edge = state.points.detach().cpu().numpy(), state.edge.detach().cpu().numpy()
    middle = start + 0.5 * edge
    i, j = state.near.i, state.near.j
    apart = middle[i] - middle[j]
    close = dot(apart, apart) < (distance + 1.5 * state.spacing) ** 2
    i, j = i[close], j[close]
    far = state.rings.index_distance(i, j) * state.spacing > 0.5 * np.pi * limits.separation
    i, j = i[far], j[far]
    s, t = closest_parameters(start[i], edge[i], start[j], edge[j])
    device = state.points.device
    rows_i, rows_j = torch.as_tensor(i, device=device), torch.as_tensor(j, device=device)
    at_i, at_j = (
        torch.as_tensor(s, device=device)[:, None],
        torch.as_tensor(t, device=device)[:, None],
    )
    p = state.points[rows_i] + at_i * state.edge[rows_i]
    q = state.points[rows_j] + at_j * state.edge[rows_j]
    gap = ((p - q) ** 2).sum(-1).clamp_min(1e-12).sqrt()
    hinge = ((distance - gap) / limits.radius).clamp_min(0)
    return (hinge * hinge).sum() * (state.spacing / limits.radius)


CLEARANCE = Effect(
    "clearance",
    "mm",
    magnitude,
    lambda s: -2.0 * s.limits.separation,
    "strands run side by side, closer than the flow could carry them together",
    term,
)
