"""The pieces of the lattice in the hull: one curve for each, and where pieces are bridged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import label
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from knotfab.arrays import Array, Indices
from knotfab.start.lattice import Lattice, Sight, draw_edges

__all__ = ["edge_worth", "join_pieces", "seed_squares"]


_LEAST = 2.0  # edges' worth that only this piece draws, or it gets no curve
_STEP = (
    0.05  # of a bridge over a square in the hull, against one whose corners are a radius outside
)


def edge_worth(lattice: Lattice, worth: Array) -> float:
    """What an edge is worth that draws its own length in one view alone; `worth` is that of the cells."""
    total = float(np.maximum(worth[lattice.cells], 0.0).sum()) / max(1, int(lattice.open.sum()))
    return total / max(1, round(float(worth[worth > 0].sum())))


def _pieces(lattice: Lattice, worth: Array) -> list[Indices]:
    """The squares (k, 4) of each piece that draws what larger ones leave, those of the largest first."""
    squares = lattice.squares(lattice.open)
    one, two = lattice.ends(np.unique(squares))
    linked = csr_array((np.ones(len(one)), (one, two)), shape=(len(lattice.nodes),) * 2)
    of_node = connected_components(linked, directed=False)[1]
    piece = of_node[squares[:, 0] // 3] if len(squares) else np.zeros(0, int)
    names, sizes = np.unique(piece, return_counts=True)
    left, found = worth.copy(), []
    least = _LEAST * edge_worth(lattice, worth)
    for name in names[np.argsort(-sizes, kind="stable")]:
        mine = squares[piece == name]
        drawn = lattice.drawn_by(np.unique(mine))
        if left[drawn].sum() > least:
            left[drawn] = 0.0
            found.append(mine)
    return found


def _hull_labels(lattice: Lattice, sights: Sequence[Sight]) -> Indices:
    """(n,) the connected piece of the visual hull that each node lies in, at half the pitch; 0: none."""
    shape = 2 * np.array(lattice.shape) - 1
    at = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 3)
    points = lattice.nodes[0] + 0.5 * lattice.pitch * at @ lattice.axes
    room = np.min([s.room(points) for s in sights], axis=0)
    return np.asarray(label((room > 0).reshape(shape))[0][::2, ::2, ::2].ravel())


def _corners(lattice: Lattice, squares: Indices) -> Indices:
    """(k, 4) the nodes of squares, one after the other."""
    one, two, three, _ = (lattice.ends(edges) for edges in squares.T)
    return np.stack([one[0], one[1], two[1], three[0]], axis=1)


def join_pieces(
    lattice: Lattice, sights: Sequence[Sight], worth: Array, radius: float, knots: int | None
) -> Lattice:
    """The lattice with edges opened that join pieces, over squares that show least.

    Args:
        radius: of the tube, mm.
        knots: None: pieces are joined that one piece of the visual hull holds, too narrow between them for
            the lattice; a number: the nearest, until so many are left.
    """
    pieces = _pieces(lattice, worth)
    if len(pieces) < 2:
        return lattice
    hull = np.zeros(len(lattice.nodes), int) if knots else _hull_labels(lattice, sights)
    groups = [(np.unique(p), int(hull[p[0, 0] // 3])) for p in pieces]
    count = 3 * len(lattice.nodes)
    between = np.repeat(lattice.inner, 3)
    for axis, stride in enumerate(lattice.strides.tolist()):
        between[axis::3] &= np.roll(lattice.inner, -stride)
    squares = lattice.squares(between)
    corners = _corners(lattice, squares)
    price = _STEP + lattice.spill[corners].mean(1)
    one = np.repeat(count + np.arange(len(squares)), 4)
    graph = csr_array(
        (np.repeat(price, 4), (one, squares.ravel())), shape=(count + len(squares),) * 2
    )
    opened = lattice.open.copy()
    while len(groups) > (knots or 1):
        alike = [
            [g for g in groups if g[1] == name] for name in dict.fromkeys(g[1] for g in groups)
        ]
        several = next((a for a in alike if len(a) > 1), None)
        if several is None:
            break
        mine = several[-1]
        others = np.concatenate([edges for edges, _ in several[:-1]])
        far_away, came, _ = dijkstra(graph, False, mine[0], return_predecessors=True, min_only=True)
        place = int(others[far_away[others].argmin()])
        if not np.isfinite(far_away[place]):
            break
        met = next(g for g in several[:-1] if place in g[0])
        way = []
        while came[place] >= 0:
            place = int(came[place])
            if place >= count:
                way.append(squares[place - count])
        bridge = np.unique(np.concatenate([np.zeros(0, int), *way]))
        opened[bridge] = True
        groups = [g for g in groups if g is not mine and g is not met]
        groups.insert(0, (np.concatenate([met[0], mine[0], bridge]), mine[1]))
    return draw_edges(lattice, opened, sights, radius)


def seed_squares(lattice: Lattice, worth: Array, knots: int | None) -> list[Indices]:
    """The nodes (4,) around a unit square for each curve, none of which shares a node with another.

    Args:
        knots: None for one a piece; more than there are pieces part them. Fewer may be found.
    """
    pieces = _pieces(lattice, worth)
    if not pieces:
        return []
    corners = [_corners(lattice, p) for p in pieces]
    seeds = [c[len(c) // 2] for c in corners]
    every = np.concatenate(corners)
    middle = lattice.nodes[every].mean(1)
    while len(seeds) < (knots or 0):
        apart = np.min(
            [np.linalg.norm(middle - lattice.nodes[s].mean(0), axis=1) for s in seeds], axis=0
        )
        if apart.max() < 2.0 * lattice.pitch:  # squares that near each other may share a node
            break
        seeds.append(every[apart.argmax()])
    return seeds
