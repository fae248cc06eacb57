"""Find the shortest doubly critical chord of polygons, by pruning pairs of arcs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.curves import SegmentBlocks, near_segments, segment_blocks

CurvePoint = tuple[int, int, float]
"""A point of the polygons: knot, edge (from vertex `edge` to the next), and where on it, 0 to 1."""

ANGLE_TOLERANCE = 2e-10  # cosine up to which a chord counts as perpendicular
ROUNDING = 1e-15  # error of a coordinate difference, as a share of the extent
CONE_SLACK = 1e-6  # radians of slack in every pruning test, far above its rounding error
PAIRS_AT_ONCE = 150_000
TOP_ARCS = 48
# arcs of 2^5 edges: if too many pairs are left at this level, all their edges are paired
BLOCK_LEVEL = 5
MANY_PAIRS = 100  # pairs for each arc of a level that count as too many
BLOCKS_AT_ONCE = 256  # pairs of arcs of that level that are processed together
MOST_PAIRS = 500_000_000  # pairs of edges in all, half a minute's worth; a part of 8 m has few


@dataclass(frozen=True)
class Chord:
    """A chord between two points of the polygons; `length` is in their unit."""

    length: float
    ends: tuple[CurvePoint, CurvePoint]
    points: Array  # (2, 3), its ends

    @property
    def middle(self) -> Array:
        middle: Array = self.points.mean(axis=0)
        return middle


@dataclass(frozen=True)
class _Elements:
    """The n vertices of all polygons in one array, each with the edge that leaves it."""

    knot: Ints
    number: Ints  # index of the vertex within its polygon
    following: Ints  # index of the edge's other end; -1 at an open end
    point: Array  # (n, 3)
    out: Array  # (n, 3) unit direction of the edge that leaves; 0 where there is none
    into: Array  # (n, 3) unit direction of the edge that arrives; 0 where there is none
    length: Array  # (n,) of the edge that leaves
    origin: Array  # (3,) origin of `point`
    rounding: float

    @property
    def end(self) -> Array:
        return self.point[np.where(self.following < 0, np.arange(len(self.point)), self.following)]


@dataclass(frozen=True)
class _Arcs:
    """Arcs of consecutive edges, each with a bounding ball, a cylinder and a cone of directions."""

    centre: Array  # (m, 3)
    radius: Array  # (m,) of the ball
    axis: Array  # (m, 3) unit; 0 if the directions cancel out
    across: Array  # (m,) radius of the cylinder
    first: Ints  # (m,) the first element of each
    spread: Array  # (m,) largest angle between a direction and the axis; pi if unknown
    children: Ints  # (m, 2) arcs of the next finer level; -1 for none


def shortest_critical_chord(
    polygons: Sequence[Array], closed: Sequence[bool], *, up_to: float = float("inf")
) -> Chord | None:
    """Return the shortest chord that is critical at both ends, over all polygons together.

    A chord is critical at an interior point of an edge if it is perpendicular to it, and at a
    vertex if its length turns there, to rise or to fall: its products with the two adjacent edges
    differ in sign or vanish (Rawdon, "Approximating the thickness of a knot", 1998). At the end
    of an open polygon its length must not fall when that end is left. Chords between points of
    adjacent edges are left out, but for the ends of one edge.

    A cosine of up to `ANGLE_TOLERANCE`, e, counts as zero: rounding would hide chords that end
    at vertices of symmetric polygons otherwise. What it costs: let R be the smallest MinRad. From
    any chord shorter than 2 R whose ends are not neighbours, the length can be lowered until a
    critical chord is reached, so a chord let in by the tolerance has a true one below it. Ends
    are neighbours where the polygon turns by less than 180 degrees between them, and there a
    chord within e of perpendicular to both is at least 2 R (1 - e) long. So min(R, half the
    chord) is at most e too small, relatively, and never too large.

    A pair of arcs is followed only if it is near enough and some chord between the two can be
    perpendicular to some direction of both: curves of n edges cost about n log n.

    Args:
        polygons: arrays (n, 3). closed: for each, whether its last vertex joins the first.
        up_to: longer chords are not looked for.

    Returns:
        None where there is no such chord.

    Raises:
        ValueError: so many edges are near each other that it would not end soon.
    """
    elements = _elements(polygons, closed)
    levels = _levels(elements)
    edges = elements.length[elements.following >= 0]
    most = min(up_to, 1.001 * float(np.linalg.norm(np.ptp(elements.point, axis=0))))
    limit = min(2.0 * float(edges.mean()) if len(edges) else most, most)
    while True:
        found = _search(elements, levels, limit)
        if found is not None or limit >= most:
            return found
        limit = min(2.0 * limit, most)


def _elements(polygons: Sequence[Array], closed: Sequence[bool]) -> _Elements:
    point = np.concatenate(polygons).astype(np.float64)
    origin = (point.min(axis=0) + point.max(axis=0)) / 2
    point = point - origin  # exact: only leading digits cancel
    rounding = ROUNDING * float(np.abs(point).max())
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
    """Build arcs of 1, 2, 4, ... elements, finest first, until few are left."""
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


def _arcs(elements: _Elements, first: Ints, children: Ints) -> _Arcs:
    p, q = elements.point, elements.end
    low = np.minimum.reduceat(np.minimum(p, q), first, axis=0)
    high = np.maximum.reduceat(np.maximum(p, q), first, axis=0)
    centre = (low + high) / 2
    member = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(p))))
    far = np.maximum(_norm(p - centre[member]), _norm(q - centre[member]))
    axis = np.add.reduceat(elements.out, first, axis=0) + elements.into[first]
    size = _norm(axis)
    axis = axis / np.where(size > 0, size, 1.0)[:, None]
    off = [_off_axis(end - centre[member], axis[member]) for end in (p, q)]
    across = np.maximum.reduceat(np.maximum(*off), first)
    # an end or an edge of no length has direction 0, hence an angle of 90 degrees: no pruning
    cosine = np.minimum(_dot(elements.out, axis[member]), _dot(elements.into, axis[member]))
    spread = np.arccos(np.clip(np.minimum.reduceat(cosine, first), -1.0, 1.0))
    return _Arcs(centre, np.maximum.reduceat(far, first), axis, across, first, spread, children)


def _search(elements: _Elements, levels: list[_Arcs], limit: float) -> Chord | None:
    """Return the shortest critical chord of length up to `limit`."""
    i, j = np.triu_indices(len(levels[-1].centre))
    stack = _portions(len(levels) - 1, i.astype(np.int64), j.astype(np.int64))
    best: Chord | None = None
    blocks: SegmentBlocks | None = None
    tried = 0
    while stack:
        level, i, j = stack.pop()
        keep = _possible(levels[level], i, j, limit)
        i, j = i[keep], j[keep]
        if level > 0 and not _too_many(level, len(i), len(levels[level].centre)):
            stack += _portions(level - 1, *_children(levels[level].children, i, j))
            continue
        tried += len(i) << 2 * level if level > 0 else 0
        if tried > MOST_PAIRS:
            raise ValueError(
                f"over {MOST_PAIRS // 10**6} million pairs of edges are near each other"
            )
        if level > 0 and blocks is None:
            blocks = segment_blocks(elements.point, elements.end, levels[level].first)
        size = PAIRS_AT_ONCE if level == 0 else BLOCKS_AT_ONCE
        for k in range(0, len(i), size):
            one, other = i[k : k + size], j[k : k + size]
            if blocks is not None and level > 0:
                one, other = near_segments(blocks, one, other, limit)
            found = _evaluate(elements, one, other, limit)
            if found is not None:
                best, limit = found, found.length
    return best


def _too_many(level: int, pairs: int, arcs: int) -> bool:
    """Return whether so many pairs of arcs are left that pairing all their edges is better."""
    return level == BLOCK_LEVEL and pairs > min(MANY_PAIRS * arcs, PAIRS_AT_ONCE // 2)


def _portions(level: int, i: Ints, j: Ints) -> list[tuple[int, Ints, Ints]]:
    """Split a level's pairs into batches of `PAIRS_AT_ONCE`."""
    size = PAIRS_AT_ONCE
    return [(level, i[k : k + size], j[k : k + size]) for k in range(0, len(i), size)]


