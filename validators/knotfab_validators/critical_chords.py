"""The shortest doubly critical chord of polygons, by pruned pairs of arcs instead of all pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Chord", "CurvePoint", "shortest_critical_chord"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

CurvePoint = tuple[int, int, float]
"""A point of the polygons: knot, edge (from vertex `edge` to the next), and where on it, 0 to 1."""

ANGLE_TOLERANCE = 1e-9  # cosine below which a chord counts as perpendicular
ROUNDING = 1e-15  # of the extent: what a coordinate difference may be wrong by
CONE_SLACK = 1e-6  # radians given to every pruning test, far above its rounding
PAIRS_AT_ONCE = 150_000
TOP_ARCS = 48


@dataclass(frozen=True)
class Chord:
    """A chord between two points of the polygons; `length` in the polygons' unit."""

    length: float
    ends: tuple[CurvePoint, CurvePoint]
    middle: Array  # (3,)


@dataclass(frozen=True)
class _Elements:
    """Vertices and the edges that leave them, of all polygons in a row (n of them)."""

    knot: Index
    number: Index  # of the vertex within its polygon
    following: Index  # the vertex at the edge's other end; -1 at an open end
    point: Array  # (n, 3)
    out: Array  # (n, 3) unit direction of the edge that leaves; 0 where there is none
    into: Array  # (n, 3) unit direction of the edge that arrives; 0 where there is none
    length: Array  # (n,) of the edge that leaves
    origin: Array  # (3,) what `point` is relative to
    rounding: float

    @property
    def end(self) -> Array:
        return self.point[np.where(self.following < 0, np.arange(len(self.point)), self.following)]


@dataclass(frozen=True)
class _Arcs:
    """Arcs of consecutive edges: a ball around each and a cone around its directions."""

    centre: Array  # (m, 3)
    radius: Array  # (m,)
    axis: Array  # (m, 3) unit
    spread: Array  # (m,) largest angle of a direction with the axis; pi if nothing may be said
    children: Index  # (m, 2) arcs of the next finer level; -1 for none


def shortest_critical_chord(polygons: Sequence[Array], closed: Sequence[bool]) -> Chord | None:
    """The shortest chord that is critical at both ends, over all polygons together.

    A chord is critical at an interior point of an edge if it is perpendicular to it, and at a
    vertex if its length turns there: its products with the two adjacent edges differ in sign or
    vanish (Rawdon 2000; Cantarella, Kusner, Sullivan 2002, sect. 7). At the end of an open
    polygon its length must not fall when that end is left. A cosine of up to 1e-9 counts as
    zero, since chords that end at vertices of symmetric polygons would be missed otherwise.
    Chords between adjacent edges are left out.

    A pair of arcs is followed only if its balls are near enough and some chord between them can
    be perpendicular to some direction of both, so that curves of n edges cost about n log n.

    Args:
        polygons: arrays (n, 3). closed: for each, whether its last vertex joins the first.

    Returns:
        None where there is no such chord (one straight open polygon).
    """
    elements = _elements(polygons, closed)
    levels = _levels(elements)
    edges = elements.length[elements.following >= 0]
    extent = float(np.linalg.norm(np.ptp(elements.point, axis=0)))
    limit = 2.0 * float(edges.mean()) if len(edges) else extent
    while True:
        found = _search(elements, levels, limit)
        if found is not None or limit > 1.001 * extent:
            return found
        limit *= 2.0


def _elements(polygons: Sequence[Array], closed: Sequence[bool]) -> _Elements:
    point = np.concatenate(polygons).astype(np.float64)
    rounding = ROUNDING * float(np.abs(point).max())
    origin = (point.min(axis=0) + point.max(axis=0)) / 2
    point = point - origin
    following, before, knot, number = [], [], [], []
    offset = 0
    for k, (polygon, is_closed) in enumerate(zip(polygons, closed, strict=True)):
        n = len(polygon)
        index = np.arange(n)
        ahead, behind = np.roll(index, -1) + offset, np.roll(index, 1) + offset
        if not is_closed:
            ahead[-1] = behind[0] = -1
        following.append(ahead)
        before.append(behind)
        knot.append(np.full(n, k))
        number.append(index)
        offset += n
    nxt, prv = np.concatenate(following), np.concatenate(before)
    edge = np.where((nxt >= 0)[:, None], point[nxt] - point, 0.0)
    length = np.sqrt((edge * edge).sum(axis=1))
    out = edge / np.where(length > 0, length, 1.0)[:, None]
    into = np.where((prv >= 0)[:, None], out[prv], 0.0)
    return _Elements(
        knot=np.concatenate(knot),
        number=np.concatenate(number),
        following=nxt,
        point=point,
        out=out,
        into=into,
        length=length,
        origin=origin,
        rounding=rounding,
    )


