"""Region: the tube, surface included, stays inside a box, cylinder, sphere or mesh, and before walls."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import Polylines
from knotfab.limits.base import Felt, Limit, Limits, State
from knotfab.limits.region_mesh import beyond, region_mesh
from knotfab.scene.camera import Plane, view_axes
from knotfab_formats.scene import SettledRegion

__all__ = ["REGION", "outside", "tube_outside"]


def outside(
    points: Array, region: SettledRegion, radius: float, walls: Sequence[Plane] = ()
) -> tuple[Array, Array]:
    """Measure how far a ball of `radius` about each point sticks out, mm (N,), and the gradient (N, 3).

    `walls` are planes (nx, ny, nz, d), before which n · p + d > 0.
    """
    excess, away = _outside_region(points, region, radius)
    for *normal, offset in walls:
        across = np.array(normal, dtype=points.dtype)
        beyond_wall = radius - (points @ across + offset)
        further = beyond_wall > excess
        excess = np.where(further, beyond_wall, excess)
        away = np.where(further[:, None], -across, away)
    return excess, away


def _outside_region(points: Array, region: SettledRegion, radius: float) -> tuple[Array, Array]:
    """Measure the same as `outside`, for the region alone.

    For a box the largest excess over its faces; cylinder (its own axis y): over mantle and ends. In the
    precision of the points.
    """
    if region.kind == "mesh":
        assert region.file is not None
        excess, away = beyond(points, region_mesh(region.file, region.center_mm))
        return excess + radius, away
    half = np.array([0.5 * side for side in region.size_mm], dtype=points.dtype)
    p, axes = points - np.array(region.center_mm, dtype=points.dtype), None
    if region.azimuth_deg or region.elevation_deg:
        axes = view_axes(region).astype(points.dtype)
        p = p @ axes.T
    slope = np.zeros_like(p)
    rows = np.arange(len(p))
    if region.kind == "box":
        over = np.abs(p) - half
        face = over.argmax(axis=1)
        excess = over[rows, face] + radius
        slope[rows, face] = np.sign(p[rows, face])
    elif region.kind == "sphere":
        length = np.sqrt((p * p).sum(axis=1))
        excess = length - half[0] + radius
        slope = p / np.where(length > 0, length, 1)[:, None]
    else:
        around = np.sqrt(np.maximum(p[:, 0] ** 2 + p[:, 2] ** 2, 1e-12))
        mantle, ends = around - half[0], np.abs(p[:, 1]) - half[1]
        out = mantle >= ends
        excess = np.where(out, mantle, ends) + radius
        slope[:, 0::2] = np.where(out, 1 / around, 0)[:, None] * p[:, 0::2]
        slope[:, 1] = np.where(out, 0, np.sign(p[:, 1]))
    return excess, slope if axes is None else slope @ axes


def tube_outside(points: Array, ahead: Array, limits: Limits) -> tuple[Array, Array]:
    """Return points (k, 3) of a centre line, and how far the tube sticks out there at most, mm (k,).

    Convex regions: the vertices `points` (n, 3) decide. Into a tube in a mesh a wall may poke between
    them, so the middles of the edges to `ahead` (n, 3) are measured too. A wall point at distance d
    from an edge of length e is at most sqrt(d² + (e/4)²) from one of these: the radius is enlarged
    so, by 0.6 % at edges of 0.45 radii.
    """
    if limits.region.kind != "mesh":
        return points, _outside(points, limits, limits.radius)[0]
    longest = float(np.linalg.norm(ahead - points, axis=1).max())
    some = np.concatenate([points, (points + ahead) / 2])
    return some, _outside(some, limits, hypot(limits.radius, longest / 4))[0]


def _outside(points: Array, limits: Limits, radius: float) -> tuple[Array, Array]:
    return outside(points, limits.region, radius, limits.walls)


def term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge of the excess outside, in squared tube radii (paper, occupancy loss)."""
    excess, away = _outside(state.points, limits, _felt_radius(limits, state.spacing))
    hinge = np.maximum(excess / limits.radius, 0.0)
    scale = state.spacing / limits.radius
    slope = (2.0 * scale / limits.radius * hinge)[:, None] * away
    return scale * float(hinge @ hinge), slope


def slack(points: Array, rings: Polylines, limits: Limits) -> float:
    """No vertex comes nearer to a boundary than it moves.

    In a mesh the radius grows with the mean edge e as sqrt(r² + (e/2)²), which is at most half as fast as
    e, and e at most twice as fast as vertices move: together they come nearer twice as fast.
    """
    spacing = float(np.linalg.norm(points[rings.next] - points, axis=1).mean())
    radius = _felt_radius(limits, spacing)
    room = -float(_outside(points, limits, radius)[0].max())
    return room / 2 if limits.region.kind == "mesh" else room


def _felt_radius(limits: Limits, spacing: float) -> float:
    """Return the tube's radius with a margin; a wall may poke into a mesh's tube between two vertices."""
    radius = limits.radius * 1.02
    return hypot(radius, spacing / 2) if limits.region.kind == "mesh" else radius


REGION = Limit("region", term, slack)
