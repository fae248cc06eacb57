"""Planar diagrams of polygons in space, seen from directions in which they cross least.

A diagram is made only if every sign that it rests on is certain in spite of rounding: which edges cross,
which one is above, and the order of the crossings along each edge. Other directions are skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.knots.planar_diagram import Passage, PlanarDiagram, from_passages, simplify
from knotfab_validators.knots.reduction import (
    UNCERTAIN,
    Ring,
    adjacent,
    certain_sign,
    determinants,
    ring_of,
)

DIRECTIONS = 40
FEWEST = 3
MOST_LOOKS = 10_000  # edges times directions that are looked at
HOPELESS = 8  # a direction with so many times too many crossings shows that no other will do
KEPT = 6  # projections with the fewest crossings, which are simplified and compared
ALL_PAIRS = 150  # edges up to which all pairs are compared


def diagram_of(
    polygons: Sequence[Array], *, directions: int = DIRECTIONS, most: int, seed: int = 0
) -> PlanarDiagram | None:
    """Return the simplest diagram of closed polygons (n, 3) found among random directions.

    Component k of the diagram is polygons[k]. None where all have more than `most` crossings before
    they are simplified, or where no direction is certain.
    """
    ring = ring_of(polygons)
    directions = min(directions, max(FEWEST, MOST_LOOKS // len(ring.at)))
    towards = np.random.default_rng(seed).normal(size=(directions, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    counts: list[int] = []
    for eye in towards:
        counts.append(_count_crossings(ring, eye))
        if min(counts) > HOPELESS * most:
            return None
    best: PlanarDiagram | None = None
    found = 0
    for k in np.argsort(counts, kind="stable"):
        if counts[k] > most or found == KEPT:
            break
        diagram = seen_from(polygons, towards[k])
        if diagram is None:
            continue
        found += 1
        diagram = simplify(diagram)
        if best is None or len(diagram.crossings) < len(best.crossings):
            best = diagram
    return best


def seen_from(polygons: Sequence[Array], towards: Array) -> PlanarDiagram | None:
    """Return the diagram seen from far off in direction `towards` (3,); None if a sign is uncertain."""
    ring = ring_of(polygons)
    crossings = _crossings(ring, towards)
    if crossings is None:
        return None
    order = _in_order(crossings)
    if order is None:
        return None
    passages: dict[int, list[Passage]] = {k: [] for k in range(len(polygons))}
    edges = np.concatenate([crossings.over, crossings.under])
    count = len(crossings.sign)
    for n in order:
        knot = int(ring.knot[edges[n]])
        passages[knot].append(Passage(int(n) % count, int(n) < count))
    return from_passages(passages, [int(s) for s in crossings.sign])


@dataclass(frozen=True)
class _Crossings:
    """Crossings: edges above and below, where on them (0 to 1) and with what error, and signs."""

    over: Ints
    over_at: Array
    over_error: Array
    under: Ints
    under_at: Array
    under_error: Array
    sign: Ints


def _in_order(crossings: _Crossings) -> Ints | None:
    """Order all passages along the edges: i is crossing i above, count + i below; None if unsure."""
    edge = np.concatenate([crossings.over, crossings.under])
    at = np.concatenate([crossings.over_at, crossings.under_at])
    error = np.concatenate([crossings.over_error, crossings.under_error])
    order = np.lexsort((at, edge))
    same = edge[order][1:] == edge[order][:-1]
    gap = np.diff(at[order]) > error[order][1:] + error[order][:-1]
    return order.astype(np.int64) if (gap | ~same).all() else None


def _crossings(ring: Ring, towards: Array) -> _Crossings | None:
    """Find where edges cross as seen along a direction; None if it is uncertain."""
    i, j = _pair_edges(ring, towards)
    p, r = ring.at[i], ring.at[j]
    u, v, w = ring.at[ring.after[i]] - p, ring.at[ring.after[j]] - r, r - p
    eye = np.broadcast_to(towards, p.shape)
    sides_j = _signs(u, eye, w), _signs(u, eye, ring.at[ring.after[j]] - p)
    sides_i = _signs(v, eye, -w), _signs(v, eye, ring.at[ring.after[i]] - r)
    apart = (sides_j[0] * sides_j[1] > 0) | (sides_i[0] * sides_i[1] > 0)
    met = (sides_j[0] * sides_j[1] < 0) & (sides_i[0] * sides_i[1] < 0)
    if not (apart | met).all():
        return None
    i, j, u, v, w, eye = i[met], j[met], u[met], v[met], w[met], eye[met]
    turn, height = _signs(u, v, eye), _signs(u, v, w)
    if not (turn.all() and height.all()):
        return None
    base = determinants(u, v, eye)
    s, t = determinants(w, v, eye) / base, determinants(w, u, eye) / base
    size_u, size_v, size_w = (np.linalg.norm(x, axis=1) for x in (u, v, w))
    error = 2 * UNCERTAIN * (size_u * size_v) / np.abs(base)
    s_error = error + UNCERTAIN * size_w * size_v / np.abs(base)
    t_error = error + UNCERTAIN * size_w * size_u / np.abs(base)
    # the other edge is above if one must go up to reach it: det(u, v, w) / det(u, v, eye) > 0
    below = turn == height
    return _Crossings(
        over=np.where(below, j, i),
        over_at=np.where(below, t, s),
        over_error=np.where(below, t_error, s_error),
        under=np.where(below, i, j),
        under_at=np.where(below, s, t),
        under_error=np.where(below, s_error, t_error),
        sign=np.where(below, -turn, turn).astype(np.int64),
    )


def _signs(u: Array, v: Array, w: Array) -> NDArray[np.int8]:
    return certain_sign(u, v, w)


def _pair_edges(ring: Ring, towards: Array) -> tuple[Ints, Ints]:
    """Return pairs of edges i < j that may cross: not adjacent, with overlapping boxes in the projection."""
    flat = ring.at @ _axes_across(towards)
    end = flat[ring.after]
    margin = 1e-12 * float(np.abs(flat).max())  # many times the rounding error of the product above
    low, high = np.minimum(flat, end) - margin, np.maximum(flat, end) + margin
    count = len(flat)
    if count <= ALL_PAIRS:
        i, j = np.triu_indices(count, 1)
        keep = ((low[i] <= high[j]) & (low[j] <= high[i])).all(axis=1)
        i, j = i[keep], j[keep]
    else:
        boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
        i, j = shapely.STRtree(boxes).query(boxes)
        i, j = i[i < j], j[i < j]
    keep = ~adjacent(ring, i, j)
    return i[keep].astype(np.int64), j[keep].astype(np.int64)


def _count_crossings(ring: Ring, towards: Array) -> int:
    """Count the crossings seen along a direction, up to rounding."""
    flat = ring.at @ _axes_across(towards)
    i, j = _pair_edges(ring, towards)
    p, q, r, s = flat[i], flat[ring.after[i]], flat[j], flat[ring.after[j]]

    def side(a: Array, b: Array, c: Array) -> Array:
        one, other = b - a, c - a
        return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])

    crossed = (side(p, q, r) * side(p, q, s) < 0) & (side(r, s, p) * side(r, s, q) < 0)
    return int(crossed.sum())


def _axes_across(towards: Array) -> Array:
    """Return two orthogonal axes (3, 2) across a direction."""
    return np.asarray(np.linalg.svd(towards[None])[2][1:].T)


# Representations of a knot's group in PSL(2, p) distinguish knots and hands that polynomials do not.

PRIMES = (7, 11)  # primes that distinguish all knots of the table whose other invariants are equal
MOST_GUESSES = 3  # arcs whose colours are guessed, beside the first

# arcs below before and after a crossing, the arc above it, and its sign
Relation = tuple[int, int, int, int]


def cusp_counts(knot: PlanarDiagram, prime: int) -> tuple[int, ...] | None:
    """Count the representations that send the longitude to z -> z + k, for k = 0 to prime - 1.

    None where the diagram asks for too many guesses.
    """
    arcs, relations = _wirtinger(knot)
    guessed = _fewest_guesses(max(arcs) + 1, relations, arcs[0])
    if guessed is None:
        return None
    vectors = np.array(
        [(x, y) for x in range(prime) for y in range(prime) if (x, y) <= (-x % prime, -y % prime)]
    )[1:]  # one of each pair of opposite signs, without (0, 0)
    tries = np.stack(np.meshgrid(*[np.arange(len(vectors))] * len(guessed), indexing="ij"), -1)
    tries = tries.reshape(-1, len(guessed))
    colours = {arc: vectors[tries[:, k]] for k, arc in enumerate(guessed)}
    colours[arcs[0]] = np.broadcast_to([1, 0], (len(tries), 2))
    for below, after, above, sign in _order_relations(set(colours), relations):
        if after not in colours:
            colours[after] = _turn(colours[below], colours[above], sign, prime)
        else:
            colours[below] = _turn(colours[after], colours[above], -sign, prime)
    fits = np.ones(len(tries), bool)
    for below, after, above, sign in relations:
        met = _turn(colours[below], colours[above], sign, prime)
        same, opposite = ((met - s * colours[after]) % prime == 0 for s in (1, -1))
        fits &= same.all(axis=1) | opposite.all(axis=1)
    ends = _longitude(knot, arcs, {arc: colour[fits] for arc, colour in colours.items()}, prime)
    return tuple(int(n) for n in np.bincount(ends, minlength=prime))


def _wirtinger(knot: PlanarDiagram) -> tuple[list[int], list[Relation]]:
    """Number the strand (between two undercrossings) of each arc, and list the relations of the strands."""
    begins = {quad[2] for quad in knot.crossings}
    numbers = np.cumsum([arc in begins for arc in range(len(knot.component))])
    strand = [int(n) % len(begins) for n in numbers]
    relations = [
        (strand[a], strand[c], strand[b], sign)
        for (a, b, c, _), sign in zip(knot.crossings, knot.signs, strict=True)
    ]
    return strand, relations


def _fewest_guesses(
    count: int, relations: Sequence[Relation], first: int
) -> tuple[int, ...] | None:
    """Return the fewest strands whose colours, with the first one's, determine all `count` colours."""
    others = [arc for arc in range(count) if arc != first]
    for size in range(MOST_GUESSES + 1):
        for guessed in combinations(others, size):
            known = {first, *guessed}
            _order_relations(known, relations)
            if len(known) == count:
                return guessed
    return None


