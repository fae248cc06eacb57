"""Samples of curves and faces: runs of equal numbers, edges and triangles cut into pieces."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints

__all__ = ["cut_edges", "number_runs", "quarter_triangles"]


def number_runs(count: Ints) -> tuple[Ints, Ints]:
    """Number the members of runs of lengths (n,): the run that each belongs to, and its number there.

    Both (sum of `count`,), from 0: counts (2, 0, 3) give (0, 0, 2, 2, 2) and (0, 1, 0, 1, 2).
    """
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)


def cut_edges(start: Array, end: Array, step: float) -> tuple[Ints, Array, Array]:
    """Return edges (n, 3) cut into equal pieces, of at most `step` and at least one an edge.

    Returns:
        The edge of each piece, where on it the piece begins (0 to 1) and how much of it the piece is.
    """
    pieces = np.maximum(np.ceil(np.linalg.norm(end - start, axis=1) / step), 1).astype(np.int64)
    which, number = number_runs(pieces)
    return which, number / pieces[which], 1 / pieces[which]


def quarter_triangles(corner: Array) -> Array:
    """Return (4m, 3, 3) four triangles half as large in place of each triangle (m, 3, 3)."""
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(piece, axis=1) for piece in pieces])
