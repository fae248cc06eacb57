"""Resampling as a certified step: new vertices, evenly spaced along the curve, by an isotopy."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from knotfab.base.arrays import Array
from knotfab.geometry.certificate import Certificate, certify
from knotfab.geometry.neighbours import find_neighbours
from knotfab.geometry.polylines import Polylines, polylines_of
from knotfab.geometry.sampling import arc_lengths, number_runs

__all__ = ["resample", "subdivide"]

# vertices of a ring: with twelve, the corners of rings about specks and stars come nearer than their sides
_LEAST = 24


def _at(points: Array, parameter: Array, where: Array) -> Array:
    """Return the closed polyline with vertices at `parameter` [n + 1], evaluated at `where`."""
    closed = np.concatenate([points, points[:1]])
    return np.stack([np.interp(where, parameter, closed[:, k]) for k in range(3)], axis=1)


def resample(
    points: Array, rings: Polylines, edge_mm: float
) -> tuple[Array, Polylines, Certificate]:
    """Return even vertices about `edge_mm` apart on the cubic spline through the old ones.

    The straight-line motion from the old polygons to the new, matched by arc length and refined to the
    vertices of both, is certified as an isotopy. Where it is not, the same is tried along the old
    polygons themselves; and where that fails too, they come back with the refusal.
    """
    verdict = Certificate(False, "nothing to resample", -np.inf)
    for smooth in (True, False):
        fresh, old_union, new_union = [], [], []
        for part in rings.split(points):
            new, old_at, new_at = _resample_one(part, edge_mm, smooth)
            fresh.append(new)
            old_union.append(old_at)
            new_union.append(new_at)
        both = polylines_of(old_union)
        start = np.concatenate(old_union)
        step = np.concatenate(new_union) - start
        near = find_neighbours(start, both, 3.0 * edge_mm, 6)
        verdict = certify(start, step, both, near)
        if verdict.valid:
            return np.concatenate(fresh), polylines_of(fresh), verdict
    return points, rings, verdict


def _resample_one(part: Array, edge_mm: float, smooth: bool) -> tuple[Array, Array, Array]:
    """Return one ring resampled: new vertices, and old and new positions at the vertices of both."""
    arc = arc_lengths(part)
    count = max(_LEAST, round(arc[-1] / edge_mm))
    where = np.linspace(0.0, arc[-1], count + 1)
    if smooth:
        spline = CubicSpline(arc, np.concatenate([part, part[:1]]), bc_type="periodic")
        # places become even in the new polygon's own length, not only in the old one's
        for _ in range(2):
            at = arc_lengths(spline(where[:-1]))
            where = np.interp(np.linspace(0.0, at[-1], count + 1), at, where)
        fresh = np.asarray(spline(where[:-1]))
    else:
        fresh = _at(part, arc, where[:-1])
    union = np.unique(np.concatenate([arc[:-1], where[:-1]]))
    union = union[np.diff(union, append=arc[-1]) > 1e-6 * arc[-1] / count]
    return fresh, _at(part, arc, union), _at(fresh, where, union)


def subdivide(points: Array, rings: Polylines, edge_mm: float) -> tuple[Array, Polylines]:
    """Return new vertices on edges that are longer than `edge_mm`: the same curves, so nothing to certify."""
    fresh = []
    for part in rings.split(points):
        edge = np.roll(part, -1, axis=0) - part
        pieces = np.maximum(1, np.round(np.linalg.norm(edge, axis=1) / edge_mm)).astype(int)
        first, number = number_runs(pieces)
        share = number / pieces[first]
        fresh.append(part[first] + share[:, None] * edge[first])
    return np.concatenate(fresh), polylines_of(fresh)
