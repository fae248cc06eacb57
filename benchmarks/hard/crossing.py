"""Whether a straight-line motion of polygons passes one edge through another: found, not bounded.

The four ends of two edges that move along straight lines lie in one plane at the roots of a cubic in
time; the edges meet where, at such a root, they have a point in common. This shares nothing with the
certificate that it is the judge of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array

_BERNSTEIN = np.linalg.inv(
    np.array(
        [
            [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3]
            for t in (0, 1 / 3, 2 / 3, 1)
        ]
    )
)


def passes_through(points: Array, step: Array, following: NDArray[np.int64]) -> bool:
    """Tell whether edges without a common end meet while `points` (N, 3) go to `points + step`."""
    i, j = np.triu_indices(len(points), 1)
    apart = (following[i] != j) & (following[j] != i)
    i, j = i[apart], j[apart]
    ends = np.stack([i, following[i], j, following[j]])
    p, d = points[ends], step[ends]  # [4, M, 3]
    volumes = []
    for t in (0, 1 / 3, 2 / 3, 1):
        a, b, c, e = p + t * d
        volumes.append(np.einsum("ij,ij->i", np.cross(b - a, e - c), c - a))
    hull = _BERNSTEIN @ np.stack(volumes)
    doubt = np.flatnonzero((hull.min(0) <= 0) & (hull.max(0) >= 0))
    return any(_meet(p[:, k], d[:, k], hull[:, k]) for k in doubt)


def _meet(p: Array, d: Array, hull: Array) -> bool:
    b0, b1, b2, b3 = hull
    power = [-b0 + 3 * b1 - 3 * b2 + b3, 3 * b0 - 6 * b1 + 3 * b2, 3 * (b1 - b0), b0]
    size = np.abs(hull).max()
    if size == 0:
        return _common_point(p) or _common_point(p + d)
    roots = np.roots(np.trim_zeros(np.where(np.abs(power) < 1e-15 * size, 0, power), "f"))
    # a pair of complex roots that are nearly one real root is a graze: look there too
    times = [float(r.real) for r in roots if abs(r.imag) < 1e-7 and -1e-9 <= r.real <= 1 + 1e-9]
    return any(_common_point(p + t * d) for t in times)


def _common_point(ends: Array) -> bool:
    """Tell whether edges a-b and c-e, in one plane up to rounding, have a point in common."""
    a, b, c, e = ends
    u, v, w = b - a, e - c, c - a
    normal = np.cross(u, v)
    square = float(normal @ normal)
    if square <= 1e-20 * float(u @ u) * float(v @ v):  # parallel: along one line or not at all
        return False
    s, t = np.cross(w, v) @ normal / square, np.cross(w, u) @ normal / square
    return bool(-1e-9 <= s <= 1 + 1e-9 and -1e-9 <= t <= 1 + 1e-9)


def linking_number(one: Array, two: Array) -> float:
    """Give Gauss's double sum for closed polygons (n, 3) and (m, 3): the solid angles of all pairs of edges.

    A whole number up to rounding, however near the polygons are.
    """
    a, b = one[:, None], np.roll(one, -1, 0)[:, None]
    c, d = two[None], np.roll(two, -1, 0)[None]
    corners = np.broadcast_arrays(c - a, d - a, d - b, c - b)
    normals = [np.cross(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    units = [n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-300) for n in normals]
    angle = sum(
        np.arcsin(np.clip((units[k] * units[(k + 1) % 4]).sum(-1), -1, 1)) for k in range(4)
    )
    side = np.sign((np.cross(d - c, b - a) * (a - c)).sum(-1))
    return float((angle * side).sum() / (4 * np.pi))
