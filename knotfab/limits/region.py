"""Region: the tube, surface included, stays inside a box, cylinder, sphere or closed mesh."""

from __future__ import annotations

from math import hypot

import numpy as np
import torch
from torch import Tensor

from knotfab.arrays import Array
from knotfab.geometry.polylines import Polylines
from knotfab.limits.base import Limit, Limits, State
from knotfab.limits.region_mesh import beyond, region_mesh
from knotfab.render.known import known
from knotfab.scene.camera import view_axes
from knotfab.scene.model import ResolvedRegion

__all__ = ["REGION", "outside", "tube_outside"]


def outside(points: Tensor, region: ResolvedRegion, radius: float) -> Tensor:
    """[N] how far a ball of `radius` about each point sticks out, mm (negative inside).

    For a box the largest excess over its faces; cylinder (its own axis y): over mantle and ends.
    """
    if region.kind == "mesh":
        assert region.file is not None
        return beyond(points, region_mesh(region.file, region.center_mm)) + radius
    center = torch.tensor(region.center_mm, dtype=points.dtype, device=points.device)
    half = 0.5 * torch.tensor(region.size_mm, dtype=points.dtype, device=points.device)
    p = points - center
    if region.azimuth_deg or region.elevation_deg:
        p = p @ torch.as_tensor(view_axes(region).T, dtype=points.dtype, device=points.device)
    if region.kind == "box":
        excess: Tensor = (p.abs() - half + radius).amax(-1)
        return excess
    if region.kind == "sphere":
        from_middle: Tensor = p.norm(dim=-1) - half[0] + radius
        return from_middle
    around = (p[:, 0] ** 2 + p[:, 2] ** 2).clamp_min(1e-12).sqrt() - half[0]
    return torch.maximum(around, p[:, 1].abs() - half[1]) + radius


def tube_outside(
    points: Array, ahead: Array, region: ResolvedRegion, radius: float
) -> tuple[Array, Array]:
    """Points (k, 3) of a centre line, and how far the tube sticks out there at most, mm (k,).

    Convex regions: the vertices `points` (n, 3) decide. Into a tube in a mesh a wall may poke between
    them, so the middles of the edges to `ahead` (n, 3) are measured too. A wall point at distance d
    from an edge of length e is at most sqrt(d² + (e/4)²) from one of these: the radius is enlarged
    so, by 0.6 % at edges of 0.45 radii.
    """
    if region.kind != "mesh":
        return points, outside(torch.as_tensor(points), region, radius).numpy()
    longest = float(np.linalg.norm(ahead - points, axis=1).max())
    some = np.concatenate([points, (points + ahead) / 2])
    return some, outside(torch.as_tensor(some), region, hypot(radius, longest / 4)).numpy()


def term(state: State, limits: Limits) -> Tensor:
    """Squared hinge of what sticks out, in squared tube radii (paper, occupancy loss)."""
    points = state.points.detach().requires_grad_()
    radius = _felt_radius(limits, state.spacing)
    hinge = (outside(points, limits.region, radius) / limits.radius).clamp_min(0)
    total = (hinge * hinge).sum() * (state.spacing / limits.radius)
    (slope,) = torch.autograd.grad(total, points)
    return known(float(total.detach()), (state.points, slope.cpu().numpy()))


def slack(points: Array, rings: Polylines, limits: Limits) -> float:
    """No vertex comes nearer to a boundary than it moves.

    In a mesh the radius grows with the mean edge e as sqrt(r² + (e/2)²), which is at most half as fast as
    e, and e at most twice as fast as vertices move: together they come nearer twice as fast.
    """
    spacing = float(np.linalg.norm(points[rings.next] - points, axis=1).mean())
    radius = _felt_radius(limits, spacing)
    room = -float(outside(torch.as_tensor(points), limits.region, radius).max())
    return room / 2 if limits.region.kind == "mesh" else room


def _felt_radius(limits: Limits, spacing: float) -> float:
    """That of the tube with a margin; into a mesh's tube a wall may poke between two vertices."""
    radius = limits.radius * 1.02
    return hypot(radius, spacing / 2) if limits.region.kind == "mesh" else radius


REGION = Limit("region", term, slack)
