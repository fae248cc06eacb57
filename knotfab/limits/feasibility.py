"""The feasibility of knots: every hard limit measured exactly on the polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.measures import bend_radii, strand_gap
from knotfab.geometry.polylines import Polylines
from knotfab.limits.region import REGION, tube_outside
from knotfab.limits.terms import BEND, CLEARANCE, LENGTH, Guard, Limit, Limits

LEAST = ("bend", "clearance")  # limits that are lower bounds


@dataclass(frozen=True)
class Feasibility:
    """Measured figures and limits. A piece is finished only if every `..._ok` holds."""

    bend_mm: float
    bend_at: Array
    gap_mm: float
    gap_at: Array
    outside_mm: float
    outside_at: Array
    length_mm: float
    limits: Limits

    @property
    def figures(self) -> dict[str, tuple[float, float]]:
        """Each figure with its limit by name, mm; bend and clearance are lower bounds."""
        lim = self.limits
        return {
            "bend": (self.bend_mm, lim.bend_radius),
            "clearance": (self.gap_mm, lim.separation),
            "region": (self.outside_mm, 0.0),
            "length": (self.length_mm, lim.length),
        }

    @property
    def broken(self) -> list[str]:
        """The limits that are violated."""
        return [
            name
            for name, (measured, limit) in self.figures.items()
            if not (measured >= limit if name in LEAST else measured <= limit)
        ]

    @property
    def violations(self) -> list[str]:
        """A sentence for each violated limit, with the place in mm; empty when feasible."""
        lim, out = self.limits, []
        broken = self.broken
        if "bend" in broken:
            out.append(
                f"bend radius {self.bend_mm:.3f} mm is below {lim.bend_radius:.3f} mm at "
                f"{_format_point(self.bend_at)}"
            )
        if "clearance" in broken:
            out.append(
                f"strands come within {self.gap_mm:.3f} mm, {lim.separation:.3f} mm is needed, "
                f"at {_format_point(self.gap_at)}"
            )
        if "region" in broken:
            out.append(
                f"the tube leaves the region by {self.outside_mm:.3f} mm at "
                f"{_format_point(self.outside_at)}"
            )
        if "length" in broken:
            out.append(f"length {self.length_mm:.0f} mm exceeds the budget of {lim.length:.0f} mm")
        return out


def _format_point(point: Array) -> str:
    return "(" + ", ".join(f"{c:.1f}" for c in point) + ") mm"


def measure_feasibility(points: Array, rings: Polylines, limits: Limits) -> Feasibility:
    """Measure every hard limit of the search exactly, on the polygons."""
    bends = bend_radii(points, rings)
    worst_bend = int(np.argmin(bends))
    gap = strand_gap(points, rings, limits.separation, 1.5 * limits.separation)
    tested, out = tube_outside(points, points[rings.next], limits)
    worst_out = int(np.argmax(out))
    length = float(np.linalg.norm(points[rings.next] - points, axis=1).sum())
    return Feasibility(
        float(bends[worst_bend]),
        points[worst_bend],
        gap.gap,
        points[max(gap.i, 0)],
        float(out[worst_out]),
        tested[worst_out],
        length,
        limits,
    )


# The guards of all limits.

LIMITS: tuple[Limit, ...] = (CLEARANCE, BEND, REGION, LENGTH)


def guard_limits() -> dict[str, Guard]:
    """Return a fresh guard for every limit, by name."""
    return {limit.name: Guard(limit) for limit in LIMITS}
