"""Make the start for several views: curves of known type, grown on a lattice in the visual hull."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.geometry.polylines import polylines_of
from knotfab.picture.silhouette import pieces_of
from knotfab.problem import Problem, Start, TargetView
from knotfab.render.image import ViewImage
from knotfab.start.grow import Growth, grow_curves
from knotfab.start.lattice import Lattice, Sight, draw_edges, lattice_in, sights_of
from knotfab.start.lattice_knots import find_place, lattice_knot
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.search import SearchSettings

_SEEN_PX = 160  # longer side of the images that starts are compared by
_REACH = 1.2  # half the side of the lattice's box, over the silhouettes' extent
_TURNS = (0.0, 45.0)  # turns of the lattices to try, degrees from where edges face no view
_SHIFTS = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5))  # their shifts, in pitches
# how far a ball of the tube may stand out of a silhouette, in tube radii, so that strokes hardly wider than
# the tube get strands there and back; its spill counts against an edge, and 1.0 would bridge gaps
_SPILL = 0.75
_GROWN = (
    "grown from disjoint unit squares on a lattice, each move over an empty square: an isotopy, and so an "
    "unlink of unknots; its corners rounded within half an edge, where no other strand is"
)
_KNOTTED = "takes the place of the first square"


def start_between_views(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    knots: int | None = None,
    spacing: float = 1.0,
) -> Start:
    """Grow a start in the visual hull, on the lattice whose curves draw the worst picture best.

    Args:
        radius: of the tube, mm.
        knots: None for one curve a piece of the hull, or the number of curves to bridge or split pieces to.
        spacing: least pitch of the lattice, in tube diameters.

    Raises:
        SceneError: no closed tube fits into the silhouettes, or the knot does not.
    """
    wanted = parse_knot_name(problem.knot)
    knot = lattice_knot(wanted.factors) if wanted.factors else None
    why = _GROWN if knot is None else f"{_GROWN}; {wanted.promise} of the lattice {_KNOTTED}"
    limits = problem.limits(radius)
    pitch = 1.001 * max(limits.separation, 2.0 * spacing * radius)
    sights, worth = sights_of(problem.views, radius)
    parts = label_parts(sights)
    reach = _REACH * max(float(np.abs(p.bounds).max()) for p in problem.polygons)
    images = [v.image_at(radius, _SEEN_PX) for v in problem.views]
    how = Growth(seed=settings.seed)
    brief = replace(how, moves=how.moves // 5)  # enough to compare lattices

    def grow(lattice: Lattice, seeds: list[Indices], how: Growth) -> Start:
        curves = grow_curves(lattice, worth, edge_worth(lattice, worth), seeds, how)
        types = (wanted.promise, *("unknot" for _ in curves[1:]))
        rounded = tuple(_round_corners(lattice.nodes[c]) for c in curves)
        start = Start(rounded, why, types, facing=None)
        return replace(start, ious=_compare(images, start, radius))

    best: tuple[tuple[int, float], Lattice] | None = None
    for axes, shift in _lattices(problem.views):
        lattice = lattice_in(sights, axes, shift, pitch, reach, limits, _SPILL)
        seeds = seed_curves(lattice, worth, parts, None, knot)
        drawn = min(grow(lattice, seeds, brief).ious) if seeds else 0.0
        # a small part of a picture that one lattice misses, such as an eye, another has room for
        kept = count_parts(lattice, worth, parts)
        if best is None or (kept, drawn) > best[0]:
            best = (kept, drawn), lattice
    assert best is not None
    lattice = join_pieces(best[1], sights, worth, parts, radius, knots)
    seeds = seed_curves(lattice, worth, parts, knots, knot)
    if not seeds and knot is not None and seed_curves(lattice, worth, parts, knots):
        raise SceneError(
            f"the knot {problem.knot}",
            f"what the pictures leave has no place for it in a tube {2 * radius:g} mm thick",
            "Use a thinner tube (--tube-radius), bolder pictures, or a simpler knot.",
        )
    if not seeds:
        raise SceneError(
            "the pictures",
            f"no closed curve of a tube {2 * radius:g} mm thick fits into all of their silhouettes at once",
            "Use bolder pictures, views further apart, or give a smaller radius (--tube-radius)",
        )
    if len(seeds) < (knots or 0):
        raise SceneError(
            f"{knots} knots (--knots)",
            f"what the pictures leave has room for {len(seeds)} of a tube {2 * radius:g} mm thick",
            "Ask for fewer, or give a smaller radius (--tube-radius)",
        )
    return grow(lattice, seeds, how)


def start_ious(problem: Problem, start: Start, radius: float) -> tuple[float, ...]:
    """Return the IoU of the start's tube with each view's picture, on a coarse image."""
    return _compare([v.image_at(radius, _SEEN_PX) for v in problem.views], start, radius)


def _compare(images: Sequence[ViewImage], start: Start, radius: float) -> tuple[float, ...]:
    points = np.concatenate(start.curves)
    rings = polylines_of(start.curves)
    return tuple(image.iou(points, rings, radius) for image in images)


def _lattices(views: Sequence[TargetView]) -> Iterator[tuple[Array, Array]]:
    """Yield the axes (rows of 3 x 3) and shifts (3,) of upright lattices whose edges face no view."""
    along = np.array([np.degrees(np.arctan2(v.axes[2, 0], v.axes[2, 2])) for v in views])
    every = np.arange(0.0, 90.0, 7.5)
    off = np.abs((every[:, None] - along + 45.0) % 90.0 - 45.0).min(1)
    for turn, shift in product(_TURNS, _SHIFTS):
        angle = np.radians(every[off.argmax()] + turn)
        right = np.array([np.cos(angle), 0.0, -np.sin(angle)])
        up = np.array([0.0, 1.0, 0.0])
        yield np.stack([right, up, np.cross(right, up)]), np.array(shift)


def _round_corners(curve: Array) -> Array:
    """Cut a closed polyline's corners twice (Chaikin 1974); each stays within its own unit square."""
    for _ in range(2):
        ahead = np.roll(curve, -1, axis=0)
        curve = np.stack([0.75 * curve + 0.25 * ahead, 0.25 * curve + 0.75 * ahead], 1).reshape(
            -1, 3
        )
    return curve


