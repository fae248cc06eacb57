"""Distances between triangles that do not cross, and between points and triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["point_triangle", "triangle_triangle"]

Array = NDArray[np.float64]


def point_triangle(point: Array, triangle: Array) -> tuple[Array, Array]:
    """Distances (n,) and nearest points (n, 3) of triangles (n, 3, 3) to points (n, 3)."""
    inner, foot = _inside(point, triangle)
    best, near = inner, foot
    for k in range(3):
        a, b = triangle[:, k], triangle[:, (k + 1) % 3]
        edge = b - a
        square = np.einsum("ij,ij->i", edge, edge)
        t = np.einsum("ij,ij->i", point - a, edge) / np.where(square > 0, square, 1.0)
        at = a + t.clip(0.0, 1.0)[:, None] * edge
        best, near = _nearer(best, near, _length(point - at), at)
    return best, near


def triangle_triangle(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Distances (n,) and the nearest points (n, 3) of each of two lists of triangles (n, 3, 3).

    The nearest points of two triangles that do not cross are a corner and a point inside the
    other, or lie on two edges: all 6 + 9 cases are computed.
    """
    best = np.full(len(first), np.inf)
    p, q = first[:, 0].copy(), second[:, 0].copy()
    for k in range(3):
        for one, other, swapped in ((first, second, False), (second, first, True)):
            distance, foot = _inside(one[:, k], other)
            here, there = (foot, one[:, k]) if swapped else (one[:, k], foot)
            less = distance < best
            best = np.where(less, distance, best)
            p = np.where(less[:, None], here, p)
            q = np.where(less[:, None], there, q)
    for i in range(3):
        for j in range(3):
            a, b = _segments(
                first[:, i], first[:, (i + 1) % 3], second[:, j], second[:, (j + 1) % 3]
            )
            distance = _length(a - b)
            less = distance < best
            best = np.where(less, distance, best)
            p = np.where(less[:, None], a, p)
            q = np.where(less[:, None], b, q)
    return best, p, q


def _inside(point: Array, triangle: Array) -> tuple[Array, Array]:
    """Distance to the triangle's plane where the foot lies inside it, else infinity; the foot."""
    a, u, v = triangle[:, 0], triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    normal = np.cross(u, v)
    square = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(square > 0, square, 1.0)
    w = point - a
    s = np.einsum("ij,ij->i", np.cross(w, v), normal) / safe
    t = np.einsum("ij,ij->i", np.cross(u, w), normal) / safe
    height = np.einsum("ij,ij->i", w, normal) / safe
    foot = point - height[:, None] * normal
    inside = (square > 0) & (s >= 0) & (t >= 0) & (s + t <= 1)
    return np.where(inside, np.abs(height) * np.sqrt(safe), np.inf), foot


def _segments(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Nearest points (n, 3) of the segments a b and c d."""
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    parallel = uu * vv - uv * uv
    skew = parallel > 1e-14 * uu * vv
    s = np.where(skew, (uv * vw - vv * uw) / np.where(skew, parallel, 1.0), 0.0).clip(0.0, 1.0)
    t = ((uv * s + vw) / np.where(vv > 0, vv, 1.0)).clip(0.0, 1.0)
    s = ((uv * t - uw) / np.where(uu > 0, uu, 1.0)).clip(0.0, 1.0)
    return a + s[:, None] * u, c + t[:, None] * v


def _nearer(best: Array, near: Array, distance: Array, at: Array) -> tuple[Array, Array]:
    less = distance < best
    return np.where(less, distance, best), np.where(less[:, None], at, near)


def _length(v: Array) -> Array:
    length: Array = np.sqrt(np.einsum("ij,ij->i", v, v))
    return length
