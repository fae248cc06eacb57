"""The pieces of the lattice in the hull: one curve for each, and where pieces are bridged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from knotfab.base.arrays import Array, Indices
from knotfab.start.lattice import Lattice, Sight, draw_edges
from knotfab.start.lattice_knots import find_place

__all__ = ["edge_worth", "join_pieces", "seed_curves"]


_LEAST = 2.0  # edges' worth that only this piece draws, or it gets no curve
# the price of a bridge over a square in the hull, where 1 is over one seen wholly outside
_STEP = 0.02
_NECK = 0.5  # tube radii that a bridge's middle may be seen outside: a gap of twice that is one


def edge_worth(lattice: Lattice, worth: Array) -> float:
    """Return the worth of an edge that draws its own length in one view alone; `worth` is the cells'."""
    total = float(np.maximum(worth[lattice.cells], 0.0).sum()) / max(1, int(lattice.open.sum()))
    return total / max(1, round(float(worth[worth > 0].sum())))


def _pieces(lattice: Lattice, worth: Array) -> list[Indices]:
    """Give the squares (k, 4) of each piece that draws what larger ones leave, those of the largest first."""
    squares = lattice.squares(lattice.open)
    # a curve grows from square to square over the edge that they share
    one, two = np.repeat(squares[:, 0], 3), squares[:, 1:].ravel()
    linked = csr_array((np.ones(len(one)), (one, two)), shape=(len(lattice.open),) * 2)
    piece = connected_components(linked, directed=False)[1][squares[:, 0]]
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


def _corners(lattice: Lattice, squares: Indices) -> Indices:
    """Return (k, 4) the nodes of squares, one after the other."""
    one, two, three, _ = (lattice.ends(edges) for edges in squares.T)
    return np.stack([one[0], one[1], two[1], three[0]], axis=1)


def join_pieces(
    lattice: Lattice, sights: Sequence[Sight], worth: Array, radius: float, knots: int | None
) -> Lattice:
    """Return the lattice with edges opened that join pieces, over squares that show least.

    Args:
        radius: radius of the tube, mm.
        knots: None: pieces are joined that the visual hull holds as one, too narrow between them for the
            lattice; a number: then the nearest also across gaps, until so many are left.
    """
    pieces = _pieces(lattice, worth)
    if len(pieces) < 2:
        return lattice
    groups = [np.unique(p) for p in pieces]
    count = 3 * len(lattice.nodes)
    between = np.repeat(lattice.inner, 3)
    for axis, stride in enumerate(lattice.strides.tolist()):
        between[axis::3] &= np.roll(lattice.inner, -stride)
    squares = lattice.squares(between)
    ends = np.stack(lattice.ends(squares))
    edges, at = np.unique(squares, return_inverse=True)
    crossed = 0.5 * lattice.nodes[np.stack(lattice.ends(edges))].sum(0)  # the edges' middles
    middles = crossed[at.reshape(squares.shape)]  # (k, 4, 3)
    centres = middles.mean(1, keepdims=True)

    def room(points: Array) -> Array:
        least = np.min([s.room(points.reshape(-1, 3)) for s in sights], axis=0)
        return np.asarray(least.reshape(points.shape[:-1]))

    # a bridge leads from the middle of an edge to that of the square, and on
    least = np.minimum(room(middles + 0.5 * (centres - middles)), room(centres))
    least = np.minimum(least, room(crossed)[at].reshape(squares.shape))
    outside = np.maximum(-least, 0.0) / radius
    spill = lattice.spill[ends].mean((0, 2))[:, None]
    price = _STEP + spill + np.where(outside < _NECK, 10.0 * outside, 100.0)
    of = np.broadcast_to(count + np.arange(len(squares))[:, None], squares.shape)
    opened = lattice.open.copy()
    # first within the hull, whatever number is asked for; then also across gaps, if there are more than that
    for kept, until in ((outside < _NECK, 1), (outside < np.inf, knots or len(groups))):
        arcs = (price[kept], (of[kept], squares[kept]))
        graph = csr_array(arcs, shape=(count + len(squares),) * 2)
        alone: list[Indices] = []
        while len(groups) > max(1, until - len(alone)):
            mine = groups.pop()  # the smallest joins its nearest
            others = np.concatenate(groups)
            far, came, _ = dijkstra(graph, False, mine, return_predecessors=True, min_only=True)
            place = int(others[far[others].argmin()])
            if not np.isfinite(far[place]):
                alone.append(mine)
                continue
            met = next(k for k, group in enumerate(groups) if place in group)
            while came[place] >= 0:
                place = int(came[place])
                if place >= count:
                    opened[squares[place - count]] = True
            groups[met] = np.concatenate([groups[met], mine])
        groups += alone[::-1]
    return draw_edges(lattice, opened, sights, radius)


def seed_curves(
    lattice: Lattice, worth: Array, knots: int | None, knot: Indices | None = None
) -> list[Indices]:
    """Return the nodes that each curve grows from; no two curves share one.

    All are unit squares (4,), but for the first where a `knot` (n, 3) of the lattice is asked for.

    Args:
        knots: None for one a piece; more than there are pieces part them. Fewer may be found; none where
            the largest piece has no place for the knot.
    """
    pieces = _pieces(lattice, worth)
    if not pieces:
        return []
    corners = [_corners(lattice, p) for p in pieces]
    every = np.concatenate(corners)
    seeds: list[Indices] = []
    taken = np.zeros(len(lattice.nodes), dtype=bool)
    if knot is not None:
        place = find_place(lattice, np.unique(pieces[0]), knot)
        if place is None:
            return []
        seeds.append(place)
        taken[place] = True
        every = every[~taken[every].any(1)]
    for squares in corners[
        len(seeds) :
    ]:  # pieces may touch at a node, where no two curves may begin
        free = squares[~taken[squares].any(1)]
        if len(free):
            seeds.append(free[len(free) // 2])
            taken[seeds[-1]] = True
    middle = lattice.nodes[every].mean(1)
    while len(seeds) < (knots or 0) and len(every):
        apart = np.min(
            [
                np.linalg.norm(middle[:, None] - lattice.nodes[s], axis=2).min(1)
                if len(s) > 4
                else np.linalg.norm(middle - lattice.nodes[s].mean(0), axis=1)
                for s in seeds
            ],
            axis=0,
        )
        if apart.max() < 2.0 * lattice.pitch:  # squares that near each other may share a node
            break
        seeds.append(every[apart.argmax()])
    return seeds
