"""Carrying a knot from one picture to the next along a smooth displacement, every step certified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines
from knotfab.sequence.motion import pair_pieces
from knotfab.sequence.registration import register

__all__ = ["transport"]


_LONGEST = 0.5  # tube radii that a vertex goes in one step
_SHORTEST = 1e-3  # the shortest step, as a share of the way


def _pairs_of(
    rings: Sequence[Array], old: MultiPolygon, new: MultiPolygon
) -> list[tuple[MultiPolygon, MultiPolygon]]:
    """Pair what each ring (n, 2) draws of `old` and is to draw of `new`: a piece each, or the whole."""
    pairs = pair_pieces(old, new, len(rings))
    if len(pairs) == 1:
        return pairs * len(rings)
    points = [shapely.points(ring) for ring in rings]
    away = [[float(shapely.distance(piece, at).mean()) for piece, _ in pairs] for at in points]
    _, drawn = linear_sum_assignment(away)
    return [pairs[k] for k in drawn]


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

    Of several knots each goes with its own piece. A vertex keeps its depth; seen from the light it moves as
    the plane z = 0 does. Where no step is short enough to be certified the way ends there, and the flow
    goes on.

    Args:
        light_mm: distance of the light from the middle of the piece.
        furthest_mm: no vertex goes further than this.
    """
    shrink = (1.0 - points[:, 2] / light_mm)[:, None]
    seen = rings.split(points[:, :2] / shrink)
    pairs = _pairs_of(seen, old, new)
    moved = [register(*p, 6.0 * radius).at(s) for s, p in zip(seen, pairs, strict=True)]
    shift = np.concatenate(moved) * shrink
    length = np.linalg.norm(shift, axis=1)
    shift *= np.minimum(1.0, furthest_mm / np.maximum(length, 1e-12))[:, None]
    whole = np.column_stack([shift, np.zeros(len(points))])
    return carry(
        points, rings, lambda at, share: points + share * whole, _LONGEST * radius, _SHORTEST
    )