def _children(children: Ints, i: Ints, j: Ints) -> tuple[Ints, Ints]:
    a, b = children[i], children[j]
    first = np.concatenate([a[:, 0], a[:, 0], a[:, 1], a[:, 1]])
    second = np.concatenate([b[:, 0], b[:, 1], b[:, 1], b[:, 0]])
    keep = (first >= 0) & (second >= 0)
    keep[3 * len(i) :] &= i != j  # an arc with itself: its two children are paired once
    return first[keep], second[keep]


def _possible(arcs: _Arcs, i: Ints, j: Ints, limit: float) -> Mask:
    """Return whether two arcs may have a critical chord of length up to `limit` between them."""
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
    # within an arc that turns little, every chord lies in the cone of its directions
    keep &= (i != j) | (arcs.spread[i] > np.pi / 4 - CONE_SLACK)
    left = np.flatnonzero(keep)
    if len(left):
        near = _distance_bound(arcs, i[left], j[left], between[left]) <= limit * (1 + 1e-9)
        keep[left] = near
    return keep


def _distance_bound(arcs: _Arcs, i: Ints, j: Ints, between: Array) -> Array:
    """Bound the distance of two arcs from below by their cylinders, since long edges fill little of a ball.

    Along a direction, the arcs' centres are apart by its product with `between`, and each arc
    reaches as far as its cylinder: `across`, if the direction is perpendicular to its axis.
    """
    u, v = arcs.axis[i], arcs.axis[j]
    normal = np.cross(u, v)
    sine = _norm(normal)
    both = arcs.across[i] + arcs.across[j]
    apart = np.abs(_dot(between, normal)) / np.where(sine > 1e-4, sine, np.inf) - both
    for axis, length in ((u, arcs.radius[j]), (v, arcs.radius[i])):
        apart = np.maximum(apart, _off_axis(between, axis) - both - length * sine)
    # an axis of zero has a cylinder as large as its ball, which bounds no better
    known = (np.abs(_dot(u, u) - 1) < 1e-6) & (np.abs(_dot(v, v) - 1) < 1e-6)
    rounding = 1e-11 * (_norm(between) + arcs.radius[i] + arcs.radius[j])
    return np.where(known, apart - rounding, 0.0)


