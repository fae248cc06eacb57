"""The exact shadow of a mesh without graphics: noded silhouette edges and their winding numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from knotfab_formats.libraries import took_part
from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.check import BadFile
from knotfab_validators.geometry.curves import number_runs
from knotfab_validators.shadows.render import Renderer
from knotfab_validators.shadows.view import ViewGeometry

NEAREST = 1e-6  # w (see `ViewGeometry.projection`) below which matter is too near to the light


class ShadowError(BadFile):
    """The mesh casts no meaningful shadow in this scene, for instance because it reaches the light."""


def _cut(homogeneous: Array, faces: Ints, inside: Mask, limit: float) -> tuple[Array, Ints]:
    """Return the part with w < `limit` of faces (m, 3) that have corners on both sides, as triangles.

    `homogeneous` (n, 3) holds (u w, v w, w), in which a straight edge stays straight; new corners are
    appended, one for each edge that is cut. `inside` (m, 3): which corners are on this side.
    """
    single = inside.sum(axis=1) == 1  # one corner is kept, otherwise two
    alone = np.argmax(inside == single[:, None], axis=1)  # the corner that is alone on its side
    a, b, c = np.take_along_axis(faces, (alone[:, None] + np.arange(3)) % 3, axis=1).T
    cut = np.sort(np.concatenate([np.stack([a, b], axis=1), np.stack([c, a], axis=1)]), axis=1)
    key, place = np.unique(cut[:, 0] * len(homogeneous) + cut[:, 1], return_inverse=True)
    p, q = homogeneous[key // len(homogeneous)], homogeneous[key % len(homogeneous)]
    share = (limit - p[:, 2]) / (q[:, 2] - p[:, 2])
    corners = np.concatenate([homogeneous, p + share[:, None] * (q - p)])
    ab, ca = (len(homogeneous) + place).reshape(2, -1)
    kept = np.stack([a, ab, ca], axis=1)[single]
    first, second = np.stack([ab, b, c], axis=1)[~single], np.stack([ab, c, ca], axis=1)[~single]
    return corners, np.concatenate([kept, first, second])


class EdgeTable:
    """The faces (m, 3) that run through each edge, and which way: all that a mesh's shadows share.

    Args:
        count: how many vertices there are.
    """

    def __init__(self, faces: Ints, count: int) -> None:
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        a, b = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        key = np.minimum(a, b) * count + np.maximum(a, b)
        order = np.argsort(key, kind="stable")
        key = key[order]
        first = np.flatnonzero(np.diff(key, prepend=-1))
        self._ends = np.stack([key[first] // count, key[first] % count], axis=1)
        self._first = np.append(first, len(key))
        self._face, self._along = order // 3, np.where(a < b, 1, -1)[order]

    def find_silhouette(self, points: Array) -> Linework:
        """Find the silhouette edges, for vertices projected to `points` (n, 2), as in `shadow_lines`."""
        edge, net = _count_edges(
            np.ascontiguousarray(points), self.faces, self._first, self._face, self._along
        )
        ends = self._ends[edge]
        return Linework(points[ends[:, 0]], points[ends[:, 1]], net)


@compiled
def _count_edges(
    points: Array, faces: Ints, first: Ints, face: Ints, along: Ints
) -> tuple[Ints, Ints]:
    """Find edges that faces, turned to positive area, traverse more often one way, and by how many."""
    turned = np.zeros(len(faces), dtype=np.int64)
    for k in range(len(faces)):
        a, b, c = faces[k, 0], faces[k, 1], faces[k, 2]
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
        area = ux * vy - uy * vx
        turned[k] = 1 if area > 0.0 else -1 if area < 0.0 else 0
    edge = np.empty(len(first) - 1, dtype=np.int64)
    net = np.empty(len(first) - 1, dtype=np.int64)
    found = 0
    for k in range(len(first) - 1):
        total = 0
        for i in range(first[k], first[k + 1]):
            total += along[i] * turned[face[i]]
        if total != 0:
            edge[found], net[found] = k, total
            found += 1
    return edge[:found], net[:found]


def cut_before(homogeneous: Array, faces: Ints, limit: float) -> tuple[Array, Ints] | None:
    """Return the part of a mesh with w < `limit`, with new corners appended; None if that is all of it.

    `homogeneous` (n, 3) holds (u w, v w, w).
    """
    inside = (homogeneous[:, 2] < limit)[faces]
    whole = inside.all(axis=1)
    if whole.all():
        return None
    crossing, kept = inside.any(axis=1) & ~whole, faces[whole]
    if not crossing.any():
        return homogeneous, kept
    corners, pieces = _cut(homogeneous, faces[crossing], inside[crossing], limit)
    return corners, np.concatenate([kept, pieces])


def shadow_lines(
    vertices: Array,
    faces: Ints,
    geometry: ViewGeometry,
    table: Callable[[], EdgeTable] | None = None,
) -> Linework:
    """Return a mesh's silhouette edges as oriented lines, in pixels of the flat receiver.

    Every face is turned to positive area in the picture, and an edge that two faces traverse in
    opposite directions cancels. What is left (silhouette edges, and free edges of an open mesh)
    bounds the sum of all projected faces, so its winding number at a point is the number of faces
    over it. The shadow is where this is not zero, for any set of triangles.

    Args:
        vertices: (n, 3), mm, in the coordinates of `geometry`.
        faces: (m, 3) indices. table: gives their edge table, which is asked if nothing is cut off.

    Raises:
        ShadowError: the part reaches the light or lies behind it.
    """
    faces = np.asarray(faces, dtype=np.int64)
    h = geometry.lift(vertices)
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if (h[used, 2] < NEAREST).any():
        raise ShadowError("the part reaches the light, or lies behind it: its shadow is unbounded")
    # matter on or behind the receiver plane casts no shadow
    cut = cut_before(h, faces, geometry.w_of_receiver)
    if cut is None and table is not None:
        return table().find_silhouette(on_page(h))
    h, faces = cut or (h, faces)
    return EdgeTable(faces, len(h)).find_silhouette(on_page(h))


def on_page(homogeneous: Array) -> Array:
    """Divide (u w, v w, w) (n, 3) by w to get pixels (n, 2)."""
    with np.errstate(all="ignore"):  # w is 0 only at corners that no face uses
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def shadow_mask(lines: Linework, geometry: ViewGeometry) -> Mask:
    """Rasterise the shadow at the pixel centres of `geometry`, (height, width)."""
    took_part("numba", "cast the exact shadow")
    return wound_mask([lines], geometry.width, geometry.height)


def shadow_polygon(lines: Linework) -> Any:
    """Return the shadow as a shapely polygon, in pixels.

    The lines are noded and polygonised. Faces of that arrangement with a nonzero winding number at
    an inner point are the shadow.
    """
    noded = shapely.unary_union(shapely.linestrings(np.stack([lines.start, lines.end], axis=1)))
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    inner = shapely.get_coordinates(shapely.point_on_surface(cells))
    return shapely.coverage_union_all(cells[winding_at(inner, lines) != 0])


# Winding numbers of oriented lines in the plane, at pixel centres and at given points.


@dataclass(frozen=True)
class Linework:
    """Oriented straight edges that form closed boundaries: at every point as many end as begin.

    `start` and `end` are (n, 2), in pixels; `weight` (n,) counts how often an edge is run through.
    """

    start: Array
    end: Array
    weight: Ints


def _rising_edges(lines: Linework) -> tuple[Linework, Array]:
    """Return the edges that cross any row, turned so that y grows, and dx/dy of each."""
    up = lines.end[:, 1] < lines.start[:, 1]
    low = np.where(up[:, None], lines.end, lines.start)
    high = np.where(up[:, None], lines.start, lines.end)
    weight = np.where(up, -lines.weight, lines.weight)
    some = high[:, 1] > low[:, 1]
    low, high, weight = low[some], high[some], weight[some]
    slope = (high[:, 0] - low[:, 0]) / (high[:, 1] - low[:, 1])
    return Linework(low, high, weight), slope


def wound_mask(parts: Iterable[Linework], width: int, height: int) -> Mask:
    """Rasterise where the joint winding number of all `parts` is not 0, (height, width).

    Pixel centres are integers. In this scan line algorithm each edge adds its weight to all pixels
    of a row to the right of its crossing, by one entry and a running sum. An edge meets the rows of
    the half-open interval [y_low, y_high), so that a vertex on a row counts once.
    """
    raster = np.zeros((height, width), dtype=np.int32)
    for lines in parts:
        start, end = (np.ascontiguousarray(x, dtype=np.float64) for x in (lines.start, lines.end))
        _add_edges(raster, start, end, np.ascontiguousarray(lines.weight, dtype=np.int64))
    return np.asarray(np.cumsum(raster, axis=1, dtype=np.int32, out=raster) != 0)


@compiled
def _add_edges(raster: NDArray[np.int32], start: Array, end: Array, weight: Ints) -> None:
    """Add each edge's weight at the first pixel to its right in each row that it crosses."""
    height, width = raster.shape
    for k in range(len(start)):
        low, high, turn = start[k], end[k], weight[k]
        if high[1] < low[1]:
            low, high, turn = end[k], start[k], -weight[k]
        if not high[1] > low[1]:
            continue
        slope = (high[0] - low[0]) / (high[1] - low[1])
        first = int(min(max(np.ceil(low[1]), 0.0), height))
        last = int(min(max(np.ceil(high[1]), 0.0), height))
        for row in range(first, last):
            column = max(np.ceil(low[0] + (row - low[1]) * slope), 0.0)
            if column < width:
                raster[row, int(column)] += turn


