"""Distances from triangles to points and to each other, and whether triangles cross."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.curves import nearest_on_segment


def point_triangle(point: Array, triangle: Array) -> tuple[Array, Array]:
    """Return the distances (n,) from points (n, 3) to triangles (n, 3, 3), and the nearest points (n, 3)."""
    inner, foot = _plane_distance(point, triangle)
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
    """Return which pairs of triangles (n, 3, 3) cross, up to rounding; coplanar ones count as not crossing.

    An edge crosses a triangle if its ends lie on different sides of the plane, and it passes the three sides
    of the triangle on the same hand (by the signs of tetrahedra's volumes).
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


def _plane_distance(point: Array, triangle: Array) -> tuple[Array, Array]:
    """Return the distance to the triangle's plane if the foot lies inside it, else infinity; and the foot."""
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


# Compiled loops over triangles and segments, whose points are tuples of three numbers.

Triple = tuple[float, float, float]


@compiled
def _corner_of(rows: Array, k: int) -> Triple:
    return rows[k, 0], rows[k, 1], rows[k, 2]


@compiled
def _corners_of(rows: Array) -> tuple[Triple, Triple, Triple]:
    # numba would compile `_corner_of` for each number that is written out
    return (
        (rows[0, 0], rows[0, 1], rows[0, 2]),
        (rows[1, 0], rows[1, 1], rows[1, 2]),
        (rows[2, 0], rows[2, 1], rows[2, 2]),
    )


@compiled
def _minus(p: Triple, q: Triple) -> Triple:
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


@compiled
def _dot(p: Triple, q: Triple) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@compiled
def _cross(p: Triple, q: Triple) -> Triple:
    return (p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0])


@compiled
def _step(p: Triple, far: float, along: Triple) -> Triple:
    return p[0] + far * along[0], p[1] + far * along[1], p[2] + far * along[2]


@compiled
def _from_segment(p: Triple, a: Triple, b: Triple) -> float:
    """Return the distance of p from the segment ab, as `point_segment` does."""
    span = _minus(b, a)
    square = _dot(span, span)
    along = _dot(_minus(p, a), span) / (square if square > 0.0 else 1.0)
    gap = _minus(p, _step(a, min(max(along, 0.0), 1.0), span))
    return float(_dot(gap, gap) ** 0.5)


@compiled
def _nearest_parameters(u: Triple, v: Triple, w: Triple) -> tuple[float, float]:
    """Find s and t in [0, 1] where s u and w + t v are nearest, as `nearest_on_two` does."""
    uu, vv, uv, uw, vw = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, w), _dot(v, w)
    det = uu * vv - uv * uv
    s = min(max((uw * vv - vw * uv) / det, 0.0), 1.0) if det > 0.0 else 0.0
    t = min(max((s * uv - vw) / (vv if vv > 0.0 else 1.0), 0.0), 1.0)
    s = min(max((t * uv + uw) / (uu if uu > 0.0 else 1.0), 0.0), 1.0)
    return s, t


@compiled
def nearest_of_two(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return the distances of pairs of triangles (n, 3, 3), and the nearest points (n, 3) of each."""
    count = len(first)
    distance, near = np.empty(count), np.empty((2, count, 3))
    for k in range(count):
        best = np.inf
        here, there = _corners_of(first[k])[0], _corners_of(second[k])[0]
        for side in range(2):
            one, other = (first[k], second[k]) if side == 0 else (second[k], first[k])
            a, b, c = _corners_of(other)
            u, v = _minus(b, a), _minus(c, a)
            normal = _cross(u, v)
            square = _dot(normal, normal)
            if not square > 0.0:
                continue
            for point in _corners_of(one):
                w = _minus(point, a)
                s, t = _dot(_cross(w, v), normal) / square, _dot(_cross(u, w), normal) / square
                height = _dot(w, normal) / square
                if s >= 0.0 and t >= 0.0 and s + t <= 1.0 and abs(height) * square**0.5 < best:
                    best, foot = abs(height) * square**0.5, _step(point, -height, normal)
                    here, there = (point, foot) if side == 0 else (foot, point)
        for i in range(3):
            a = _corner_of(first[k], i)
            u = _minus(_corner_of(first[k], (i + 1) % 3), a)
            for j in range(3):
                b = _corner_of(second[k], j)
                v = _minus(_corner_of(second[k], (j + 1) % 3), b)
                s, t = _nearest_parameters(u, v, _minus(b, a))
                on_one, on_other = _step(a, s, u), _step(b, t, v)
                gap = _minus(on_one, on_other)
                if _dot(gap, gap) ** 0.5 < best:
                    best, here, there = _dot(gap, gap) ** 0.5, on_one, on_other
        distance[k] = best
        for axis in range(3):
            near[0, k, axis], near[1, k, axis] = here[axis], there[axis]
    return distance, near[0], near[1]


@compiled
def find_flat(vertices: Array, faces: Ints, least: float) -> Mask:
    """Mark faces (m, 3) whose doubled area is less than `least` times their longest edge squared."""
    flat = np.empty(len(faces), dtype=np.bool_)
    for k in range(len(faces)):
        a, b, c = (
            _corner_of(vertices, faces[k, 0]),
            _corner_of(vertices, faces[k, 1]),
            _corner_of(vertices, faces[k, 2]),
        )
        ab, ac, bc = _minus(b, a), _minus(c, a), _minus(c, b)
        normal = _cross(ab, ac)
        longest = max(_dot(ab, ab), _dot(ac, ac), _dot(bc, bc))
        # a face of NaN or overflow has no area either
        flat[k] = not _dot(normal, normal) > (least * longest) ** 2
    return flat


@compiled
def nearest_edges(
    corners: Array, middle: Array, options: Ints, known: Mask, start: Array, end: Array
) -> tuple[Ints, Array, Array]:
    """Find, for each face, the nearest of the edges that it may belong to.

    Returns the edge (m,), its distance from the face's middle, and the distance of the farthest corner.

    Args:
        corners, middle: (m, 3, 3) and (m, 3), of the faces.
        options, known: (m, k), the candidate edges, and which of them count.
    """
    edge = np.zeros(len(corners), dtype=np.int64)
    nearest, farthest = np.full(len(corners), np.inf), np.zeros(len(corners))
    for k in range(len(corners)):
        edge[k] = options[k, 0]
        for i in range(options.shape[1]):
            if not known[k, i]:
                continue
            at = options[k, i]
            far = _from_segment(_corner_of(middle, k), _corner_of(start, at), _corner_of(end, at))
            if far < nearest[k]:
                edge[k], nearest[k] = at, far
        a, b = _corner_of(start, edge[k]), _corner_of(end, edge[k])
        for i in range(3):
            farthest[k] = max(farthest[k], _from_segment(_corner_of(corners[k], i), a, b))
    return edge, nearest, farthest
