"""Carrying a knot from one picture to the next along a smooth displacement, every step certified."""

from __future__ import annotations

import numpy as np
from shapely import MultiPolygon

from knotfab.arrays import Array
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines
from knotfab.sequence.registration import register

__all__ = ["transport"]


_LONGEST = 0.5  # tube radii that a vertex goes in one step
_SHORTEST = 1e-3  # of the way


def transport(
    points: Array,
    rings: Polylines,
    old: MultiPolygon,
    new: MultiPolygon,
    light_mm: float,
    radius: float,
    furthest_mm: float,
) -> Carried:
    """Move the vertices (N, 3) along their rays' displacement from silhouette `old` to `new`.

    A vertex keeps its depth; seen from the light it moves as the plane z = 0 does. Where no step is short
    enough to be certified the way ends there, and the flow goes on.

    Args:
        light_mm: of the light from the middle of the piece.
        furthest_mm: no vertex goes further than this.
    """
    shrink = (1.0 - points[:, 2] / light_mm)[:, None]
    shift = register(old, new, 6.0 * radius).at(points[:, :2] / shrink) * shrink
    length = np.linalg.norm(shift, axis=1)
    shift *= np.minimum(1.0, furthest_mm / np.maximum(length, 1e-12))[:, None]
    whole = np.column_stack([shift, np.zeros(len(points))])
    return carry(
        points, rings, lambda at, share: points + share * whole, _LONGEST * radius, _SHORTEST
    )