def _evaluate(elements: _Elements, i: Ints, j: Ints, limit: float) -> Chord | None:
    """Return the shortest critical chord between edges (or their first vertices) of pairs i, j."""
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
    du, dv, normal = _dot(gap, u), _dot(gap, v), np.cross(u, v)
    det = _dot(normal, normal)
    skew = det > 1e-28
    s = np.where(skew, _dot(np.cross(gap, v), normal) / np.where(skew, det, 1.0), du)
    s = np.clip(s, 0.0, a)
    t = np.clip(s * cosine - dv, 0.0, b)
    s = np.clip(t * cosine + du, 0.0, a)
    options = [(s, t, edge_i & edge_j & ~after_i & ~after_j, False, False)]
    s, t = du, -dv
    on_i, on_j = _is_on_edge(s, a), _is_on_edge(t, b)
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
            start = elements.origin + p[k] + s[k] * u[k]
            points = np.stack([start, start + chord[k]])
            best = Chord(float(length[k]), (first, second), points)
            limit = best.length
    return best


def _critical(elements: _Elements, k: Ints, chord: Array, slack: Array, at_vertex: bool) -> Mask:
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


def _is_on_edge(s: Array, length: Array) -> Mask:
    inside: Mask = (s >= -ANGLE_TOLERANCE * length) & (s <= (1 + ANGLE_TOLERANCE) * length)
    return inside


def _curve_point(elements: _Elements, k: int, s: float) -> CurvePoint:
    knot, number = int(elements.knot[k]), int(elements.number[k])
    # the last vertex of an open polygon is the end of the edge before
    if elements.following[k] < 0:
        return knot, number - 1, 1.0
    return knot, number, s / float(elements.length[k]) if elements.length[k] > 0 else 0.0


def _off_axis(a: Array, axis: Array) -> Array:
    """Return the distances (n,) from points (n, 3) to the lines through 0 along unit vectors (n, 3)."""
    return _norm(a - _dot(a, axis)[:, None] * axis)


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.einsum("ij,ij->i", a, b)
    return result


def _norm(a: Array) -> Array:
    return np.sqrt(_dot(a, a))
