"""Certificates of isotopy: a straight-line motion of all vertices that provably crosses nothing.

Two segments whose end points move by da0, da1 and db0, db1 cannot meet if every relative displacement
|da - db| stays below their distance, because the relative displacement of any two of their points is a
convex combination of those of their ends. Adjacent segments share an end, and cannot overlap as
long as both keep a positive component along one direction throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry import kernels
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Polylines

__all__ = ["Certificate", "certify", "step_limits"]

_ROUNDING = 1e-13  # a share of the coordinates by which double precision may be off


@dataclass(frozen=True)
class Certificate:
    """The verdict on one step: `margin` is the least (distance - relative displacement), mm."""

    valid: bool
    reason: str
    margin: float


def certify(points: Array, step: Array, rings: Polylines, near: Neighbours) -> Certificate:
    """Tell whether moving `points` (N, 3) by `step` along straight lines keeps the knot type.

    `near` may be older than `points`: what it leaves out is covered by a bound on the motion since.
    """
    if not np.isfinite(step).all():
        return Certificate(False, "the step is not finite", -np.inf)
    room = near.reach - 2 * near.moved(points)
    lists = (rings.next, rings.start, rings.size, near.i, near.j)
    found, margin = kernels.step_margin(points, step, *lists, near.skip, room)
    if found == kernels.FOLDS:
        return Certificate(False, "adjacent segments may fold back", margin)
    if found == kernels.TOO_OLD:
        return Certificate(False, "the neighbour list is too old", margin)
    # the error of double precision follows the size of the coordinates
    if not margin > _ROUNDING * float(np.abs(points).max()):
        return Certificate(False, "strands may pass through each other", margin)
    return Certificate(True, "isotopy", margin)


def step_limits(points: Array, rings: Polylines, near: Neighbours, largest: float) -> Array:
    """Return [N] how far each vertex may go so that strands in `near` cannot meet: 0.45 of their gap."""
    return 0.45 * kernels.step_limits(points, rings.next, near.i, near.j, largest / 0.45)
