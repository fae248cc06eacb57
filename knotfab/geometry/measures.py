"""Measures of closed polylines: neighbouring segments, distances between strands, bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.kernels import closest_parameters, least_gap
from knotfab.geometry.polylines import Polylines, dot
from knotfab_formats.libraries import took_part


@dataclass(frozen=True)
class Neighbours:
    """Pairs of segments (i -> i+1, j -> j+1), i < j, with midpoints within `reach` at `points`."""

    i: Indices
    j: Indices
    reach: float
    points: Array
    skip: int  # pairs closer than this many steps along the curve are left out

    def moved(self, points: Array) -> float:
        """Return the largest distance that a vertex has moved since the pairs were found."""
        way = points - self.points
        return float(np.sqrt(dot(way, way).max()))


def find_neighbours(points: Array, rings: Polylines, reach: float, skip: int) -> Neighbours:
    """Find all pairs of segments with midpoints within `reach`, at least `skip` steps apart."""
    middle = 0.5 * (points + points[rings.next])
    took_part("scipy", "found the strands that are near each other")
    pairs = cKDTree(middle).query_pairs(reach, output_type="ndarray").astype(np.int64)
    i, j = pairs[:, 0], pairs[:, 1]
    keep = rings.index_distance(i, j) >= skip
    return Neighbours(i[keep], j[keep], reach, points.copy(), skip)


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the distances [M] between segments a-b and c-d, [M, 3] each, all of positive length."""
    s, t = closest_parameters(a, b - a, c, d - c)
    gap = a + s[:, None] * (b - a) - c - t[:, None] * (d - c)
    return np.asarray(np.linalg.norm(gap, axis=1))


@dataclass(frozen=True)
class StrandGap:
    """The closest approach of strands that are not neighbours along the curve."""

    gap: float
    i: int
    j: int


def bend_radii(points: Array, rings: Polylines) -> Array:
    """Return each vertex's bend radius (Rawdon's MinRad), min(edges) / (2 tan(theta / 2)), mm, [N]."""
    ahead, behind = points[rings.next] - points, points - points[rings.previous]
    one, two = np.linalg.norm(ahead, axis=1), np.linalg.norm(behind, axis=1)
    cosine = dot(ahead, behind) / (one * two)
    tangent = np.sqrt(np.maximum(1 - cosine, 0) / np.maximum(1 + cosine, 1e-12))
    return np.asarray(np.minimum(one, two) / np.maximum(2 * tangent, 1e-12))


def strand_gap(
    points: Array, rings: Polylines, separation: float, reach: float, straight: float = np.inf
) -> StrandGap:
    """Return the least distance of centre lines over pairs further than pi (r + c/2) along the curve.

    With bends no tighter than r + c/2 nearer pairs have no doubly critical chord below 2r + c (Schur),
    so half of this is a lower bound of that part of the polygonal thickness. `reach`: distances
    above it are reported as `reach`. `straight` leaves out pairs whose distance is more than this share of
    the arc between them: they are near because they are neighbours, not because the curve came back.
    """
    edge = points[rings.next] - points
    length = np.linalg.norm(edge, axis=1)
    # arc distance, ring by ring
    before = np.cumsum(length) - 0.5 * length  # the way to the middle of each segment
    total = np.add.reduceat(length, np.unique(rings.start))[rings.ring]
    longest, within = float(length.max()), min(1.2 * separation, reach)
    while True:
        # a gap found within a short distance is the least of all, and strands are mostly close somewhere
        near = find_neighbours(points, rings, within + longest, 2)
        lists = (rings.next, rings.start, near.i, near.j, before, total)
        gap, pair = least_gap(points, *lists, 0.5 * np.pi * separation, straight)
        if gap <= within or within >= reach:
            break
        within = min(2 * within, reach)
    if pair < 0:
        return StrandGap(reach, -1, -1)
    return StrandGap(min(gap, reach), int(near.i[pair]), int(near.j[pair]))


@dataclass(frozen=True)
class Curvature:
    """The bending of a closed polyline: curvature times the tube's radius along it, and total turns."""

    mean: float
    quantile_90: float
    turns: float  # total turning angle over a full turn


def measure_curvature(points: Array, radius: float) -> Curvature:
    """Measure a closed polyline's curvature (n, 3): turning angle over mean edge length at each vertex."""
    ahead = np.roll(points, -1, axis=0) - points
    length = np.linalg.norm(ahead, axis=1)
    unit = ahead / length[:, None]
    behind, before = np.roll(unit, 1, axis=0), np.roll(length, 1)
    # arctan2 keeps its digits where edges are nearly in line
    sine = np.linalg.norm(np.cross(behind, unit), axis=1)
    angle = np.arctan2(sine, dot(behind, unit))
    share = 0.5 * (length + before)
    curvature = radius * angle / share
    order = np.argsort(curvature)
    along = np.cumsum(share[order]) / share.sum()
    ninety = float(curvature[order][np.searchsorted(along, 0.9)])
    total = float(angle.sum())
    return Curvature(radius * total / float(share.sum()), ninety, total / (2 * np.pi))
