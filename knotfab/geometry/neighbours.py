"""Find the segments near each other: pairs from a KD-tree, kept valid while vertices move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.kernels import closest_parameters
from knotfab.geometry.polylines import Polylines, dot

__all__ = ["Neighbours", "find_neighbours", "segment_distance"]


@dataclass(frozen=True)
class Neighbours:
    """Segment pairs (i -> i+1, j -> j+1), i < j, whose middles were within `reach` at `points`."""

    i: Indices
    j: Indices
    reach: float
    points: Array
    skip: int  # pairs closer than this many steps along the curve are left out

    def moved(self, points: Array) -> float:
        """Return the largest distance a vertex has gone since the pairs were found."""
        return float(np.sqrt(dot(points - self.points, points - self.points).max()))


def find_neighbours(points: Array, rings: Polylines, reach: float, skip: int) -> Neighbours:
    """Find all segment pairs with middles within `reach` and at least `skip` steps apart."""
    middle = 0.5 * (points + points[rings.next])
    pairs = cKDTree(middle).query_pairs(reach, output_type="ndarray").astype(np.int64)
    i, j = pairs[:, 0], pairs[:, 1]
    keep = rings.index_distance(i, j) >= skip
    return Neighbours(i[keep], j[keep], reach, points.copy(), skip)


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return [M] distance between the segments a-b and c-d, [M, 3] each, none of them without length."""
    s, t = closest_parameters(a, b - a, c, d - c)
    gap = a + s[:, None] * (b - a) - c - t[:, None] * (d - c)
    return np.asarray(np.linalg.norm(gap, axis=1))
