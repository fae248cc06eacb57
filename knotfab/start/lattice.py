"""The lattice in the visual hull on which curves for several views grow, and what each of its edges draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from knotfab.base.arrays import Array, Indices
from knotfab.base.compiled import compiled
from knotfab.limits.region import tube_outside
from knotfab.limits.terms import Limits
from knotfab.problem import TargetView
from knotfab.render.image import grid_at

Cells = NDArray[np.int32]
Flags = NDArray[np.bool_]


_CELL = 0.35  # tube radii of a cell of the grids on which views are drawn
_MARGIN = 0.25  # a share of the frame, on each side
NUDGED = 0.25  # a share of the pitch by which a node may be moved: strands stay half a pitch apart
_SHORTEST = 0.8  # a share of the pitch: the shortest edge between moved nodes
_FAR = 10.0  # tube radii outside, of what stands out of the region


@dataclass(frozen=True)
class Sight:
    """One view as the lattice is drawn in it: cells from `first` on, `depth` (H, W) mm inside the silhouette.

    `projection` (3, 4) leads to cells, `near` is how many cells a mm is where w = 1. Of a screen that ends at
    the frame all that is seen beside it counts as inside, and `drawn` (H, W) are the cells of the picture.
    """

    depth: Array
    projection: Array
    near: float
    first: int
    drawn: Flags | None = None

    def draws(self, points: Array) -> Flags:
        """Tell whether each of points (n, 3) is seen on the picture; all are where no screen ends."""
        if self.drawn is None:
            return np.ones(len(points), dtype=bool)
        seen, _ = self.look(points)
        return np.asarray(self._at(self.drawn.astype(float), seen) > 0.5)

    def look(self, points: Array) -> tuple[Array, Array]:
        """Find where points (n, 3) are seen, in cells (n, 2), and the cells that a mm is there (n,)."""
        h = points @ self.projection[:, :3].T + self.projection[:, 3]
        return h[:, :2] / h[:, 2:], self.near / h[:, 2]

    def room(self, points: Array) -> Array:
        """Measure how far inside the silhouette points are seen, mm where they stand (n,)."""
        seen, scale = self.look(points)
        return self._at(self.depth, seen) / scale

    def inwards(self, points: Array) -> Array:
        """Give (n, 3) unit steps from points to where they are seen further inside; 0 without a slope."""
        seen, _ = self.look(points)
        down, right = (self._at(np.asarray(g), seen) for g in np.gradient(self.depth))
        away = seen[:, :, None] * self.projection[2, :3]
        slope = self.projection[:2, :3] - away
        step = right[:, None] * slope[:, 0] + down[:, None] * slope[:, 1]
        return np.asarray(step / np.maximum(np.linalg.norm(step, axis=1), 1e-12)[:, None])

    def _at(self, field: Array, seen: Array) -> Array:
        found = map_coordinates(field, seen[:, ::-1].T, order=1, mode="nearest")
        return np.asarray(found)


@dataclass(frozen=True)
class Lattice:
    """A padded box of nodes, and the edges that a curve may take there with what each draws.

    `nodes` (n, 3) mm stand in an array of `shape`, whose `strides` lead along the `axes` (3, 3 rows), `pitch`
    mm apart. `spill` (n,) is the share of the tube there that is seen outside, summed over the views, and
    `inner` says which nodes are no padding. Edge 3 * node + axis leads from its node along an axis: `open`
    (3 n,) says whether it may be taken, and `cells[starts[e] : starts[e + 1]]` are what it draws everywhere.
    """

    nodes: Array
    shape: tuple[int, ...]
    axes: Array
    pitch: float
    spill: Array
    inner: Flags
    open: Flags
    starts: Indices
    cells: Cells

    @property
    def strides(self) -> Indices:
        """The steps from a node to the next along each axis."""
        return np.array([self.shape[1] * self.shape[2], self.shape[2], 1], dtype=np.int64)

    def ends(self, edges: Indices) -> tuple[Indices, Indices]:
        """Return the nodes of edges (k,)."""
        return edges // 3, edges // 3 + self.strides[edges % 3]

    def squares(self, opened: Flags) -> Indices:
        """Return (k, 4) the edges of the unit squares whose edges are all `opened` (3 n,)."""
        found = []
        per_node = opened.reshape(-1, 3)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            along, up = self.strides[[i, j]]
            low = np.arange(len(self.nodes) - along - up)
            low = low[per_node[low, i] & per_node[low, j]]
            low = low[per_node[low + along, j] & per_node[low + up, i]]
            edges = (3 * low + i, 3 * (low + along) + j, 3 * (low + up) + i, 3 * low + j)
            found.append(np.stack(edges, 1))
        return np.concatenate(found)

    def drawn_by(self, edges: Indices) -> Indices:
        """Return the cells that these edges draw, each once."""
        starts, stops = self.starts[edges], self.starts[edges + 1]
        drawn = np.zeros(int(self.cells.max(initial=0)) + 1, dtype=bool)
        for first, stop in zip(starts.tolist(), stops.tolist(), strict=True):
            drawn[self.cells[first:stop]] = True
        return np.flatnonzero(drawn)


def sights_of(views: Sequence[TargetView], radius: float) -> tuple[list[Sight], Array]:
    """Return the views as grids for a tube of this radius, mm; and the worth of each cell that is drawn.

    A view's wanted cells are worth one together, and what it does not want as much less.
    """
    found, worth, first = [], [], 0
    for target in views:
        cell = _CELL * radius * target.view.magnification
        wanted, camera = grid_at(target.view, target.mask, cell, _MARGIN, more=8)
        given = (target.view, target.mask, cell, _MARGIN)
        allowed = grid_at(*given, more=8, beside=True)[0] if target.ends else wanted
        depth = distance_transform_edt(allowed) - distance_transform_edt(~allowed)
        near = 1.0 / float(np.linalg.norm(camera.du))
        drawn = wanted if target.ends else None
        found.append(Sight(depth - 0.5 * np.sign(depth), camera.projection, near, first, drawn))
        cost = np.where(allowed, 0.0, -1.0)
        worth.append(np.where(wanted, 1.0, cost).ravel() / max(1, wanted.sum()))
        first += wanted.size
    return found, np.concatenate(worth)


@compiled
def _draw(
    one: Array, two: Array, wide: Array, shape: Indices, first: int, at: Indices, cells: Cells
) -> None:
    """Count on `at` (k,) over the cells of each edge's capsule, and enter them into `cells` there, if any."""
    for e in range(len(one)):
        ax, ay, r = one[e, 0], one[e, 1], wide[e]
        ex, ey = two[e, 0] - ax, two[e, 1] - ay
        square = max(ex * ex + ey * ey, 1e-12)
        low_x, high_x = min(ax, ax + ex) - r, max(ax, ax + ex) + r
        low_y, high_y = min(ay, ay + ey) - r, max(ay, ay + ey) + r
        for y in range(max(0, int(np.ceil(low_y))), min(shape[0] - 1, int(high_y)) + 1):
            for x in range(max(0, int(np.ceil(low_x))), min(shape[1] - 1, int(high_x)) + 1):
                t = min(1.0, max(0.0, ((x - ax) * ex + (y - ay) * ey) / square))
                dx, dy = ax + t * ex - x, ay + t * ey - y
                if dx * dx + dy * dy <= r * r:
                    if len(cells) > 0:
                        cells[at[e]] = first + y * shape[1] + x
                    at[e] += 1


