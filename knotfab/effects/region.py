"""Region: the tube, surface included, stays inside a box, cylinder or sphere."""

from __future__ import annotations

import torch
from torch import Tensor

from knotfab.effects.base import Effect, Limits, Situation, State
from knotfab.scene.model import Region

__all__ = ["REGION", "outside"]


def outside(points: Tensor, region: Region, radius: float) -> Tensor:
    """[N] how far a ball of `radius` about each point sticks out, mm (negative inside).

    For a box the largest excess over its faces; cylinder (axis y): over mantle and ends.
    """
    assert not isinstance(region.size_mm, str)
    center = torch.tensor(region.center_mm, dtype=points.dtype, device=points.device)
    half = 0.5 * torch.tensor(region.size_mm, dtype=points.dtype, device=points.device)
    p = points - center
    if region.kind == "box":
        excess: Tensor = (p.abs() - half + radius).amax(-1)
        return excess
    if region.kind == "sphere":
        from_middle: Tensor = p.norm(dim=-1) - half[0] + radius
        return from_middle
    around = (p[:, 0] ** 2 + p[:, 2] ** 2).clamp_min(1e-12).sqrt() - half[0]
    return torch.maximum(around, p[:, 1].abs() - half[1]) + radius


def magnitude(situation: Situation) -> float:
    """How far the tube would stick out, mm, had the flow carried it its usual way further."""
    limits = situation.limits
    start = outside(torch.as_tensor(situation.points), limits.region, limits.radius)
    return float(start.max()) + 2.0 * limits.radius


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of what sticks out, in squared tube radii (paper, occupancy loss)."""
    hinge = (outside(state.points, limits.region, limits.radius * 1.02) / limits.radius).clamp_min(
        0
    )
    return (hinge * hinge).sum() * (state.spacing / limits.radius)


REGION = Effect(
    "region", "mm", magnitude, lambda s: 0.0, "the tube comes near the region's boundary", term
)
