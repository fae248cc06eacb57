"""Remove vertices from closed polygons without changing their knot type, as far as possible.

Vertex B between A and C may go if no other edge meets the triangle ABC: pulling B straight to AC is then
an isotopy (Koniaris and Muthukumar, "Knottedness in ring polymers", Phys. Rev. Lett. 66, 1991; Taylor, "A
deeply knotted protein structure", Nature 406, 2000). A polygon that shrinks to a triangle is a proved
unknot; a triangle that nothing else meets is split from the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.curves import nearest_on_two, segment_segment
from knotfab_validators.geometry.mesh import bound_triangles

Signs = NDArray[np.int8]

# The error of the determinant below is at most 8e-16 times its permanent (Shewchuk, "Adaptive
# precision floating-point arithmetic", 1997), which is at most 5.2 times the product of the rows.
UNCERTAIN = 1e-14
NUDGES = (1e-5, 1e-7, 1e-9)  # random shifts into general position, as shares of the shortest edge
# smallest shift, as a share of the coordinates, that rounding does not swallow
LEAST_SHIFT = 64 * 2.0**-52
MOST_PAIRS = 5_000_000  # pairs of triangles and edges to test: some seconds
NEAREST_PAIRS = 300_000  # pairs of edges among which the nearest are looked for
BLOCK = 256  # boxes queried at a time, to bound memory


class TooTangled(Exception):
    """Too many edges are near each other to test them all."""


@dataclass
class Budget:
    """How many pairs of a triangle and an edge may still be tested."""

    pairs: int = MOST_PAIRS

    def spend(self, pairs: int) -> None:
        """Take `pairs` off the budget; raises TooTangled once it is spent."""
        self.pairs -= pairs
        if self.pairs < 0:
            raise TooTangled


@dataclass(frozen=True)
class Reduced:
    """The polygons that are left, (m, 3) each; `components` are their indices among those given.

    Missing ones were proved unknots, split from all others. If none is left, the polygons are a
    proved unknot or unlink.
    """

    polygons: tuple[Array, ...]
    components: tuple[int, ...]

    @property
    def vertices(self) -> int:
        """The number of vertices left."""
        return sum(len(p) for p in self.polygons)


@dataclass(frozen=True)
class Ring:
    """The vertices of all polygons in one array `at` (n, 3), with their polygons and neighbours by index."""

    at: Array
    knot: Ints
    before: Ints
    after: Ints


def reduce_polygons(
    polygons: Sequence[Array], seed: int = 0, shakes: int = 0, budget: Budget | None = None
) -> Reduced:
    """Remove vertices, many at a time, until none can go or the budget is spent.

    Args:
        polygons: (n >= 3, 3) each, in general position (see `general_position`): where signs
            cannot be told the triangle counts as met, so degenerate input only stays longer.
        seed: seed of the order in which vertices are tried. shakes: when nothing can go any more, move
            the vertices about (by isotopies also) and try again, this many times.
    """
    rng = np.random.default_rng(seed)
    ring = ring_of(polygons)
    budget = budget or Budget()
    share, shaken = 0.5, 0
    while len(ring.at):
        ring = _remove_triangles(ring)
        try:
            gone = _find_removable(ring, share, rng, budget)
        except TooTangled:
            break
        if gone.any():
            ring, share = _remove(ring, gone), 0.5
        elif share < 1:
            share = 1.0
        elif shaken < shakes and len(ring.at):
            ring, shaken = _shake(ring, rng), shaken + 1
        else:
            break
    knots = np.unique(ring.knot)
    return Reduced(tuple(ring.at[ring.knot == k] for k in knots), tuple(int(k) for k in knots))


def general_position(polygons: Sequence[Array], seed: int = 0) -> tuple[Array, ...] | None:
    """Return the polygons with each vertex shifted at random by 1e-5 of the shortest edge, or by less.

    The shift is an isotopy: while no vertex moves by more than d, edges that are not adjacent and
    more than 2 d apart do not meet, and adjacent ones that open by more than what d can close do
    not fold onto each other. None means that no shift is small enough: the polygons touch
    themselves or each other, within 4e-9 of the shortest edge.

    Raises:
        TooTangled: too many edges are near each other.
    """
    ring = ring_of(polygons)
    for nudge in NUDGES:
        moved = _shift(ring, nudge, seed)
        if moved is not None:
            return tuple(moved[ring.knot == k] for k in range(len(polygons)))
    return None


def _shift(ring: Ring, nudge: float, seed: int) -> Array | None:
    edge = ring.at[ring.after] - ring.at
    length = np.linalg.norm(edge, axis=1)
    d = nudge * float(length.min())
    if not d > LEAST_SHIFT * float(np.abs(ring.at).max()):
        return None
    unit = edge / length[:, None]
    # Each of two adjacent edges turns by at most asin(2 d / length): |sum of directions| shrinks by
    # no more than twice that.
    opening = np.linalg.norm(unit + unit[ring.before], axis=1)
    if opening.min() < 8 * nudge or _find_closest(ring, 4 * d)[0] < 4 * d:
        return None
    shift = np.random.default_rng(seed).uniform(-1, 1, ring.at.shape) * (d / np.sqrt(3))
    return np.asarray(ring.at + shift)


def orientation(a: Array, b: Array, c: Array, d: Array) -> Signs:
    """Return the sign of det(a - d, b - d, c - d), row by row (n, 3); 0 where rounding might decide."""
    return certain_sign(a - d, b - d, c - d)


def certain_sign(u: Array, v: Array, w: Array) -> Signs:
    """Return the sign of det(u, v, w) for rows (n, 3) of differences; 0 where rounding might decide."""
    det = determinants(u, v, w)
    size2 = np.einsum("ij,ij->i", u, u) * np.einsum("ij,ij->i", v, v) * np.einsum("ij,ij->i", w, w)
    certain = np.abs(det) > UNCERTAIN * np.sqrt(size2)
    return np.where(certain, np.sign(det), 0).astype(np.int8)


def determinants(u: Array, v: Array, w: Array) -> Array:
    """Return det(u, v, w) for rows (n, 3)."""
    return np.asarray(
        u[:, 0] * (v[:, 1] * w[:, 2] - v[:, 2] * w[:, 1])
        + u[:, 1] * (v[:, 2] * w[:, 0] - v[:, 0] * w[:, 2])
        + u[:, 2] * (v[:, 0] * w[:, 1] - v[:, 1] * w[:, 0])
    )


def may_pierce(a: Array, b: Array, c: Array, p: Array, q: Array) -> Mask:
    """Return whether segment pq may meet triangle abc (rows of points); False is certain.

    Where p or q is the triangle's corner a or c, bit for bit, the segment may touch it there.
    """
    result = np.ones(len(a), dtype=bool)
    p_shared = (p == a).all(axis=1) | (p == c).all(axis=1)
    q_shared = (q == a).all(axis=1) | (q == c).all(axis=1)
    side_p = orientation(a, b, c, p)
    side_q = orientation(a, b, c, q)
    result[p_shared & ~q_shared & (side_q != 0)] = False
    result[q_shared & ~p_shared & (side_p != 0)] = False
    result[side_p * side_q > 0] = False
    rest = np.flatnonzero(result & ~p_shared & ~q_shared)
    a, b, c, p, q = a[rest], b[rest], c[rest], p[rest], q[rest]
    turns = np.stack([orientation(p, q, a, b), orientation(p, q, b, c), orientation(p, q, c, a)])
    result[rest[(turns.max(axis=0) > 0) & (turns.min(axis=0) < 0)]] = False
    return result


def ring_of(polygons: Sequence[Array]) -> Ring:
    """Collect the vertices of all polygons, polygon after polygon."""
    sizes = [len(p) for p in polygons]
    return _link(
        np.concatenate(polygons).astype(np.float64), np.repeat(np.arange(len(sizes)), sizes)
    )


def _link(at: Array, knot: Ints) -> Ring:
    """Join each run of equal `knot` into a closed ring."""
    index = np.arange(len(at))
    first = np.flatnonzero(np.diff(knot, prepend=-1))
    last = np.append(first[1:], len(at)) - 1
    after, before = index + 1, index - 1
    after[last[: len(first)]], before[first] = first, last[: len(first)]
    return Ring(at, knot, before, after)


def adjacent(ring: Ring, i: Ints, j: Ints) -> Mask:
    """Return whether edges i and j are equal or share a vertex (edge k begins at vertex k)."""
    return np.asarray((i == j) | (ring.after[i] == j) | (ring.after[j] == i))


def _remove(ring: Ring, gone: Mask) -> Ring:
    return _link(ring.at[~gone], ring.knot[~gone])


def _remove_triangles(ring: Ring) -> Ring:
    """Remove polygons of three vertices whose triangle meets no edge of another polygon."""
    sizes = np.bincount(ring.knot)
    for k in np.flatnonzero(sizes == 3):
        own = np.flatnonzero(ring.knot == k)
        others = np.flatnonzero(ring.knot != k)
        a, b, c = (np.broadcast_to(ring.at[i], (len(others), 3)) for i in own)
        if not may_pierce(a, b, c, ring.at[others], ring.at[ring.after[others]]).any():
            ring = _remove(ring, ring.knot == k)
    return ring


def _find_removable(ring: Ring, share: float, rng: np.random.Generator, budget: Budget) -> Mask:
    """Find vertices that can go together: free ones of the smallest triangles, no two adjacent.

    Removing a vertex adds its triangle's third side as an edge, which must not meet the triangles of the
    other vertices that go.
    """
    gone = np.zeros(len(ring.at), dtype=bool)
    sizes = np.bincount(ring.knot)
    a, b, c = ring.at[ring.before], ring.at, ring.at[ring.after]
    tried = np.flatnonzero(sizes[ring.knot] > 3)
    if not len(tried):
        return gone
    normal = np.cross(a[tried] - b[tried], c[tried] - b[tried])
    area = np.einsum("ij,ij->i", normal, normal)
    tried = tried[area <= np.quantile(area, share)]
    gone[tried] = True
    for t, e in _pair_near(a[tried], b[tried], c[tried], ring.at, ring.at[ring.after], budget):
        own = (e == tried[t]) | (e == ring.before[tried[t]])
        t, e = tried[t[~own]], e[~own]
        gone[t[may_pierce(a[t], b[t], c[t], ring.at[e], ring.at[ring.after[e]])]] = False

    rank = np.where(gone, rng.permutation(len(gone)).astype(np.float64), np.inf)
    gone &= (rank < rank[ring.before]) & (rank < rank[ring.after])
    for k in np.flatnonzero((sizes > 3) & (sizes < 7)):  # too small to lose two at a time
        own = ring.knot == k
        gone &= ~own | (rank == rank[own].min())
    chosen = np.flatnonzero(gone)
    for t, e in _pair_near(a[chosen], b[chosen], c[chosen], a[chosen], c[chosen], budget):
        t, e = chosen[t[t != e]], chosen[e[t != e]]
        met = may_pierce(a[t], b[t], c[t], a[e], c[e])
        t, e = t[met], e[met]
        gone[np.where(rank[t] > rank[e], t, e)] = False
    return gone


def _pair_near(
    a: Array, b: Array, c: Array, p: Array, q: Array, budget: Budget
) -> Iterator[tuple[Ints, Ints]]:
    """Yield batches of (triangle, segment) pairs whose boxes overlap."""
    low, high = bound_triangles(a, b, c)
    low_e, high_e = np.minimum(p, q), np.maximum(p, q)
    tree = shapely.STRtree(shapely.box(low_e[:, 0], low_e[:, 1], high_e[:, 0], high_e[:, 1]))
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    for start in range(0, len(boxes), BLOCK):
        t, e = tree.query(boxes[start : start + BLOCK])
        t += start
        keep = (low[t, 2] <= high_e[e, 2]) & (low_e[e, 2] <= high[t, 2])
        t, e = t[keep].astype(np.int64), e[keep].astype(np.int64)
        budget.spend(len(t))
        yield t, e


def _shake(ring: Ring, rng: np.random.Generator) -> Ring:
    """Move each vertex in turn, mostly towards the middle of its neighbours, if nothing is in the way.

    Moving B to D is an isotopy when no other edge meets the triangles ABD and CBD.
    """
    at = ring.at.copy()
    for i in rng.permutation(len(at)):
        before, after = ring.before[i], ring.after[i]
        a, b, c = at[before], at[i], at[after]
        reach = np.linalg.norm(a - c) + np.linalg.norm(a + c - 2 * b)
        target = b + rng.uniform(0, 1) * ((a + c) / 2 - b) + rng.normal(0, 0.1 * reach, 3)
        others = np.flatnonzero((np.arange(len(at)) != i) & (np.arange(len(at)) != before))
        p, q = at[others], at[ring.after[others]]
        free = True
        for end in (a, c):
            u, v, w = (np.broadcast_to(x, p.shape) for x in (end, b, target))
            free = free and not may_pierce(u, v, w, p, q).any()
        # The two new edges must not fold onto each other either.
        if free and orientation(a[None], b[None], target[None], c[None])[0] != 0:
            at[i] = target
    return replace(ring, at=at)


def touching_place(polygons: Sequence[Array]) -> Array:
    """Return a point (3,) near which the polygons touch themselves or each other."""
    ring = ring_of(polygons)
    edge = ring.at[ring.after] - ring.at
    length = np.linalg.norm(edge, axis=1)
    d = NUDGES[-1] * float(length.min())
    if not d > LEAST_SHIFT * float(np.abs(ring.at).max()):
        return np.asarray(ring.at[int(length.argmin())])
    distance, i, j = _find_closest(ring, 4 * d)
    if distance < 4 * d:
        return _middle_between(ring, i, j)
    unit = edge / length[:, None]
    return np.asarray(ring.at[int(np.linalg.norm(unit + unit[ring.before], axis=1).argmin())])


def nearest_approach(one: Array, other: Array) -> Array:
    """Return the midpoint (3,) between two polygons (n, 3), (m, 3) where they are nearest."""
    ring = ring_of([one, other])
    from scipy.spatial import cKDTree

    away, vertex = cKDTree(other).query(one)
    reach, first = float(away.min()), int(away.argmin())
    p, q = ring.at, ring.at[ring.after]
    n = len(one)
    low, high = np.minimum(p, q)[:n] - reach, np.maximum(p, q)[:n] + reach
    best = reach, first, n + int(vertex[first])
    try:
        for i, j in _pair_near(low, low, high, p[n:], q[n:], Budget(NEAREST_PAIRS)):
            if len(i):
                distance = segment_segment(p[i], q[i], p[j + n], q[j + n])
                k = int(distance.argmin())
                best = min(best, (float(distance[k]), int(i[k]), int(j[k]) + n))
    except TooTangled:
        pass  # an approximate place will do
    return _middle_between(ring, best[1], best[2])


def _middle_between(ring: Ring, i: int, j: int) -> Array:
    """Return the midpoint (3,) of the shortest segment between edges i and j."""
    at, end = ring.at, ring.at[ring.after]
    return np.asarray(np.mean(nearest_on_two(at[[i]], end[[i]], at[[j]], end[[j]]), axis=0)[0])


def _find_closest(ring: Ring, reach: float) -> tuple[float, int, int]:
    """Return distance and indices of the closest edges not adjacent; inf beyond `reach`."""
    p, q = ring.at, ring.at[ring.after]
    best = float("inf"), 0, 0
    low, high = np.minimum(p, q) - reach, np.maximum(p, q) + reach
    for i, j in _pair_near(low, p, high, p, q, Budget()):
        apart = ~adjacent(ring, i, j)
        i, j = i[apart], j[apart]
        if len(i):
            distance = segment_segment(p[i], q[i], p[j], q[j])
            k = int(distance.argmin())
            best = min(best, (float(distance[k]), int(i[k]), int(j[k])))
    return best
