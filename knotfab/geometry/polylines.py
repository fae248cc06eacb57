"""Several closed polylines in one array, with the index arithmetic that the search needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from knotfab.base.arrays import Array, Indices

__all__ = ["Polylines", "dot", "polylines_of", "polylines_of_sizes", "split_alike"]


def dot(a: Array, b: Array) -> Array:
    """Return [N] row-wise scalar products of (N, 3) arrays (einsum: sums over three are slow otherwise)."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


@dataclass(frozen=True)
class Polylines:
    """The closed polylines that the rows of an (N, 3) array form: `sizes` rows each, in order."""

    sizes: tuple[int, ...]
    start: Indices  # [N] first row of the ring of each row
    size: Indices  # [N] size of the ring of each row
    ring: Indices  # [N] number of the ring of each row
    next: Indices  # [N] the following row
    previous: Indices  # [N]

    def ahead(self, steps: int) -> Indices:
        """Return [N] the row `steps` further along each row's ring."""
        rows = np.arange(len(self.start))
        return self.start + (rows - self.start + steps) % self.size

    def index_distance(self, i: Indices, j: Indices) -> Indices:
        """Return steps between rows along the curve; a huge number between different rings."""
        apart = np.abs(i - j)
        apart = np.minimum(apart, self.size[i] - apart)
        return np.where(self.ring[i] == self.ring[j], apart, np.iinfo(np.int64).max)

    @cached_property
    def bounds(self) -> Indices:
        """The first row of each ring, and how many rows there are."""
        return np.cumsum([0, *self.sizes], dtype=np.int64)

    def split(self, rows: Array) -> list[Array]:
        """Return the (N, k) array cut into its rings."""
        return np.split(rows, self.bounds[1:-1])


def split_alike(rows: Array, curves: Sequence[Array]) -> list[Array]:
    """Return the (N, k) array cut into runs as long as the curves, one after the other."""
    return np.split(rows, np.cumsum([len(curve) for curve in curves])[:-1])


def polylines_of(curves: Iterable[Array]) -> Polylines:
    """Return the index arithmetic of closed polylines (n, k), laid behind each other."""
    return polylines_of_sizes(tuple(len(curve) for curve in curves))


def polylines_of_sizes(sizes: tuple[int, ...]) -> Polylines:
    """Return the index arithmetic of closed polylines with these numbers of vertices."""
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    size = np.repeat(np.asarray(sizes, dtype=np.int64), sizes)
    start = np.repeat(starts, sizes)
    ring = np.repeat(np.arange(len(sizes), dtype=np.int64), sizes)
    rows = np.arange(len(start), dtype=np.int64)
    inside = rows - start
    return Polylines(
        sizes, start, size, ring, start + (inside + 1) % size, start + (inside - 1) % size
    )
