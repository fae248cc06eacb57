"""Where the knots stand against their hard limits, measured exactly on the polygons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.search.neighbours import closest_parameters, find_neighbours
from knotfab.search.polyline import Rings, dot

if TYPE_CHECKING:
    from knotfab.effects.base import Limits

__all__ = ["Standing", "StrandGap", "bend_radii", "standing", "strand_gap"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StrandGap:
    """The closest approach of strands that are not neighbours along the curve."""

    gap: float
    i: int
    j: int


def bend_radii(points: Array, rings: Rings) -> Array:
    """[N] min(adjacent edges) / (2 tan(theta / 2)) at each vertex (Rawdon's MinRad), mm."""
    ahead, behind = points[rings.next] - points, points - points[rings.previous]
    one, two = np.linalg.norm(ahead, axis=1), np.linalg.norm(behind, axis=1)
    cosine = dot(ahead, behind) / (one * two)
    tangent = np.sqrt(np.maximum(1 - cosine, 0) / np.maximum(1 + cosine, 1e-12))
    return np.asarray(np.minimum(one, two) / np.maximum(2 * tangent, 1e-12))


def strand_gap(
    points: Array, rings: Rings, limits: Limits, reach: float, straight: float = np.inf
) -> StrandGap:
    """Least distance of centre lines over pairs further than pi (r + c/2) along the curve.

    With bends no tighter than r + c/2 nearer pairs have no doubly critical chord below 2r + c (Schur),
    so half of this is a lower bound of that part of the polygonal thickness. `reach`: distances
    above it are reported as `reach`. `straight` leaves out pairs whose distance is more than this share of
    the arc between them: they are near because they are neighbours, not because the curve came back.
    """
    edge = points[rings.next] - points
    length = np.linalg.norm(edge, axis=1)
    near = find_neighbours(points, rings, reach + float(length.max()), 2)
    i, j = near.i, near.j
    # arc distance, ring by ring
    before = np.cumsum(length) - 0.5 * length  # to the middle of each segment
    total = np.add.reduceat(length, np.unique(rings.start))[rings.ring]
    along = np.abs(before[i] - before[j])
    along = np.minimum(along, total[i] - along)
    far = (rings.ring[i] != rings.ring[j]) | (along > 0.5 * np.pi * limits.separation)
    i, j = i[far], j[far]
    if len(i) == 0:
        return StrandGap(reach, -1, -1)
    s, t = closest_parameters(points[i], edge[i], points[j], edge[j])
    apart = points[i] + s[:, None] * edge[i] - points[j] - t[:, None] * edge[j]
    gap = np.sqrt(dot(apart, apart))
    if np.isfinite(straight):
        same = rings.ring[i] == rings.ring[j]
        gap = np.where(same & (gap > straight * along[far]), np.inf, gap)
    k = int(np.argmin(gap))
    return StrandGap(min(float(gap[k]), reach), int(i[k]), int(j[k]))


@dataclass(frozen=True)
class Standing:
    """Measured against limits; every `..._ok` holds, or the piece is not finished."""

    bend_mm: float
    bend_at: Array
    gap_mm: float
    gap_at: Array
    outside_mm: float
    outside_at: Array
    length_mm: float
    limits: Limits

    @property
    def broken(self) -> list[str]:
        """The effects whose limits are violated."""
        lim = self.limits
        held = {
            "bend": self.bend_mm >= lim.bend_radius,
            "clearance": self.gap_mm >= lim.separation,
            "region": self.outside_mm <= 0,
            "length": self.length_mm <= lim.length,
        }
        return [name for name, ok in held.items() if not ok]

    @property
    def violations(self) -> list[str]:
        """One sentence a violated limit, with the place in mm; empty when feasible."""
        lim, out = self.limits, []
        broken = self.broken
        if "bend" in broken:
            out.append(
                f"bend radius {self.bend_mm:.3f} mm is below {lim.bend_radius:.3f} mm at "
                f"{_place(self.bend_at)}"
            )
        if "clearance" in broken:
            out.append(
                f"strands come within {self.gap_mm:.3f} mm, {lim.separation:.3f} mm is needed, "
                f"at {_place(self.gap_at)}"
            )
        if "region" in broken:
            out.append(
                f"the tube leaves the region by {self.outside_mm:.3f} mm at "
                f"{_place(self.outside_at)}"
            )
        if "length" in broken:
            out.append(f"length {self.length_mm:.0f} mm exceeds the budget of {lim.length:.0f} mm")
        return out


def _place(point: Array) -> str:
    return "(" + ", ".join(f"{c:.1f}" for c in point) + ") mm"


def standing(points: Array, rings: Rings, limits: Limits) -> Standing:
    """Measure every hard limit of the search on the polygons themselves."""
    from knotfab.effects.region import tube_outside

    bends = bend_radii(points, rings)
    worst_bend = int(np.argmin(bends))
    gap = strand_gap(points, rings, limits, 1.5 * limits.separation)
    tested, out = tube_outside(points, points[rings.next], limits.region, limits.radius)
    worst_out = int(np.argmax(out))
    length = float(np.linalg.norm(points[rings.next] - points, axis=1).sum())
    return Standing(
        float(bends[worst_bend]),
        points[worst_bend],
        gap.gap,
        points[max(gap.i, 0)],
        float(out[worst_out]),
        tested[worst_out],
        length,
        limits,
    )