def _levels(elements: _Elements) -> list[_Arcs]:
    """Arcs of 1, 2, 4, ... elements, finest first, until few are left."""
    counts = np.bincount(elements.knot)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    levels: list[_Arcs] = []
    size, below = 1, counts
    while True:
        here = -(-counts // size)
        offset = np.concatenate([[0], np.cumsum(here)[:-1]])
        owner = np.repeat(np.arange(len(counts)), here)
        local = np.arange(here.sum()) - offset[owner]
        first = starts[owner] + local * size
        lower = np.concatenate([[0], np.cumsum(below)[:-1]])[owner]
        pair = 2 * local[:, None] + np.arange(2)
        children = np.where(pair < below[owner][:, None], lower[:, None] + pair, -1)
        levels.append(_arcs(elements, first, children))
        if len(first) <= max(TOP_ARCS, len(counts)):
            return levels
        size, below = 2 * size, here


def _arcs(elements: _Elements, first: Index, children: Index) -> _Arcs:
    p, q = elements.point, elements.end
    low = np.minimum.reduceat(np.minimum(p, q), first, axis=0)
    high = np.maximum.reduceat(np.maximum(p, q), first, axis=0)
    centre = (low + high) / 2
    member = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(p))))
    far = np.maximum(_norm(p - centre[member]), _norm(q - centre[member]))
    axis = np.add.reduceat(elements.out, first, axis=0) + elements.into[first]
    size = _norm(axis)
    axis = axis / np.where(size > 0, size, 1.0)[:, None]
    # an end or an edge of no length has direction 0, hence the angle 90 degrees: no pruning
    cosine = np.minimum(_dot(elements.out, axis[member]), _dot(elements.into, axis[member]))
    spread = np.arccos(np.clip(np.minimum.reduceat(cosine, first), -1.0, 1.0))
    return _Arcs(centre, np.maximum.reduceat(far, first), axis, spread, children)


def _search(elements: _Elements, levels: list[_Arcs], limit: float) -> Chord | None:
    """The shortest critical chord of length up to `limit`."""
    i, j = np.triu_indices(len(levels[-1].centre))
    stack = [(len(levels) - 1, i.astype(np.int64), j.astype(np.int64))]
    best: Chord | None = None
    while stack:
        level, i, j = stack.pop()
        keep = _possible(levels[level], i, j, limit)
        i, j = i[keep], j[keep]
        if level == 0:
            found = _evaluate(elements, i, j, limit)
            if found is not None:
                best, limit = found, found.length
            continue
        i, j = _children(levels[level].children, i, j)
        for k in range(0, len(i), PAIRS_AT_ONCE):
            stack.append((level - 1, i[k : k + PAIRS_AT_ONCE], j[k : k + PAIRS_AT_ONCE]))
    return best


def _children(children: Index, i: Index, j: Index) -> tuple[Index, Index]:
    a, b = children[i], children[j]
    first = np.concatenate([a[:, 0], a[:, 0], a[:, 1], a[:, 1]])
    second = np.concatenate([b[:, 0], b[:, 1], b[:, 1], b[:, 0]])
    keep = (first >= 0) & (second >= 0)
    keep[3 * len(i) :] &= i != j  # an arc with itself: its two children meet once
    return first[keep], second[keep]


def _possible(arcs: _Arcs, i: Index, j: Index, limit: float) -> Mask:
    """Whether two arcs may have a critical chord of length up to `limit` between them."""
    between = arcs.centre[j] - arcs.centre[i]
    distance = _norm(between)
    reach = arcs.radius[i] + arcs.radius[j]
    keep = distance - reach <= limit * (1 + 1e-9)
    # chords deviate from the line of centres by at most this angle
    with np.errstate(divide="ignore", invalid="ignore"):
        deviation = np.where(distance > reach, np.arcsin(np.minimum(reach / distance, 1)), np.pi)
    for k in (i, j):
        angle = np.minimum(arcs.spread[k] + deviation + CONE_SLACK, np.pi / 2)
        keep &= np.abs(_dot(between, arcs.axis[k])) <= distance * np.sin(angle) + 1e-300
    # within an arc that turns little every chord lies in the cone of its directions
    same: Mask = keep & ((i != j) | (arcs.spread[i] > np.pi / 4 - CONE_SLACK))
    return same


