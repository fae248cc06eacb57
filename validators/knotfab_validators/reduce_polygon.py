"""Take vertices off polygons as long as their knot type provably stays (KMT reduction)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["reduce_polygons", "triangles_met"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Shewchuk 1997, table "orient3d": (7 + 56 eps) eps, rounded up
ORIENT_ERROR = 8 * 2.0**-53
SMALL = 8  # a polygon of fewer vertices loses one at a time


def reduce_polygons(polygons: Sequence[Array], seed: int = 0) -> list[Array]:
    """Polygons of the same link type with fewer vertices, three of each if all goes well.

    Vertex b between a and c is taken off when no other edge, of any polygon, meets the triangle
    abc (Koniaris & Muthukumar 1991; Taylor 2000): the edge ac is then the image of the path abc
    under an isotopy that moves nothing else. Whatever rounding leaves open counts as meeting. Many
    vertices go at once: no two neighbours, and none whose triangle meets another's new edge, so
    that they might as well go one after the other. Small triangles go first, with some chance.

    Args:
        polygons: closed, arrays (n, 3) with n >= 3. seed: of the order.

    Returns:
        The reduced polygons, in the same order; more than three vertices are left where every
        triangle is met.
    """
    rng = np.random.default_rng(seed)
    points = np.concatenate(polygons)
    count = np.array([len(p) for p in polygons])
    knot = np.repeat(np.arange(len(count)), count)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    local = np.arange(len(points)) - start[knot]
    ahead = start[knot] + (local + 1) % count[knot]
    behind = start[knot] + (local - 1) % count[knot]
    alive = np.ones(len(points), dtype=np.bool_)
    while True:
        vertex = np.flatnonzero(alive & (count[knot] > 3))
        chosen = _removable(points, vertex, behind, ahead, alive, knot, count, rng)
        if len(chosen) == 0:
            break
        a, c = behind[chosen], ahead[chosen]
        ahead[a], behind[c] = c, a
        alive[chosen] = False
        count = count - np.bincount(knot[chosen], minlength=len(count))
    return [points[alive & (knot == k)] for k in range(len(count))]


def _removable(
    points: Array,
    vertex: Index,
    behind: Index,
    ahead: Index,
    alive: Mask,
    knot: Index,
    count: Index,
    rng: np.random.Generator,
) -> Index:
    """Vertices that may go in one pass; none only if none may go at all."""
    if len(vertex) == 0:
        return vertex
    triangle = np.stack([behind[vertex], vertex, ahead[vertex]], axis=1)
    begin = np.flatnonzero(alive)
    met, _ = triangles_met(points, triangle, np.stack([begin, ahead[begin]], axis=1))
    clear = np.ones(len(vertex), dtype=np.bool_)
    clear[met] = False
    triangle = triangle[clear]
    if len(triangle) == 0:
        return triangle[:, 1]
    sides = points[triangle[:, [0, 2]]] - points[triangle[:, 1], None]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    key = np.full(len(points), np.inf)
    key[triangle[:, 1]] = area * (0.5 + rng.random(len(area))) + 1e-300 * rng.random(len(area))
    own = key[triangle[:, 1]]
    first = (own < key[triangle[:, 0]]) & (own < key[triangle[:, 2]])
    owner = knot[triangle[:, 1]]
    for k in np.flatnonzero(count < SMALL):
        mine = np.flatnonzero(owner == k)
        if len(mine):
            first[mine] = False
            first[mine[np.argmin(own[mine])]] = True
    triangle, own = triangle[first], own[first]
    # a triangle must not meet another's new edge: of two that quarrel the larger one waits
    met, edge = triangles_met(points, triangle, triangle[:, [0, 2]])
    keep = np.ones(len(triangle), dtype=np.bool_)
    keep[np.where(own[met] > own[edge], met, edge)] = False
    return triangle[keep, 1]


def triangles_met(points: Array, triangles: Index, segments: Index) -> tuple[Index, Index]:
    """Pairs (triangle, segment) that meet, or may: what is left out certainly does not.

    A segment that is a side of the triangle is no pair; one that starts at a corner of it counts
    only if it may meet the triangle elsewhere too.

    Args:
        points: (n, 3). triangles: (m, 3), segments: (k, 2), of indices into points.
    """
    corner, ends = points[triangles], points[segments]
    t, s = _boxes_that_meet(
        corner.min(axis=1), corner.max(axis=1), ends.min(axis=1), ends.max(axis=1)
    )
    shared = (triangles[t][:, :, None] == segments[s][:, None, :]).any(axis=2)  # (pairs, 3)
    number = shared.sum(axis=1)
    t, s, shared = t[number < 2], s[number < 2], shared[number < 2]
    touching = shared.any(axis=1)
    met = np.empty(len(t), dtype=np.bool_)
    met[~touching] = _may_pierce(corner[t[~touching]], ends[s[~touching]])
    t1, s1, at = t[touching], s[touching], np.argmax(shared[touching], axis=1)
    same = segments[s1, 0] == triangles[t1, at]
    other = points[np.where(same, segments[s1, 1], segments[s1, 0])]
    met[touching] = _may_lie_along(corner[t1], at, other)
    return t[met], s[met]


def _boxes_that_meet(low: Array, high: Array, low2: Array, high2: Array) -> tuple[Index, Index]:
    """Pairs of boxes (m, 3) and (k, 3) that overlap: by tree in the two widest axes."""
    empty = np.zeros(0, dtype=np.int64)
    if len(low) == 0 or len(low2) == 0:
        return empty, empty
    x, y, z = np.argsort(np.ptp(np.concatenate([low, high]), axis=0))[::-1]
    tree = shapely.STRtree(shapely.box(low2[:, x], low2[:, y], high2[:, x], high2[:, y]))
    t, s = tree.query(shapely.box(low[:, x], low[:, y], high[:, x], high[:, y]))
    keep = (low[t, z] <= high2[s, z]) & (low2[s, z] <= high[t, z])
    return t[keep].astype(np.int64), s[keep].astype(np.int64)


def _may_pierce(corner: Array, ends: Array) -> Mask:
    """Whether segments (m, 2, 3) may meet triangles (m, 3, 3) that share no corner with them."""
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    p, q = ends[:, 0], ends[:, 1]
    side = _orientation(a, b, c, p) * _orientation(a, b, c, q)
    result = side <= 0
    # seen along the segment's line, the line is a point: outside if two sides disagree
    k = np.flatnonzero(result)
    a, b, c, p, q = a[k], b[k], c[k], p[k], q[k]
    signs = np.stack(
        [_orientation(p, q, a, b), _orientation(p, q, b, c), _orientation(p, q, c, a)], axis=1
    )
    result[k] = ~((signs > 0).any(axis=1) & (signs < 0).any(axis=1))
    return result


def _may_lie_along(corner: Array, at: Index, other: Array) -> Mask:
    """Whether segments from corner number `at` (m,) of triangles to `other` may re-enter them.

    Not if `other` is off the triangle's plane, nor if it lies behind the corner: then a plane
    through the corner has the triangle on one side and the segment on the other.
    """
    row = np.arange(len(at))
    o = corner[row, at]
    u, v = corner[row, (at + 1) % 3] - o, corner[row, (at + 2) % 3] - o
    x = other - o
    off = _orientation(corner[:, 0], corner[:, 1], corner[:, 2], other) != 0
    with np.errstate(divide="ignore", invalid="ignore"):
        inward = (
            u / np.linalg.norm(u, axis=1)[:, None] + v / np.linalg.norm(v, axis=1)[:, None]
        )  # within 90 degrees of both sides
        behind = (inward * x).sum(axis=1) < -1e-9 * np.linalg.norm(x, axis=1)
    result: Mask = ~off & ~(behind & (np.linalg.norm(inward, axis=1) > 1e-6))
    return result


def _orientation(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Sign of the volume of tetrahedra (m,): 0 where rounding leaves it open.

    Shewchuk, "Adaptive precision floating-point arithmetic and fast robust geometric
    predicates" (1997): the first, non-adaptive stage of orient3d.
    """
    u, v, w = a - d, b - d, c - d
    plus, minus = v[:, [1, 2, 0]] * w[:, [2, 0, 1]], v[:, [2, 0, 1]] * w[:, [1, 2, 0]]
    volume = (u * (plus - minus)).sum(axis=1)
    bound = ORIENT_ERROR * (np.abs(u) * (np.abs(plus) + np.abs(minus))).sum(axis=1)
    sign: Array = np.where(np.abs(volume) > bound, np.sign(volume), 0.0)
    return sign