def _order_relations(known: set[int], relations: Sequence[Relation]) -> list[Relation]:
    """Order the relations so that each gives one more colour; these are added to `known`."""
    order: list[Relation] = []
    grown = True
    while grown:
        grown = False
        for relation in relations:
            below, after, above, _ = relation
            if above in known and (below in known) != (after in known):
                known |= {below, after}
                order.append(relation)
                grown = True
    return order


def _turn(vectors: Ints, about: Ints, sign: int, prime: int) -> Ints:
    """Act on vectors (n, 2) by the parabolic elements of `about`, or by their inverses."""
    area = about[:, 0] * vectors[:, 1] - about[:, 1] * vectors[:, 0]
    return np.asarray((vectors + sign * area[:, None] * about) % prime)


def _longitude(
    knot: PlanarDiagram, strand: list[int], colours: dict[int, Ints], prime: int
) -> Ints:
    """Return the k of z -> z + k to which each representation sends the first strand's longitude."""
    below = {a: (strand[b], s) for (a, b, _, _), s in zip(knot.crossings, knot.signs, strict=True)}
    first = colours[strand[0]]
    images = [np.broadcast_to(v, first.shape) for v in ([1, 0], [0, 1])]
    for arc in reversed(range(len(knot.component))):
        if arc in below:
            above, sign = below[arc]
            images = [_turn(image, colours[above], -sign, prime) for image in images]
    # the longitude is ((s, s k), (0, s)) with s = 1 or -1; it winds around the knot without twisting
    (s, _), (_, _) = images[0].T, images[1].T
    return np.asarray((images[1][:, 0] * s + knot.writhe) % prime)
