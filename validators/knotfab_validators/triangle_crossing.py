"""Whether triangles cross each other: an edge of one passes through the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["triangles_cross"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def triangles_cross(first: Array, second: Array) -> Mask:
    """Whether triangles (n, 3, 3) cross (n,), up to rounding; coplanar ones are not said to.

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
