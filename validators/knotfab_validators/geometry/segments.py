"""Distances between points and straight segments, and between segments, row by row."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array

__all__ = ["nearest_on_segment", "nearest_on_two", "point_segment", "segment_segment"]


def nearest_on_segment(points: Array, start: Array, end: Array) -> Array:
    """Return the nearest point (n, 3) of each segment to a point (n, 3); a segment may have no length."""
    span = end - start
    square = np.einsum("ij,ij->i", span, span)
    along = np.einsum("ij,ij->i", points - start, span) / np.where(square > 0, square, 1.0)
    return np.asarray(start + along.clip(0.0, 1.0)[:, None] * span)


def point_segment(points: Array, start: Array, end: Array) -> Array:
    """Return distances (n,) of points (n, 3) from segments."""
    return _length(points - nearest_on_segment(points, start, end))


def nearest_on_two(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Return the nearest points (n, 3) of the segments a b and c d (Ericson, "Real-time collision detection",
    2005, 5.1.9). Of parallel ones some pair of nearest points, up to rounding.
    """
    u, v, w = b - a, d - c, c - a
    uu, vv, uv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    det = uu * vv - uv * uv
    s = ((uw * vv - vw * uv) / np.where(det > 0, det, np.inf)).clip(0.0, 1.0)
    t = ((s * uv - vw) / np.where(vv > 0, vv, 1.0)).clip(0.0, 1.0)
    s = ((t * uv + uw) / np.where(uu > 0, uu, 1.0)).clip(0.0, 1.0)
    return a + s[:, None] * u, c + t[:, None] * v


def segment_segment(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return distances (n,) between segments a b and c d: inside to inside, or at an end.

    The ends are measured too, for rounding moves the nearest points of nearly parallel segments.
    """
    p, q = nearest_on_two(a, b, c, d)
    ends = ((a, c, d), (b, c, d), (c, a, b), (d, a, b))
    return np.asarray(np.min([_length(p - q), *(point_segment(*end) for end in ends)], axis=0))


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))
