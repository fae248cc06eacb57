"""Build the lattice in the visual hull on which curves for several views grow, with what its edges draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from knotfab.base.arrays import Array, Indices
from knotfab.base.compiled import compiled
from knotfab.limits.region import tube_outside
from knotfab.limits.terms import Limits
from knotfab.picture.silhouette import signed_distance
from knotfab.problem import TargetView
from knotfab.render.image import grid_at

Cells = NDArray[np.int32]
Flags = NDArray[np.bool_]

_CELL = 0.35  # side of the cells on which views are drawn, in tube radii
_MARGIN = 0.25  # margin around the frame on each side, as a share of it
NUDGED = 0.25  # longest move of a node, over the pitch: strands stay half a pitch apart
_SHORTEST = 0.8  # shortest edge between moved nodes, over the pitch
_FAR = 10.0  # distance outside the silhouettes, in tube radii, that stands for outside the region


@dataclass(frozen=True)
class Sight:
    """One view as a grid of cells on which the lattice is drawn.

    `depth` (H, W) is the distance inside the silhouette, in cells, negative outside. `projection` (3, 4) maps
    to cells, and `near` is the number of cells per mm where w = 1. Cells are numbered from `first`. If the
    screen ends at the frame, all beside it counts as inside, and `drawn` (H, W) is the picture.
    """

    depth: Array
    projection: Array
    near: float
    first: int
    drawn: Flags | None = None

    def draws(self, points: Array) -> Flags:
        """Return whether each point (n, 3) is seen on the picture; always true if the screen does not end."""
        if self.drawn is None:
            return np.ones(len(points), dtype=bool)
        seen, _ = self.look(points)
        return np.asarray(self._at(self.drawn.astype(float), seen) > 0.5)

    def look(self, points: Array) -> tuple[Array, Array]:
        """Project points (n, 3) to cells, (n, 2), and return the number of cells per mm there, (n,)."""
        h = points @ self.projection[:, :3].T + self.projection[:, 3]
        return h[:, :2] / h[:, 2:], self.near / h[:, 2]

    def room(self, points: Array) -> Array:
        """Return how deep inside the silhouette the light sees points (n, 3), in mm at the points, (n,)."""
        seen, scale = self.look(points)
        return self._at(self.depth, seen) / scale

    def inwards(self, points: Array) -> Array:
        """Return unit steps that lead points further inside the silhouette, (n, 3); 0 on a plateau."""
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
    """A padded box of nodes, the edges that curves may take, and the cells that each edge draws.

    `nodes` (n, 3), mm, form an array of `shape` along the `axes` (rows of 3 x 3), `pitch` mm apart. `spill`
    (n,) is the share of the tube that is seen outside there, summed over the views. `inner` marks the nodes
    that are not padding. Edge 3 * node + axis leads from a node along an axis; `open` (3 n,) marks the edges
    that may be taken, and `cells[starts[e] : starts[e + 1]]` are what edge e draws in all views.
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
        """The difference of node numbers along each axis, (3,)."""
        return np.array([self.shape[1] * self.shape[2], self.shape[2], 1], dtype=np.int64)

    def ends(self, edges: Indices) -> tuple[Indices, Indices]:
        """Return the nodes at both ends of edges (k,)."""
        return edges // 3, edges // 3 + self.strides[edges % 3]

    def squares(self, opened: Flags) -> Indices:
        """Return the unit squares whose edges are all in `opened` (3 n,), by their edges, (k, 4)."""
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
    """Return the views as grids for a tube of this radius, mm, and the worth of drawing each cell.

    The cells of a view's silhouette are worth 1 together; each cell outside costs as much as one inside.
    """
    found, worth, first = [], [], 0
    for target in views:
        cell = _CELL * radius * target.view.magnification
        wanted, camera = grid_at(target.view, target.mask, cell, _MARGIN, more=8)
        given = (target.view, target.mask, cell, _MARGIN)
        allowed = grid_at(*given, more=8, beside=True)[0] if target.ends else wanted
        near = 1.0 / float(np.linalg.norm(camera.du))
        drawn = wanted if target.ends else None
        found.append(Sight(signed_distance(allowed), camera.projection, near, first, drawn))
        cost = np.where(allowed, 0.0, -1.0)
        worth.append(np.where(wanted, 1.0, cost).ravel() / max(1, wanted.sum()))
        first += wanted.size
    return found, np.concatenate(worth)


@compiled
def _draw(
    one: Array, two: Array, wide: Array, shape: Indices, first: int, at: Indices, cells: Cells
) -> None:
    """Advance `at` (k,) by the number of cells in each edge's capsule; fill `cells` unless it is empty."""
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
    """Build the lattice along `axes` (rows of 3 x 3) whose edges are open where a tube fits all silhouettes.

    Args:
        shift: offset of the nodes from the origin, in pitches (3,). reach: half the side of the box, mm.
        spill: how far a ball of the tube, about a node or an edge's midpoint, may stand out of a silhouette,
            in tube radii.
    """

    def measure(points: Array) -> Array:
        """Return how deep inside each silhouette the points are seen, in tube radii (views, n).

        It is `-_FAR` outside the region, and where a point draws on no screen.
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
    for _ in range(3):  # move nodes to where the tube fits better
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
    """Return the lattice with these edges (3 n,) open and the cells that a tube of this radius (mm) draws."""
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
