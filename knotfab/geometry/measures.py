"""Exact measures of closed polylines: how tightly they bend, and how near strands come to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.kernels import least_gap
from knotfab.geometry.neighbours import find_neighbours
from knotfab.geometry.polylines import Polylines, dot

__all__ = ["Curvature", "StrandGap", "bend_radii", "measure_curvature", "strand_gap"]


@dataclass(frozen=True)
class StrandGap:
    """The closest approach of strands that are not neighbours along the curve."""

    gap: float
    i: int
    j: int


def bend_radii(points: Array, rings: Polylines) -> Array:
    """Return [N] min(adjacent edges) / (2 tan(theta / 2)) at each vertex (Rawdon's MinRad), mm."""
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
        # a gap found within a distance is the least of all; most often strands are close somewhere
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
    """The bending of a closed polyline: curvature times the tube's radius along its length, and its turns."""

    mean: float
    quantile_90: float
    turns: float  # total turning angle over a full turn


def measure_curvature(points: Array, radius: float) -> Curvature:
    """Measure the curvature of a closed polyline (n, 3): at a vertex, turning angle over its mean edge."""
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
