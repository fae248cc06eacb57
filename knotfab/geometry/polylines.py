"""Several closed polylines in one array, with the index arithmetic to walk along them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from knotfab.base.arrays import Array, Indices


def dot(a: Array, b: Array) -> Array:
    """Return the row-wise scalar products [N] of (N, 3) arrays; sums over an axis of three are slow."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


def row_lengths(rows: Array) -> Array:
    """Return the lengths [N] of the rows of an (N, 3) array, to the bit as `np.linalg.norm` has them."""
    return np.asarray(np.sqrt(sum_rows(rows * rows)))


def sum_rows(rows: Array) -> Array:
    """Return the sums [N] of the rows of an (N, 3) array, to the bit as numpy's, in a tenth of its time."""
    return np.asarray(rows[:, 0] + rows[:, 1] + rows[:, 2])


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
        """Return the row `steps` further along each row's ring, [N]."""
        rows = np.arange(len(self.start))
        return self.start + (rows - self.start + steps) % self.size

    def index_distance(self, i: Indices, j: Indices) -> Indices:
        """Return the steps between rows along the curve; a huge number between different rings."""
        apart = np.abs(i - j)
        apart = np.minimum(apart, self.size[i] - apart)
        return np.where(self.ring[i] == self.ring[j], apart, np.iinfo(np.int64).max)

    @cached_property
    def bounds(self) -> Indices:
        """The first row of each ring, and how many rows there are."""
        return np.cumsum([0, *self.sizes], dtype=np.int64)

    def split(self, rows: Array) -> list[Array]:
        """Split an (N, k) array into its rings."""
        return np.split(rows, self.bounds[1:-1])


def split_alike(rows: Array, curves: Sequence[Array]) -> list[Array]:
    """Split an (N, k) array into runs as long as the curves, in order."""
    return np.split(rows, np.cumsum([len(curve) for curve in curves])[:-1])


def polylines_of(curves: Iterable[Array]) -> Polylines:
    """Return the index arithmetic of closed polylines (n, k), concatenated."""
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


# Even samples of closed polylines.


def arc_lengths(points: Array, *, closed: bool = True) -> Array:
    """Return the arc length at each vertex of a polyline (n, k), (n + 1,) if closed, else (n,)."""
    steps = np.diff(points, axis=0, append=points[:1]) if closed else np.diff(points, axis=0)
    edges = np.linalg.norm(steps, axis=1)
    return np.concatenate([[0.0], np.cumsum(edges)])


def points_at(line: Array, arc: Array, at: Array) -> Array:
    """Return the points (..., k) at lengths along a polyline (n, k) whose vertices are at `arc` (n,)."""
    return np.stack([np.interp(at, arc, column) for column in line.T], axis=-1)


def sample_evenly(points: Array, step: float, *, at_most: bool = False, fewest: int = 8) -> Array:
    """Return points at equal distances along a closed polyline, from its first vertex on.

    Args:
        points: (n, k), the first not repeated.
        step: the distance wanted; the one taken divides the whole length.
        at_most: never farther apart than `step`; otherwise as near to it as can be.
        fewest: the least number of points, however short the polyline.

    Returns:
        (m, k), m at least `fewest`.
    """
    arc = arc_lengths(points)
    pieces = arc[-1] / step
    count = max(fewest, int(np.ceil(pieces)) if at_most else round(pieces))
    at = np.arange(count) * (arc[-1] / count)
    return points_at(np.concatenate([points, points[:1]]), arc, at)


def number_runs(counts: Indices) -> tuple[Indices, Indices]:
    """Return, for each member of runs of lengths (n,), its run and its position there."""
    run = np.repeat(np.arange(len(counts)), counts)
    return run, np.arange(len(run)) - np.repeat(np.cumsum(counts) - counts, counts)


def pair_nearby(curves: Sequence[Array], reach: float) -> tuple[Indices, Array]:
    """Find pairs of points closer than `reach`, (m, 2), and their distances along the curve, (m,).

    Args:
        curves: closed polylines [(n, k)], whose points are numbered one after the other.

    Returns:
        The pairs, and the shorter way between the two; infinite where they are of different curves.
    """

    sizes = [len(c) for c in curves]
    curve = np.repeat(np.arange(len(curves)), sizes)
    from scipy.spatial import cKDTree

    arcs = [arc_lengths(c) for c in curves]
    arc, total = np.concatenate([a[:-1] for a in arcs]), np.repeat([a[-1] for a in arcs], sizes)
    pairs = cKDTree(np.concatenate(curves)).query_pairs(reach, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    along = np.abs(arc[i] - arc[j])
    along = np.minimum(along, total[i] - along)
    along[curve[i] != curve[j]] = np.inf
    return pairs, along


# Project points, and turn gradients in their images into gradients in the points.


@dataclass(frozen=True)
class Seen:
    """Points seen at `places` (N, 2) through `matrix` (3, 4), w being `depth` (N,)."""

    places: Array
    depth: Array
    matrix: Array

    def pull(self, slope: Array) -> Array:
        """Return a gradient (N, 2) in the places as one (N, 3) in the points."""
        aside = slope / self.depth[:, None]
        along = (aside * self.places).sum(axis=1)
        return np.asarray(aside @ self.matrix[:2, :3] - np.outer(along, self.matrix[2, :3]))


def project(points: Array, matrix: Array) -> Seen:
    """Return points (N, 3) through (u w, v w, w) = matrix (x, y, z, 1)."""
    h = points @ matrix[:, :3].T + matrix[:, 3]
    return Seen(h[:, :2] / h[:, 2:], h[:, 2], matrix)