def lattice_in(
    sights: Sequence[Sight],
    axes: Array,
    shift: Array,
    pitch: float,
    reach: float,
    limits: Limits,
    spill: float,
) -> Lattice:
    """Give the lattice if a tube fits all silhouettes, along `axes` (3, 3 rows); empty where it fits nowhere.

    Args:
        shift: shift of a node from the origin, in pitches (3,). reach: reach of the box about the origin, mm.
        spill: how far a ball of the tube about a node or the middle of an edge may stand out of a
            silhouette, in tube radii.
    """

    def measure(points: Array) -> Array:
        """Measure how far inside each silhouette points are seen, in tube radii (views, n).

        It is far outside of what leaves the region, and of what draws nothing before screens that end.
        """
        room = np.stack([s.room(points) for s in sights]) / limits.radius
        outside = tube_outside(points, points, limits)[1][: len(points)]
        draws = np.any([s.draws(points) for s in sights], axis=0)
        return np.asarray(np.where((outside > 0) | ~draws, -_FAR, room))

    least = 1.0 - spill
    half = int(reach / pitch)
    box = np.stack(np.meshgrid(*[np.arange(-half, half + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    room = measure(pitch * (box + shift) @ axes).min(0)
    fit = box[room > least]
    low, high = (fit.min(0), fit.max(0)) if len(fit) else (np.zeros(3, int), np.zeros(3, int))
    around = tuple(np.arange(a - 1, b + 2) for a, b in zip(low, high, strict=True))
    at = np.stack(np.meshgrid(*around, indexing="ij"), -1).reshape(-1, 3)
    inner = np.asarray(((at >= low) & (at <= high)).all(1))
    nodes = pitch * (at + shift) @ axes
    room = measure(nodes)
    for _ in range(3):  # tries to move a node to where the tube fits better
        # nodes are moved to where the tube fits better
        near = np.flatnonzero(inner & (room.min(0) < 1.0) & (room.min(0) > -1.0))
        short = np.clip(1.0 - room[:, near], 0.0, None) * (0.5 * limits.radius)
        steps = (s.inwards(nodes[near]) * by[:, None] for s, by in zip(sights, short, strict=True))
        away = nodes[near] + sum(steps) - pitch * (at[near] + shift) @ axes
        far = np.linalg.norm(away, axis=1) / (NUDGED * pitch)
        moved = pitch * (at[near] + shift) @ axes + away / np.maximum(far, 1.0)[:, None]
        there = measure(moved)
        better = there.min(0) > room[:, near].min(0)
        nodes[near[better]], room[:, near[better]] = moved[better], there[:, better]
    empty = Lattice(
        nodes,
        tuple(len(a) for a in around),
        axes,
        pitch,
        np.where(room > -_FAR, np.clip(0.5 * (1.0 - room), 0.0, 1.0), _FAR).sum(0),
        inner,
        np.zeros(3 * len(nodes), bool),
        np.zeros(3 * len(nodes) + 1, np.int64),
        np.zeros(0, np.int32),
    )
    free = inner & (room.min(0) > least)
    opened = np.zeros((len(nodes), 3), dtype=bool)
    for axis, stride in enumerate(empty.strides.tolist()):
        first = np.flatnonzero(free[:-stride] & free[stride:])
        length = np.linalg.norm(nodes[first + stride] - nodes[first], axis=1)
        first = first[length > _SHORTEST * pitch]
        opened[first, axis] = measure(0.5 * (nodes[first] + nodes[first + stride])).min(0) > least
    return draw_edges(empty, opened.ravel(), sights, limits.radius)


def draw_edges(lattice: Lattice, opened: Flags, sights: Sequence[Sight], radius: float) -> Lattice:
    """Draw the lattice with these edges (3 n,) open, and what a tube of this radius, mm, draws along each."""
    edges = np.flatnonzero(opened)
    one, two = (lattice.nodes[end] for end in lattice.ends(edges))
    counts = np.zeros(len(edges), dtype=np.int64)
    seen = []
    for s in sights:
        (p, near), (q, far) = s.look(one), s.look(two)
        seen.append((p, q, 0.5 * radius * (near + far), np.array(s.depth.shape), s.first))
        _draw(*seen[-1], counts, np.zeros(0, np.int32))
    starts = np.zeros(len(opened) + 1, dtype=np.int64)
    starts[edges + 1] = counts
    starts = np.cumsum(starts)
    cells, at = np.zeros(starts[-1], dtype=np.int32), starts[edges]
    if len(cells):
        for drawn in seen:
            _draw(*drawn, at, cells)
    return replace(lattice, open=opened, starts=starts, cells=cells)