def _evaluate(elements: _Elements, i: Index, j: Index, limit: float) -> Chord | None:
    """The shortest critical chord between edges (or their first vertices) of pairs i, j."""
    apart = i != j
    i, j = i[apart], j[apart]
    if len(i) == 0:
        return None
    p, q, u, v = elements.point[i], elements.point[j], elements.out[i], elements.out[j]
    a, b = elements.length[i], elements.length[j]
    after_i, after_j = elements.following[i] == j, elements.following[j] == i
    zero, edge_i, edge_j = np.zeros(len(i)), elements.following[i] >= 0, elements.following[j] >= 0
    gap, cosine = q - p, _dot(u, v)
    # both interior: s, t of the common perpendicular; parallel edges have their vertices instead
    det = 1.0 - cosine * cosine
    du, dv = _dot(gap, u), _dot(gap, v)
    s = np.clip((du - cosine * dv) / np.where(det > 1e-15, det, 1.0), 0.0, a)
    t = np.clip(s * cosine - dv, 0.0, b)
    s = np.clip(t * cosine + du, 0.0, a)
    options = [(s, t, edge_i & edge_j & ~after_i & ~after_j, False, False)]
    s, t = du, -dv
    on_i, on_j = _within(s, a), _within(t, b)
    options.append((np.clip(s, 0.0, a), zero, edge_i & on_i & ~after_i, False, True))
    options.append((zero, np.clip(t, 0.0, b), edge_j & on_j & ~after_j, True, False))
    options.append((zero, zero, np.ones(len(i), dtype=np.bool_), True, True))
    best: Chord | None = None
    for s, t, allowed, vertex_i, vertex_j in options:
        chord = gap + t[:, None] * v - s[:, None] * u
        length = _norm(chord)
        near = np.flatnonzero(allowed & (length <= limit))
        d, slack = chord[near], ANGLE_TOLERANCE * length[near] + elements.rounding
        keep = _critical(elements, i[near], d, slack, vertex_i)
        keep &= _critical(elements, j[near], -d, slack, vertex_j)
        near = near[keep]
        if len(near) == 0:
            continue
        k = near[np.argmin(length[near])]
        if best is None or length[k] < best.length:
            first = _curve_point(elements, int(i[k]), float(s[k]))
            second = _curve_point(elements, int(j[k]), float(t[k]))
            middle = elements.origin + p[k] + s[k] * u[k] + chord[k] / 2
            best = Chord(float(length[k]), (first, second), middle)
            limit = best.length
    return best


def _critical(elements: _Elements, k: Index, chord: Array, slack: Array, at_vertex: bool) -> Mask:
    ahead = _dot(chord, elements.out[k])
    if not at_vertex:
        interior: Mask = np.abs(ahead) <= slack
        return interior
    behind = _dot(chord, elements.into[k])
    first = ~elements.into[k].any(axis=1)
    last = elements.following[k] < 0
    falls = (behind <= slack) & (ahead >= -slack) & ~first & ~last
    rises = ((behind >= -slack) | first) & ((ahead <= slack) | last)
    result: Mask = falls | rises
    return result


def _within(s: Array, length: Array) -> Mask:
    inside: Mask = (s >= -ANGLE_TOLERANCE * length) & (s <= (1 + ANGLE_TOLERANCE) * length)
    return inside


def _curve_point(elements: _Elements, k: int, s: float) -> CurvePoint:
    knot, number = int(elements.knot[k]), int(elements.number[k])
    if elements.following[k] < 0:  # the last vertex of an open polygon ends the edge before
        return knot, number - 1, 1.0
    return knot, number, s / float(elements.length[k]) if elements.length[k] > 0 else 0.0


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.einsum("ij,ij->i", a, b)
    return result


def _norm(a: Array) -> Array:
    return np.sqrt(_dot(a, a))
