"""Winding numbers in closed surfaces by counting the faces above each point."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask, compiled

_NEAR = 1e-9  # shares of the extent: closer to a face than this, a point is left to the exact sum
_ROUNDING = 1e-12  # bound on the error of a volume in units of (longest edge)² × extent


def is_balanced(faces: Ints, count: int) -> bool:
    """Return whether each edge is run through as often one way as the other: the surface has no rim.

    Args:
        count: of the vertices.
    """
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * np.int64(count) + np.maximum(start, end)
    forth, back = key[start < end], key[start > end]
    return len(forth) == len(back) and bool(np.array_equal(np.sort(forth), np.sort(back)))


def count_above(points: Array, vertices: Array, faces: Ints) -> tuple[Array, Mask]:
    """Count with their signs the faces above points (n, 3): winding numbers (n,), if there is no rim.

    Each edge is compared with a point once and the same way for all its faces, so that a ray through
    an edge or a vertex counts right. The mask marks points so near a face that rounding may decide.
    """
    order = np.argsort(points[:, 0], kind="stable")
    extent = float(np.ptp(vertices, axis=0).max())
    found, unsure = np.zeros(len(points)), np.zeros(len(points), dtype=np.bool_)
    leftmost = vertices[faces, 0].min(axis=1) - _NEAR * extent
    found[order], unsure[order] = _count_above(
        np.ascontiguousarray(points[order]),
        np.ascontiguousarray(vertices),
        faces,
        np.searchsorted(points[order, 0], leftmost),
        extent,
    )
    return found, unsure


@compiled
def _count_above(
    points: Array, vertices: Array, faces: Ints, first: Ints, extent: float
) -> tuple[Array, Mask]:
    """Do the work of `count_above` for points in order of their x; `first` (n,) is that beside each face."""
    found, unsure = np.zeros(len(points)), np.zeros(len(points), dtype=np.bool_)
    near = _NEAR * extent
    for number in range(len(faces)):
        face, n = faces[number], first[number]
        a, b, c = vertices[face[0]], vertices[face[1]], vertices[face[2]]
        right = max(a[0], b[0], c[0]) + near
        low, high = min(a[1], b[1], c[1]) - near, max(a[1], b[1], c[1]) + near
        bottom, top = min(a[2], b[2], c[2]) - near, max(a[2], b[2], c[2]) + near
        while n < len(points) and points[n, 0] <= right:
            p = points[n]
            if low <= p[1] <= high and p[2] <= top:
                turns = 0
                for i in range(3):
                    start, end = vertices[face[i]], vertices[face[(i + 1) % 3]]
                    rises = start[1] <= p[1]
                    if rises == (end[1] <= p[1]):
                        continue
                    below, above = (start, end) if rises else (end, start)
                    share = (p[1] - below[1]) / (above[1] - below[1])
                    if below[0] + share * (above[0] - below[0]) > p[0]:
                        turns += 1 if rises else -1
                if p[2] < bottom:
                    found[n] += turns
                else:
                    # no arrays: what numba makes of these takes a second to compile
                    u = b[0] - a[0], b[1] - a[1], b[2] - a[2]
                    v = c[0] - a[0], c[1] - a[1], c[2] - a[2]
                    w = p[0] - a[0], p[1] - a[1], p[2] - a[2]
                    x = u[1] * v[2] - u[2] * v[1]
                    y = u[2] * v[0] - u[0] * v[2]
                    z = u[0] * v[1] - u[1] * v[0]
                    side, area = x * w[0] + y * w[1] + z * w[2], (x * x + y * y + z * z) ** 0.5
                    longest = max(
                        u[0] * u[0] + u[1] * u[1] + u[2] * u[2],
                        v[0] * v[0] + v[1] * v[1] + v[2] * v[2],
                    )
                    if abs(side) <= (_NEAR * area + _ROUNDING * longest) * extent:
                        unsure[n] = True
                    elif (side < 0) == (z > 0):
                        found[n] += turns
            n += 1
    return found, unsure