def winding_at(points: Array, lines: Linework) -> Ints:
    """Return the winding numbers (m,) at points (m, 2): of the edges in each one's row, those to its left."""
    edges, slope = _rising_edges(lines)
    order = np.argsort(points[:, 1], kind="stable")
    rows = points[order, 1]
    first, last = np.searchsorted(rows, edges.start[:, 1]), np.searchsorted(rows, edges.end[:, 1])
    edge, number = number_runs(last - first)
    at = order[first[edge] + number]
    x, y = points[at, 0], points[at, 1]
    hit = edges.start[edge, 0] + (y - edges.start[edge, 1]) * slope[edge] <= x
    sums = np.bincount(at[hit], edges.weight[edge[hit]], minlength=len(points))
    numbers: Ints = np.rint(sums).astype(np.int64)
    return numbers


# The shadows of a mesh for many lights, by a compiled scan of its silhouette edges.


class ShadowCaster(Renderer):
    """A mesh whose edges are sorted once, for `shadow_lines` and `shadow_mask` under many lights.

    It draws what the renderer draws (`SilhouetteRenderer` computes the same in another way). A
    shadow that is verified by both need not be drawn by both for each place of a lamp.

    Args:
        vertices: (n, 3) mm. faces: (m, 3).
    """

    def __init__(self, vertices: Array, faces: Ints) -> None:
        super().__init__(vertices)
        self._faces = np.asarray(faces, dtype=np.int64)
        # all places of the light before one receiver share the faces seen whole, and their table
        self._last: tuple[Mask, Ints, EdgeTable] | None = None

    @cached_property
    def _table(self) -> EdgeTable:
        return EdgeTable(self._faces, len(self._vertices))

    def lines(self, geometry: ViewGeometry) -> Linework:
        """Return `shadow_lines` of the mesh.

        Raises:
            ShadowError: the part reaches the light or lies behind it.
        """
        return shadow_lines(self._vertices, self._faces, geometry, lambda: self._table)

    def render(self, geometry: ViewGeometry) -> Mask:
        h, faces = geometry.lift(self._vertices), self._faces
        seen = (h[:, 2] > NEAREST) & (h[:, 2] < geometry.w_of_receiver)
        if self._last is None or not np.array_equal(seen, self._last[0]):
            whole = np.asarray(seen[faces].all(axis=1))
            table = self._table if whole.all() else EdgeTable(faces[whole], len(h))
            self._last = seen, faces[~whole], table
        _, pieces, table = self._last
        lines = table.find_silhouette(on_page(h))
        if len(pieces):  # winding numbers add up, and the shared edges cancel
            # matter nearer to the light is clipped, as a camera does
            for sign, bound in ((-1.0, -NEAREST), (1.0, geometry.w_of_receiver)):
                turned = h * [1.0, 1.0, sign]
                turned, pieces = cut_before(turned, pieces, bound) or (turned, pieces)
                h = turned * [1.0, 1.0, sign]
            cut = EdgeTable(pieces, len(h)).find_silhouette(on_page(h))
            lines = Linework(
                np.concatenate([lines.start, cut.start]),
                np.concatenate([lines.end, cut.end]),
                np.concatenate([lines.weight, cut.weight]),
            )
        return wound_mask([lines], geometry.width, geometry.height)
