"""Centre lines as polygons with one tube radius, their edges, and distances between segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints, Mask

_Value = TypeVar("_Value", bound=np.generic)


@dataclass(frozen=True)
class CurveEdges:
    """Edges from `start` to `end` (k, 3), mm; `curve` (k,) is the index of the curve that each belongs to."""

    start: Array
    end: Array
    curve: Ints


@dataclass(frozen=True)
class Member:
    """A round bar of a mount, from a centre line to another one or to the mount's foot; points (3,), mm.

    `radius_mm` holds the radii at its two ends, `foot` the unit normal of the face that it stands on, if
    any.
    """

    start: Array
    end: Array
    radius_mm: tuple[float, float]
    foot: Array | None = None

    def scaled(self, share: float) -> Member:
        """Scale every length of the bar by `share`."""
        low, high = self.radius_mm
        return Member(share * self.start, share * self.end, (share * low, share * high), self.foot)


@dataclass(frozen=True)
class Slab:
    """A flat plate in which the piece stands.

    Holds the corners of its face (n, 3) and the centres of its through holes (k, 3), mm, which are `hole_mm`
    wide; `out` (3,) is the unit normal of the face. `openings` [(m, 3), ...] go through it, too.
    """

    outline: Array
    holes: Array
    hole_mm: float
    thickness_mm: float
    out: Array
    openings: tuple[Array, ...] = ()

    def scaled(self, share: float) -> Slab:
        """Scale every length of the plate by `share`."""
        hole, thick = share * self.hole_mm, share * self.thickness_mm
        openings = tuple(share * opening for opening in self.openings)
        return Slab(share * self.outline, share * self.holes, hole, thick, self.out, openings)


@dataclass(frozen=True)
class Bar:
    """A level box that holds two strands apart while they print: its ends (3,), its width and height, mm."""

    start: Array
    end: Array
    width: float
    height: float

    def scaled(self, share: float) -> Bar:
        return Bar(share * self.start, share * self.end, share * self.width, share * self.height)


@dataclass(frozen=True, eq=False)
class Curves:
    """Polygons with one tube radius, and the mount that holds them.

    `polygons` are (n, 3) float64 mm; a `closed` one joins its last point to its first, which is not
    repeated. `types` are the knot types that the file promises, such as "unknot" or "3_1" ("open"
    for an open curve); `radius_mm` is None where the file gives none. The mount's `members` lead
    from strands, `rods` are its other round bars, `hulls` the names and corners (n, 3) of its
    convex solids, and `plate` the one in which the piece stands. `bars` are broken away after
    printing; `cut_mm` is how much of the lowest foot is cut off. `stated`: the file itself gives each
    closed curve's type.
    """

    polygons: tuple[Array, ...]
    types: tuple[str, ...]
    closed: tuple[bool, ...]
    radius_mm: float | None
    members: tuple[Member, ...] = ()
    plate: Slab | None = None
    bars: tuple[Bar, ...] = ()
    cut_mm: float = 0.0
    rods: tuple[Member, ...] = ()
    hulls: tuple[tuple[str, Array], ...] = ()
    stated: bool = True

    @cached_property
    def edges(self) -> CurveEdges:
        """The edges of all curves, curve after curve."""
        return edges_of(self.polygons, self.closed)

    @property
    def length_mm(self) -> float:
        """Length of all polygons together, closing edges included."""
        return sum(self.lengths_mm)

    @property
    def lengths_mm(self) -> tuple[float, ...]:
        """Length of each polygon, the closing edge included where it is closed."""
        length = np.linalg.norm(self.edges.end - self.edges.start, axis=1)
        return tuple(np.bincount(self.edges.curve, length, minlength=len(self.polygons)).tolist())

    def scaled(self, share: float) -> Curves:
        """Scale all curves, radii and mounts by `share`."""
        return replace(
            self,
            polygons=tuple(share * polygon for polygon in self.polygons),
            radius_mm=None if self.radius_mm is None else share * self.radius_mm,
            plate=None if self.plate is None else self.plate.scaled(share),
            bars=tuple(bar.scaled(share) for bar in self.bars),
            cut_mm=share * self.cut_mm,
            members=tuple(m.scaled(share) for m in self.members),
            rods=tuple(rod.scaled(share) for rod in self.rods),
            hulls=tuple((name, share * corners) for name, corners in self.hulls),
        )


def edges_of(polygons: Sequence[Array], closed: Sequence[bool] | None = None) -> CurveEdges:
    """Return the edges of polygons (n, 3), polygon after polygon; by default all are closed.

    A closed polygon's last edge leads to its first point; an open one has no such edge.
    """
    starts, ends, numbers = [], [], []
    joined = [True] * len(polygons) if closed is None else closed
    for i, (polygon, is_closed) in enumerate(zip(polygons, joined, strict=True)):
        count = len(polygon) if is_closed else len(polygon) - 1
        starts.append(polygon[:count])
        ends.append(np.roll(polygon, -1, axis=0)[:count])
        numbers.append(np.full(count, i, dtype=np.int64))
    return CurveEdges(np.concatenate(starts), np.concatenate(ends), np.concatenate(numbers))


# Runs of consecutive indices, and edges and triangles cut into pieces.


def number_runs(count: Ints) -> tuple[Ints, Ints]:
    """Number the members of runs of lengths `count` (n,): each one's run, and its index in that run, from 0.

    Both have shape (sum of `count`,): counts (2, 0, 3) give (0, 0, 2, 2, 2) and (0, 1, 0, 1, 2).
    """
    which = np.repeat(np.arange(len(count)), count)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)


def cut_edges(start: Array, end: Array, step: float) -> tuple[Ints, Array, Array]:
    """Cut each edge (n, 3) into equal pieces no longer than `step`.

    Returns:
        Each piece's edge, and, as shares of that edge, where the piece begins and how long it is.
    """
    pieces = np.maximum(np.ceil(np.linalg.norm(end - start, axis=1) / step), 1).astype(np.int64)
    which, number = number_runs(pieces)
    return which, number / pieces[which], 1 / pieces[which]


def halve_sides(corner: Array) -> Array:
    """Return the middles of the sides ab, bc and ca of triangles (m, 3, 3)."""
    return (corner + np.roll(corner, -1, axis=1)) / 2


def quarter_triangles(corner: NDArray[_Value], middle: NDArray[_Value]) -> NDArray[_Value]:
    """Split each triangle into four of half the size: what is known at its corners, (4m, 3, ...).

    Args:
        corner, middle: (m, 3, ...) the points, or values there, of corners and of the sides' middles.
    """
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    ab, bc, ca = middle[:, 0], middle[:, 1], middle[:, 2]
    pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(piece, axis=1) for piece in pieces])


# The axes of a view or region that is turned by an azimuth and raised by an elevation.


def view_axes(azimuth_deg: float, elevation_deg: float) -> Array:
    """Return the view's right, up and towards-the-light directions in the scene, as rows (3, 3).

    They are x, y and z where both angles are 0.
    """
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    return np.array(
        [
            [np.cos(a), 0.0, -np.sin(a)],
            [-np.sin(a) * np.sin(e), np.cos(e), -np.cos(a) * np.sin(e)],
            [np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)],
        ]
    )


# Distances from points to segments, and between segments, row by row.


def nearest_on_segment(points: Array, start: Array, end: Array) -> Array:
    """Return the point of each segment nearest to a point (n, 3); a segment may have no length."""
    span = end - start
    square = np.einsum("ij,ij->i", span, span)
    along = np.einsum("ij,ij->i", points - start, span) / np.where(square > 0, square, 1.0)
    return np.asarray(start + along.clip(0.0, 1.0)[:, None] * span)


def point_segment(points: Array, start: Array, end: Array) -> Array:
    """Return the distances (n,) from points (n, 3) to segments."""
    return _length(points - nearest_on_segment(points, start, end))


def nearest_on_two(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Return the nearest points (n, 3) of the segments ab and cd; for parallel ones, any nearest pair.

    The method is that of Ericson, "Real-time collision detection", 2005, 5.1.9.
    """
    u, v, w = b - a, d - c, c - a
    uu, vv, uv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    det = uu * vv - uv * uv
    s = ((uw * vv - vw * uv) / np.where(det > 0, det, np.inf)).clip(0.0, 1.0)
    t = ((s * uv - vw) / np.where(vv > 0, vv, 1.0)).clip(0.0, 1.0)
    s = ((t * uv + uw) / np.where(uu > 0, uu, 1.0)).clip(0.0, 1.0)
    return a + s[:, None] * u, c + t[:, None] * v


