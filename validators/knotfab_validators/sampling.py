"""Small helpers of checks that look at many points: cut triangles, name the worst places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .check import MOST_PLACES

__all__ = ["quarters", "worst_apart"]

Array = NDArray[np.float64]

MOST_COMPARED = 2000


def quarters(corner: Array) -> Array:
    """(4m, 3, 3) four triangles half as large in place of each triangle (m, 3, 3)."""
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(piece, axis=1) for piece in pieces])


def worst_apart(values: Array, points: Array, apart: float, above: float) -> NDArray[np.int64]:
    """The number of the largest value (or of a NaN), then of others `above`, worst first.

    Of `points` (n, 3) nearer than `apart` to each other only the worst is named.
    """
    order = np.argsort(-np.where(np.isnan(values), np.inf, values), kind="stable")
    kept = [int(order[0])]
    for i in order[1:MOST_COMPARED]:
        if len(kept) == MOST_PLACES or not values[i] > above:
            break
        if np.linalg.norm(points[kept] - points[i], axis=1).min() > apart:
            kept.append(int(i))
    return np.array(kept, dtype=np.int64)
