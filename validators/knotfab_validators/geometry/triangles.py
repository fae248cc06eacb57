"""Distances between triangles, of triangles from points, and whether triangles cross."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.geometry.segments import nearest_on_segment
from knotfab_validators.geometry.triangle_loops import nearest_of_two

__all__ = ["point_triangle", "triangle_triangle", "triangles_cross"]


def point_triangle(point: Array, triangle: Array) -> tuple[Array, Array]:
    """Return distances (n,) and nearest points (n, 3) of triangles (n, 3, 3) to points (n, 3)."""
    inner, foot = _inside(point, triangle)
    best, near = inner, foot
    for k in range(3):
        at = nearest_on_segment(point, triangle[:, k], triangle[:, (k + 1) % 3])
        best, near = _nearer(best, near, _length(point - at), at)
    return best, near


def triangle_triangle(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return distances (n,) and the nearest points (n, 3) of each of two lists of triangles (n, 3, 3).

    The nearest points of two triangles that do not cross are a corner and a point inside the
    other, or lie on two edges: all 6 + 9 cases are computed.
    """
    return nearest_of_two(
        np.ascontiguousarray(first, dtype=np.float64),
        np.ascontiguousarray(second, dtype=np.float64),
    )


def triangles_cross(first: Array, second: Array) -> Mask:
    """Tell whether triangles (n, 3, 3) cross (n,), up to rounding; coplanar ones are not said to.

    An edge crosses a triangle if its ends lie on different sides of the plane, and the edge passes
    the three sides of the triangle on the same hand (signs of volumes of tetrahedra).
    """
    crossed = np.zeros(len(first), dtype=np.bool_)
    for one, other in ((first, second), (second, first)):
        a, b, c = other[:, 0], other[:, 1], other[:, 2]
        normal = np.cross(b - a, c - a)
        side = np.einsum("ikj,ij->ik", one - a[:, None], normal)
        for k in range(3):
            p, q = one[:, k], one[:, (k + 1) % 3]
            split = np.flatnonzero(side[:, k] * side[:, (k + 1) % 3] < 0)
            if not len(split):
                continue
            p, q = p[split], q[split]
            hands = [
                np.einsum("ij,ij->i", q - p, np.cross(x[split] - p, y[split] - p))
                for x, y in ((a, b), (b, c), (c, a))
            ]
            within = (np.min(hands, axis=0) >= 0) | (np.max(hands, axis=0) <= 0)
            crossed[split] |= within
    return crossed


def _inside(point: Array, triangle: Array) -> tuple[Array, Array]:
    """Return the distance to the triangle's plane where the foot lies inside it, else infinity; the foot."""
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


def _nearer(best: Array, near: Array, distance: Array, at: Array) -> tuple[Array, Array]:
    less = distance < best
    return np.where(less, distance, best), np.where(less[:, None], at, near)


def _length(v: Array) -> Array:
    length: Array = np.sqrt(np.einsum("ij,ij->i", v, v))
    return length
