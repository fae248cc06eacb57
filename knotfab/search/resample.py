"""Resampling as a certified step: new vertices, evenly spaced along the curve, by an isotopy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from knotfab.search.certificate import Certificate, certify
from knotfab.search.neighbours import find_neighbours
from knotfab.search.polyline import Rings, rings_of_sizes

__all__ = ["resample"]

Array = NDArray[np.float64]


def _arc(points: Array) -> Array:
    """[n + 1] arc length at each vertex of a closed polyline, the closing one included."""
    edges = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    return np.concatenate([[0.0], np.cumsum(edges)])


def _at(points: Array, parameter: Array, where: Array) -> Array:
    """The closed polyline with vertices at `parameter` [n + 1], evaluated at `where`."""
    closed = np.concatenate([points, points[:1]])
    return np.stack([np.interp(where, parameter, closed[:, k]) for k in range(3)], axis=1)


def resample(points: Array, rings: Rings, edge_mm: float) -> tuple[Array, Rings, Certificate]:
    """Even vertices about `edge_mm` apart on the cubic spline through the old ones.

    The straight-line motion from the old polygons to the new, matched by arc length and refined to the
    vertices of both, is certified as an isotopy; when it is not, the old polygons come back
    with the refusal.
    """
    new, old_union, new_union = [], [], []
    for part in rings.split(points):
        arc = _arc(part)
        spline = CubicSpline(arc, np.concatenate([part, part[:1]]), bc_type="periodic")
        count = max(12, round(arc[-1] / edge_mm))
        where = np.linspace(0.0, arc[-1], count + 1)
        # even in the new polygon's own length, not only in the old one's
        for _ in range(2):
            at = _arc(spline(where[:-1]))
            where = np.interp(np.linspace(0.0, at[-1], count + 1), at, where)
        fresh = spline(where[:-1])
        union = np.unique(np.concatenate([arc[:-1], where[:-1]]))
        union = union[np.diff(union, append=arc[-1]) > 1e-6 * arc[-1] / count]
        new.append(fresh)
        old_union.append(_at(part, arc, union))
        new_union.append(_at(fresh, where, union))
    both = rings_of_sizes(tuple(len(u) for u in old_union))
    start = np.concatenate(old_union)
    step = np.concatenate(new_union) - start
    near = find_neighbours(start, both, 3.0 * edge_mm, 6)
    verdict = certify(start, step, both, near)
    if not verdict.valid:
        return points, rings, verdict
    return np.concatenate(new), rings_of_sizes(tuple(len(p) for p in new)), verdict