# The pieces of the lattice: one curve for each, and bridges between them.

_LEAST = 2.0  # worth, in edges, that a piece must draw alone to get a curve
_MOST = 0.5  # or the share of a picture's piece
_STEP = 0.02  # price of a bridge over a square within the hull; 1 is one seen wholly outside
# how far a bridge's middle may be seen outside, in tube radii, to count as within the hull
_NECK = 0.5


def edge_worth(lattice: Lattice, worth: Array) -> float:
    """Return the worth of an edge that draws its length in a single view; `worth` is that of the cells."""
    total = float(np.maximum(worth[lattice.cells], 0.0).sum()) / max(1, int(lattice.open.sum()))
    return total / max(1, round(float(worth[worth > 0].sum())))


def label_parts(sights: Sequence[Sight]) -> Indices:
    """Number the pieces of all pictures, by cell, from 1; 0 beside them."""
    labels, count = [], 0
    for sight in sights:
        own, _ = pieces_of(sight.drawn if sight.drawn is not None else sight.depth > 0)
        labels.append(np.where(own > 0, own + count, 0).ravel())
        count = max(count, int(labels[-1].max(initial=0)))
    return np.concatenate(labels).astype(np.int64)


def _pieces(lattice: Lattice, worth: Array, parts: Indices) -> tuple[list[Indices], int]:
    """Return the squares (k, 4) of each piece of the hull that draws something beyond larger ones.

    The largest comes first. To count, a piece must draw as much as some edges do, or most of a picture's
    piece, such as an eye. The second value is the number of pictures' pieces that are mostly drawn.
    """
    squares = lattice.squares(lattice.open)
    # curves grow from square to square over shared edges
    one, two = np.repeat(squares[:, 0], 3), squares[:, 1:].ravel()
    linked = csr_array((np.ones(len(one)), (one, two)), shape=(len(lattice.open),) * 2)
    piece = connected_components(linked, directed=False)[1][squares[:, 0]]
    names, sizes = np.unique(piece, return_counts=True)
    left, found = worth.copy(), []
    least = _LEAST * edge_worth(lattice, worth)
    # cells of each piece of a picture, and those that nothing draws so far
    bare = np.bincount(parts)
    most = (1.0 - _MOST) * bare
    for name in names[np.argsort(-sizes, kind="stable")]:
        mine = squares[piece == name]
        drawn = lattice.drawn_by(np.unique(mine))
        new = drawn[left[drawn] > 0]
        after = bare - np.bincount(parts[new], minlength=len(bare))
        whole = ((bare > most) & (after <= most))[1:].any()
        if whole or left[drawn].sum() > least:
            left[drawn], bare = 0.0, after
            found.append(mine)
    return found, int((bare <= most)[1:].sum())


def count_parts(lattice: Lattice, worth: Array, parts: Indices) -> int:
    """Count the pieces of pictures most of which curves on this lattice can draw."""
    return _pieces(lattice, worth, parts)[1]


def _corners(lattice: Lattice, squares: Indices) -> Indices:
    """Return the nodes of squares in cyclic order, (k, 4)."""
    one, two, three, _ = (lattice.ends(edges) for edges in squares.T)
    return np.stack([one[0], one[1], two[1], three[0]], axis=1)


def join_pieces(
    lattice: Lattice,
    sights: Sequence[Sight],
    worth: Array,
    parts: Indices,
    radius: float,
    knots: int | None,
) -> Lattice:
    """Open edges of the lattice that join pieces, over squares that spill least.

    Args:
        radius: of the tube, mm.
        knots: None joins only pieces that are one in the visual hull, with necks too narrow for the lattice;
            a number then also bridges gaps until that many pieces are left.
    """
    pieces, _ = _pieces(lattice, worth, parts)
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

    # a bridge leads from the midpoint of an edge through the square's centre to another edge
    least = np.minimum(room(middles + 0.5 * (centres - middles)), room(centres))
    least = np.minimum(least, room(crossed)[at].reshape(squares.shape))
    outside = np.maximum(-least, 0.0) / radius
    spill = lattice.spill[ends].mean((0, 2))[:, None]
    price = _STEP + spill + np.where(outside < _NECK, 10.0 * outside, 100.0)
    of = np.broadcast_to(count + np.arange(len(squares))[:, None], squares.shape)
    opened = lattice.open.copy()
    # first join within the hull; then across gaps until `knots` groups remain
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
    lattice: Lattice, worth: Array, parts: Indices, knots: int | None, knot: Indices | None = None
) -> list[Indices]:
    """Choose the disjoint seeds, as nodes, that curves grow from: unit squares (4,), or first a knot (n,).

    Fewer than `knots` may be found, and none if the largest piece has no place for the knot.

    Args:
        knots: None for one a piece; a larger number splits pieces.
        knot: a lattice knot (n, 3) that takes the place of the first square.
    """
    pieces, _ = _pieces(lattice, worth, parts)
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
    for squares in corners[len(seeds) :]:
        # pieces may touch at a node, which only one seed may take
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
        if apart.max() < 2.0 * lattice.pitch:  # nearer squares may share a node
            break
        seeds.append(every[apart.argmax()])
    return seeds
