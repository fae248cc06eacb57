"""A polygon in space cut into triangles, ear by ear."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints

__all__ = ["cut_polygon"]


def cut_polygon(points: Array) -> Ints | None:
    """(n - 2, 3) corners of the triangles of a nearly flat polygon (n, 3); None where it crosses itself.

    An ear is a corner that turns inwards and whose triangle holds no other corner (Meisters, "Polygons
    have ears", 1975); a polygon that does not cross itself has one as long as it has corners.
    """
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    drop = int(np.abs(normal).argmax())
    flat = np.delete(points, drop, axis=1)
    if (normal[drop] < 0) != (drop == 1):  # seen so that it runs counter-clockwise
        flat = flat[:, ::-1]
    left, found = list(range(len(points))), []
    at = passed = 0
    while len(left) > 3:
        before, here, after = (left[(at + k) % len(left)] for k in (-1, 0, 1))
        rest = flat[[k for k in left if k not in (before, here, after)]]
        flat_too = passed > len(left)  # only where there is no ear with an area
        if _is_ear(flat[before], flat[here], flat[after], rest, flat_too):
            found.append((before, here, after))
            left.pop(at % len(left))
            passed = 0
        else:
            at, passed = at + 1, passed + 1
            if passed > 2 * len(left) + 1:
                return None
        at %= len(left)
    return np.array([*found, tuple(left)], dtype=np.int64)


def _is_ear(a: Array, b: Array, c: Array, others: Array, flat_too: bool) -> bool:
    """Tell whether the triangle turns counter-clockwise, and holds none of the other points (k, 2)."""

    def side(p: Array, q: Array, x: Array) -> Array:
        return np.asarray((q[0] - p[0]) * (x[..., 1] - p[1]) - (q[1] - p[1]) * (x[..., 0] - p[0]))

    turn = float(side(a, b, c))
    if turn < 0 or (turn == 0 and not flat_too):
        return False
    # a corner at the same place as one of these is a slit's other side, and in nobody's way
    same = np.any([(others == p).all(axis=1) for p in (a, b, c)], axis=0)
    inside = (side(a, b, others) >= 0) & (side(b, c, others) >= 0) & (side(c, a, others) >= 0)
    return not bool((inside & ~same).any())
