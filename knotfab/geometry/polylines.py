"""Several closed polylines in one array, with the index arithmetic that the search needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.kernels import closest_parameters, least_gap
from knotfab_formats.libraries import took_part


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


# Even samples of closed polylines.


def arc_lengths(points: Array, *, closed: bool = True) -> Array:
    """Return (n + 1,) arc length at each vertex of a polyline (n, k), the whole last; (n,) of an open one."""
    steps = np.diff(points, axis=0, append=points[:1]) if closed else np.diff(points, axis=0)
    edges = np.linalg.norm(steps, axis=1)
    return np.concatenate([[0.0], np.cumsum(edges)])


def sample_evenly(points: Array, step: float, *, at_most: bool = False, fewest: int = 8) -> Array:
    """Return points at equal distances along a closed polyline, from its first vertex on.

    Args:
        points: (n, k), the first not repeated.
        step: the distance wanted; the one taken divides the whole length.
        at_most: never farther apart than `step`; otherwise as near to it as can be.
        fewest: points, however short the polyline.

    Returns:
        (m, k), m at least `fewest`.
    """
    arc = arc_lengths(points)
    pieces = arc[-1] / step
    count = max(fewest, int(np.ceil(pieces)) if at_most else round(pieces))
    at = np.arange(count) * (arc[-1] / count)
    closed = np.concatenate([points, points[:1]])
    return np.stack([np.interp(at, arc, column) for column in closed.T], axis=1)


def number_runs(counts: Indices) -> tuple[Indices, Indices]:
    """Number the members of runs of lengths (n,): the run that each belongs to, and its number there."""
    run = np.repeat(np.arange(len(counts)), counts)
    return run, np.arange(len(run)) - np.repeat(np.cumsum(counts) - counts, counts)


def pair_nearby(curves: Sequence[Array], reach: float) -> tuple[Indices, Array]:
    """Return (m, 2) pairs of points closer than `reach`, and (m,) how far apart they are along their curve.

    Args:
        curves: closed polylines [(n, k)], whose points are numbered one after the other.

    Returns:
        The pairs, and the shorter way between the two; infinite where they are of different curves.
    """
    from scipy.spatial import cKDTree

    sizes = [len(c) for c in curves]
    curve = np.repeat(np.arange(len(curves)), sizes)
    arcs = [arc_lengths(c) for c in curves]
    arc, total = np.concatenate([a[:-1] for a in arcs]), np.repeat([a[-1] for a in arcs], sizes)
    pairs = cKDTree(np.concatenate(curves)).query_pairs(reach, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    along = np.abs(arc[i] - arc[j])
    along = np.minimum(along, total[i] - along)
    along[curve[i] != curve[j]] = np.inf
    return pairs, along


# Find the segments near each other: pairs from a KD-tree, kept valid while vertices move.


@dataclass(frozen=True)
class Neighbours:
    """Segment pairs (i -> i+1, j -> j+1), i < j, whose middles were within `reach` at `points`."""

    i: Indices
    j: Indices
    reach: float
    points: Array
    skip: int  # pairs closer than this many steps along the curve are left out

    def moved(self, points: Array) -> float:
        """Return the largest distance a vertex has gone since the pairs were found."""
        return float(np.sqrt(dot(points - self.points, points - self.points).max()))


def find_neighbours(points: Array, rings: Polylines, reach: float, skip: int) -> Neighbours:
    """Find all segment pairs with middles within `reach` and at least `skip` steps apart."""
    middle = 0.5 * (points + points[rings.next])
    took_part("scipy", "found the strands that are near each other")
    pairs = cKDTree(middle).query_pairs(reach, output_type="ndarray").astype(np.int64)
    i, j = pairs[:, 0], pairs[:, 1]
    keep = rings.index_distance(i, j) >= skip
    return Neighbours(i[keep], j[keep], reach, points.copy(), skip)


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return [M] distance between the segments a-b and c-d, [M, 3] each, none of them without length."""
    s, t = closest_parameters(a, b - a, c, d - c)
    gap = a + s[:, None] * (b - a) - c - t[:, None] * (d - c)
    return np.asarray(np.linalg.norm(gap, axis=1))


# Exact measures of closed polylines: how tightly they bend, and how near strands come to each
# other.


@dataclass(frozen=True)
class StrandGap:
    """The closest approach of strands that are not neighbours along the curve."""

    gap: float
    i: int
    j: int


def bend_radii(points: Array, rings: Polylines) -> Array:
    """Return [N] min(adjacent edges) / (2 tan(theta / 2)) at each vertex (Rawdon's MinRad), mm."""
    ahead, behind = points[rings.next] - points, points - points[rings.previous]
    one, two = np.linalg.norm(ahead, axis=1), np.linalg.norm(behind, axis=1)
    cosine = dot(ahead, behind) / (one * two)
    tangent = np.sqrt(np.maximum(1 - cosine, 0) / np.maximum(1 + cosine, 1e-12))
    return np.asarray(np.minimum(one, two) / np.maximum(2 * tangent, 1e-12))


def strand_gap(
    points: Array, rings: Polylines, separation: float, reach: float, straight: float = np.inf
) -> StrandGap:
    """Return the least distance of centre lines over pairs further than pi (r + c/2) along the curve.

    With bends no tighter than r + c/2 nearer pairs have no doubly critical chord below 2r + c (Schur),
    so half of this is a lower bound of that part of the polygonal thickness. `reach`: distances
    above it are reported as `reach`. `straight` leaves out pairs whose distance is more than this share of
    the arc between them: they are near because they are neighbours, not because the curve came back.
    """
    edge = points[rings.next] - points
    length = np.linalg.norm(edge, axis=1)
    # arc distance, ring by ring
    before = np.cumsum(length) - 0.5 * length  # the way to the middle of each segment
    total = np.add.reduceat(length, np.unique(rings.start))[rings.ring]
    longest, within = float(length.max()), min(1.2 * separation, reach)
    while True:
        # a gap found within a distance is the least of all; most often strands are close somewhere
        near = find_neighbours(points, rings, within + longest, 2)
        lists = (rings.next, rings.start, near.i, near.j, before, total)
        gap, pair = least_gap(points, *lists, 0.5 * np.pi * separation, straight)
        if gap <= within or within >= reach:
            break
        within = min(2 * within, reach)
    if pair < 0:
        return StrandGap(reach, -1, -1)
    return StrandGap(min(gap, reach), int(near.i[pair]), int(near.j[pair]))


@dataclass(frozen=True)
class Curvature:
    """The bending of a closed polyline: curvature times the tube's radius along its length, and its turns."""

    mean: float
    quantile_90: float
    turns: float  # total turning angle over a full turn


def measure_curvature(points: Array, radius: float) -> Curvature:
    """Measure the curvature of a closed polyline (n, 3): at a vertex, turning angle over its mean edge."""
    ahead = np.roll(points, -1, axis=0) - points
    length = np.linalg.norm(ahead, axis=1)
    unit = ahead / length[:, None]
    behind, before = np.roll(unit, 1, axis=0), np.roll(length, 1)
    # arctan2 keeps its digits where edges are nearly in line
    sine = np.linalg.norm(np.cross(behind, unit), axis=1)
    angle = np.arctan2(sine, dot(behind, unit))
    share = 0.5 * (length + before)
    curvature = radius * angle / share
    order = np.argsort(curvature)
    along = np.cumsum(share[order]) / share.sum()
    ninety = float(curvature[order][np.searchsorted(along, 0.9)])
    total = float(angle.sum())
    return Curvature(radius * total / float(share.sum()), ninety, total / (2 * np.pi))


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