def segment_segment(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the distances (n,) between segments ab and cd.

    Ends are measured too, because rounding moves the nearest points of nearly parallel segments.
    """
    p, q = nearest_on_two(a, b, c, d)
    ends = ((a, c, d), (b, c, d), (c, a, b), (d, a, b))
    return np.asarray(np.min([_length(p - q), *(point_segment(*end) for end in ends)], axis=0))


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


# Pairs of nearby segments in two blocks: dense tests, where no hierarchy helps.

# error of a squared distance computed by products, as a share of the squared extent
ROUNDING = 1e-14


@dataclass(frozen=True)
class SegmentBlocks:
    """Segments in m blocks of up to b, padded; `index` (m, b) is -1 in padding."""

    index: Ints
    centre: Array  # (m, b, 3)
    unit: Array  # (m, b, 3), 0 for a segment of no length
    half: Array  # (m, b)
    line: Array  # (m, b, 6): moment and direction, Plücker coordinates
    extent: float


def segment_blocks(start: Array, end: Array, first: Ints) -> SegmentBlocks:
    """Group consecutive segments (n, 3) into blocks; `first` (m,), ascending, is where each begins.

    Coordinates should be relative to a point among them.
    """
    count = np.diff(np.append(first, len(start)))
    column = np.arange(int(count.max()))
    index = np.where(column < count[:, None], first[:, None] + column, -1)
    span = end - start
    length = np.sqrt(np.einsum("ij,ij->i", span, span))
    unit = span / np.where(length > 0, length, 1.0)[:, None]
    centre = (start + end) / 2
    line = np.concatenate([np.cross(centre, unit), unit], axis=1)
    extent = float(np.abs(centre).max() + length.max())
    return SegmentBlocks(index, centre[index], unit[index], length[index] / 2, line[index], extent)


def near_segments(blocks: SegmentBlocks, i: Ints, j: Ints, limit: float) -> tuple[Ints, Ints]:
    """Return pairs of segments, one in block i and one in block j (k,), that may be at most `limit` apart.

    A pair is dropped if the lines are farther apart (by Plücker coordinates), the bounding balls are, or one
    segment leaves the cylinder around the other's line. This takes a few matrix products for each pair of
    blocks, some 50 ns a pair of segments, and memory for k b² numbers.
    """
    near = _mark_near(blocks, i, j, limit)
    near &= (blocks.index[i] >= 0)[:, :, None] & (blocks.index[j] >= 0)[:, None, :]
    block, row, column = np.nonzero(near)
    one, other = blocks.index[i[block], row], blocks.index[j[block], column]
    once = (i[block] != j[block]) | (one < other)
    return one[once], other[once]


def _mark_near(blocks: SegmentBlocks, a: Ints, b: Ints, limit: float) -> Mask:
    """Mark pairs in blocks a and b (k,) that pass all three tests, (k, b, b)."""
    slack = ROUNDING * blocks.extent * max(blocks.extent, limit)
    u, v = blocks.unit[a], blocks.unit[b].transpose(0, 2, 1)
    p, q = blocks.centre[a], blocks.centre[b].transpose(0, 2, 1)
    g, h = blocks.half[a][:, :, None], blocks.half[b][:, None, :]
    sine2 = np.clip(1.0 - (u @ v) ** 2 + ROUNDING, 0.0, 1.0)
    swapped = blocks.line[b][:, :, [3, 4, 5, 0, 1, 2]].transpose(0, 2, 1)
    lines = (blocks.line[a] @ swapped) ** 2
    near: Mask = lines <= limit**2 * sine2 + slack
    square = (p * p).sum(axis=2)[:, :, None] + (q * q).sum(axis=1)[:, None, :] - 2 * (p @ q)
    near &= square <= (limit + g + h) ** 2 + slack
    sine = np.sqrt(sine2)
    along = u @ q - (u * p).sum(axis=2)[:, :, None]
    near &= square - along**2 <= (limit + h * sine) ** 2 + slack
    along = p @ v - (v * q).sum(axis=1)[:, None, :]
    near &= square - along**2 <= (limit + g * sine) ** 2 + slack
    return near
