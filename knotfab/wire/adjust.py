"""Move corners so that a wire keeps to its limits, and measure how far it misses them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from knotfab.base.arrays import Array, Indices
from knotfab.wire.arcs import WireSites, round_corners
from knotfab.wire.likeness import GridLikeness
from knotfab.wire.residual import (
    FitLimits,
    Strand,
    compute_residual,
    measure_distances,
    measure_gaps,
    measure_strays,
)

__all__ = [
    "ROUNDING",
    "Fault",
    "adjust",
    "in_order",
    "judge",
    "measure_misses",
    "measure_worst",
    "settle",
]


Fault = tuple[float, float, float]  # see `judge`
ROUNDING = 0.01  # mm or degrees: what is no fault


def adjust(
    strands: list[Strand],
    light: Array | None,
    limits: FitLimits,
    steps: int,
    pictures: Sequence[GridLikeness] = (),
) -> None:
    """Move the corners of all strands by Levenberg-Marquardt steps; numbers of corners stay.

    Towards the curves; with `pictures` to where the wires draw these, within the tolerance of the curves.
    Where the work of the limits is over they stay where they are.
    """
    weights = [np.ones(len(s.points)) for s in strands]
    damping = 1e-2
    for number in range(steps):
        corners = [s.corners for s in strands]
        if number % 3 == 0 and not pictures:
            _reweight(strands, weights, light, limits)
        residual, jacobian = compute_residual(
            strands, corners, weights, light, limits, True, pictures
        )
        assert jacobian is not None
        normal, slope = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
        size, cost = normal.diagonal().mean(), float(residual @ residual)
        for _ in range(6):
            if limits.work.over:
                return
            limits.work.points -= sum(len(s.points) for s in strands)
            step = spsolve(normal + damping * size * sparse.eye(len(slope), format="csc"), -slope)
            tried, begun = [], 0
            for strand in strands:
                move = step[begun : begun + 3 * len(strand.corners)].reshape(-1, 3)
                begun += 3 * len(strand.corners)
                tried.append(strand.corners + move)
            after, _ = compute_residual(strands, tried, weights, light, limits, False, pictures)
            if np.isfinite(after).all() and float(after @ after) < cost:
                for strand, moved in zip(strands, tried, strict=True):
                    strand.corners = moved
                damping = max(damping / 5.0, 1e-6)
                break
            damping *= 5.0


def _reweight(
    strands: list[Strand],
    weights: list[Array],
    light: Array | None,
    limits: FitLimits,
) -> None:
    """Give more weight where the distance is large: towards the smallest maximum (Lawson 1961)."""
    for number, strand in enumerate(strands):
        wire = round_corners(strand.corners, limits.bend_radius_mm)
        _, size = measure_distances(strand, wire, light)
        weight = weights[number] * np.sqrt(0.05 + np.minimum(size, 3.0))
        weights[number] = np.clip(weight / weight.mean(), 0.05, 20.0)


def measure_misses(strands: list[Strand], light: Array | None, limits: FitLimits) -> list[Array]:
    """Measure (m, 4) for each strand: by how much its bend and straight j miss each limit; below 0: kept.

    In columns: distance beyond the tolerance (share of it), length that the straight lacks (mm), angle
    that the bend turns too far (degrees), how much nearer than a diameter another strand is (mm).
    """
    wires = [round_corners(s.corners, limits.bend_radius_mm) for s in strands]
    found = []
    for strand, wire, gap in zip(strands, wires, measure_gaps(wires, limits), strict=True):
        sites, size = measure_distances(strand, wire, light)
        far = np.full(len(wire.corners), -1.0)
        np.maximum.at(far, sites.piece, size - 1.0)
        sites, offset, _ = measure_strays(strand, wire, light, limits)
        np.maximum.at(far, sites.piece, np.linalg.norm(offset, axis=1) - 1.0)
        short = limits.min_straight_mm - wire.straight
        sharp = np.rad2deg(wire.turn) - limits.max_bend_deg
        found.append(np.column_stack([far, short, sharp, limits.wire_diameter_mm - gap]))
    return found


def measure_worst(strands: list[Strand], light: Array | None, limits: FitLimits) -> Array:
    """Return by how much each limit is missed at most (4,), as `measure_misses`; 0 where it is kept."""
    return np.asarray(np.vstack(measure_misses(strands, light, limits)).max(axis=0).clip(0.0))


def judge(strands: list[Strand], light: Array | None, limits: FitLimits) -> Fault:
    """Measure how far the limits are missed: in all; by straights, bends, contacts (mm, deg); count bends."""
    excess, *rest = measure_worst(strands, light, limits)
    late = max(rest) if max(rest) > ROUNDING else 0.0
    bends = sum(len(s.corners) for s in strands)
    return round(float(late + excess), 2), round(float(late), 2), float(bends)


def settle(strand: Strand, limits: FitLimits) -> None:
    """Name anew the point of the curve that each corner stands for: the nearest to its bend."""
    wire = round_corners(strand.corners, limits.bend_radius_mm)
    m, n = len(strand.corners), len(strand.points)
    middle = wire.at(WireSites(np.arange(m), np.ones(m, dtype=bool), np.full(m, 0.5)))
    left, right = np.roll(strand.index, 1), np.roll(strand.index, -1)
    found = np.empty(m, dtype=np.int64)
    for j in range(m):
        span = int((right[j] - left[j]) % n)
        window = (left[j] + 1 + np.arange(max(span - 1, 1))) % n
        gap = strand.points[window] - middle[j]
        found[j] = window[int((gap * gap).sum(axis=1).argmin())]
    # the old names stay where a bend was found before the one it follows
    if (np.diff((found - found[0]) % n) > 0).all():
        strand.corners, strand.index = in_order(strand.corners, found, n)


def in_order(corners: Array, index: Indices, n: int) -> tuple[Array, Indices]:
    """Return corners in the wire's order from the curve's first point on, each with a point of its own."""
    rising = (index - index[0]) % n
    for k in range(1, len(rising)):
        rising[k] = max(rising[k], rising[k - 1] + 1)
    for k in range(len(rising) - 1, 0, -1):
        rising[k] = min(rising[k], n - len(rising) + k)
    named = (rising + index[0]) % n
    shift = int(named.argmin())
    return np.roll(corners, -shift, axis=0), np.roll(named, -shift)
