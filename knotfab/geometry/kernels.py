"""Compiled loops over pairs of segments: closest points, the margin of a step, hinge penalties.

Closed polylines come as points (N, 3) with the rows' successors and the start and size of each row's ring
(see `Polylines`). Each loop runs on one thread, so that the order of all sums is fixed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled

KEEPS, FOLDS, TOO_OLD = 0, 1, 2  # results of `step_margin`
_PARALLEL = 1e-12  # share of |u|^2 |v|^2 below which segments count as parallel
_LEAST_SQUARE = 1e-12  # squared distances and curvatures below this have no gradient
_FOLDED = 1e-9  # at a full fold 1 + cosine is taken as this, to keep the curvature finite


@compiled
def _row(x: Array, k: int) -> Any:
    return x[k, 0], x[k, 1], x[k, 2]


@compiled
def _minus(p: Any, q: Any) -> Any:
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


@compiled
def _cross(p: Any, q: Any) -> Any:
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@compiled
def _dot(p: Any, q: Any) -> float:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]  # type: ignore[no-any-return]


@compiled
def _clip(x: float) -> float:
    return min(max(x, 0.0), 1.0)


@compiled
def _closest(p: Any, u: Any, q: Any, v: Any) -> tuple[float, float]:
    w = _minus(p, q)
    a, e, f = _dot(u, u), _dot(v, v), _dot(v, w)
    b, c = _dot(u, v), _dot(u, w)
    det = a * e - b * b
    s = 0.0 if det <= _PARALLEL * a * e else _clip((b * f - c * e) / det)
    t = (b * s + f) / e
    if t < 0:
        return _clip(-c / a), 0.0
    if t > 1:
        return _clip((b - c) / a), 1.0
    return s, t


@compiled
def closest_parameters(p: Array, u: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Find where the segments p + s u and q + t v, s and t in [0, 1], come closest: (s, t), each [M].

    Ericson, Real-Time Collision Detection, 5.1.9: clamp one parameter, solve, clamp the other.
    """
    s, t = np.empty(len(p)), np.empty(len(p))
    for k in range(len(p)):
        s[k], t[k] = _closest(_row(p, k), _row(u, k), _row(q, k), _row(v, k))
    return s, t


@compiled
def _apart(points: Array, following: Indices, i: int, j: int) -> Any:
    """Return the closest parameters (s, t) of segments i and j, and the vector between these points."""
    p, q = _row(points, i), _row(points, j)
    u, v = _minus(_row(points, following[i]), p), _minus(_row(points, following[j]), q)
    s, t = _closest(p, u, q, v)
    w = _minus(p, q)
    between = (w[0] + s * u[0] - t * v[0], w[1] + s * u[1] - t * v[1], w[2] + s * u[2] - t * v[2])
    return s, t, between


@compiled
def _middles(points: Array, following: Indices) -> tuple[Array, Array]:
    """Return each segment's midpoint and half its length."""
    middle, half = np.empty_like(points), np.empty(len(points))
    for k in range(len(points)):
        edge = _minus(_row(points, following[k]), _row(points, k))
        half[k] = 0.5 * math.sqrt(_dot(edge, edge))
        for axis in range(3):
            middle[k, axis] = points[k, axis] + 0.5 * edge[axis]
    return middle, half


@compiled
def _square_between(x: Array, i: int, j: int) -> float:
    w = _minus(_row(x, i), _row(x, j))
    return _dot(w, w)


@compiled
def least_gap(
    points: Array,
    following: Indices,
    start: Indices,
    i: Indices,
    j: Indices,
    along: Array,  # the place of each segment's middle on its ring, mm
    length: Array,  # the length of each segment's ring, mm
    arc: float,  # pairs nearer along the curve are neighbours
    straight: float,  # pairs further apart than this share of their arc distance are, too
) -> tuple[float, int]:
    """Find the least distance of paired segments that are not neighbours, and the pair.

    Returns infinity and -1 where there is none.
    """
    least, which = np.inf, -1
    for pair in range(len(i)):
        a, b = i[pair], j[pair]
        same = start[a] == start[b]
        between = abs(along[a] - along[b])
        between = min(between, length[a] - between)
        if same and not between > arc:
            continue
        _, _, w = _apart(points, following, a, b)
        gap = math.sqrt(_dot(w, w))
        if gap < least and not (same and gap > straight * between):
            least, which = gap, pair
    return least, which


@compiled
def _slack(
    points: Array,
    step: Array,
    following: Indices,
    i: int,
    j: int,
    between_middles: float,
    half: Array,
) -> float:
    """Bound from below the distance left between segments i and j when their ends have moved by `step`.

    Their distance is first bounded by that of their midpoints, and computed if that bound is too low.
    """
    moved = 0.0
    for a in (i, following[i]):
        for b in (j, following[j]):
            moved = max(moved, _square_between(step, a, b))
    moved = math.sqrt(moved)
    slack = math.sqrt(between_middles) - half[i] - half[j] - moved
    if slack <= 0:
        _, _, w = _apart(points, following, i, j)
        slack = math.sqrt(_dot(w, w)) - moved
    return slack  # type: ignore[no-any-return]


@compiled
def step_margin(
    points: Array,
    step: Array,
    following: Indices,
    start: Indices,
    size: Indices,
    i: Indices,  # the pairs of segments that are near
    j: Indices,
    skip: int,  # pairs nearer along the curve are not among them
    room: float,  # distance beyond which there is none, less twice what vertices moved since
) -> tuple[int, float]:
    """Return a step's kind, and the least (distance - relative displacement) of any two segments, mm.

    See `carry.certify`. A pair whose bound is above the least margin so far is skipped.
    """
    count = len(points)
    old, new = np.empty_like(points), np.empty_like(points)
    longest, furthest = 0.0, 0.0
    for k in range(count):
        for axis in range(3):
            old[k, axis] = points[following[k], axis] - points[k, axis]
            new[k, axis] = old[k, axis] + step[following[k], axis] - step[k, axis]
        was, will, move = _row(old, k), _row(new, k), _row(step, k)
        longest = max(longest, _dot(was, was), _dot(will, will))
        furthest = max(furthest, _dot(move, move))
    for k in range(count):
        one, two = _row(old, k), _row(old, following[k])
        a, b = 1.0 / math.sqrt(_dot(one, one)), 1.0 / math.sqrt(_dot(two, two))
        towards = a * one[0] + b * two[0], a * one[1] + b * two[1], a * one[2] + b * two[2]
        for edges in (old, new):
            for row in (k, following[k]):
                if not _dot(_row(edges, row), towards) > 0:
                    return FOLDS, -np.inf
    margin = room - math.sqrt(longest) - 2 * math.sqrt(furthest)
    if not margin > 0:
        return TOO_OLD, margin
    middle, half = _middles(points, following)
    reach = np.empty(count)  # each segment's half length and how far it moves
    for k in range(count):
        here, there = _row(step, k), _row(step, following[k])
        ends = max(_dot(here, here), _dot(there, there))
        reach[k] = half[k] + math.sqrt(ends)
    for pair in range(len(i)):
        a, b = i[pair], j[pair]
        square, bound = _square_between(middle, a, b), margin + reach[a] + reach[b]
        if bound < 0 or square > bound * bound:
            continue
        slack = _slack(points, step, following, a, b, square, half)
        if not slack >= margin:
            margin = slack
        if margin != margin:  # NaN: later comparisons must not hide it
            return KEEPS, margin
    # a run of edges that all keep a positive component along one direction, before and after, is monotone
    # along it throughout, so its segments cannot meet: only the others need a distance
    for far in range(2, skip):
        for k in range(count):
            place = k - start[k]
            if not (size[k] > 2 * far or (size[k] == 2 * far and place < far)):
                continue
            last = start[k] + (place + far) % size[k]
            heading = _minus(_row(points, following[last]), _row(points, k))
            monotone, row = True, k
            for _ in range(far + 1):
                monotone &= _dot(_row(old, row), heading) > 0 and _dot(_row(new, row), heading) > 0
                row = following[row]
            if not monotone:
                square = _square_between(middle, k, last)
                slack = _slack(points, step, following, k, last, square, half)
                if not slack >= margin:
                    margin = slack
                if margin != margin:
                    return KEEPS, margin
    return KEEPS, margin


@compiled
def step_limits(points: Array, following: Indices, i: Indices, j: Indices, most: float) -> Array:
    """Return the least distance of each vertex's segments from their partners, at most `most`, [N]."""
    middle, half = _middles(points, following)
    gap = np.full(len(points), most)
    for pair in range(len(i)):
        a, b = i[pair], j[pair]
        bound = most + half[a] + half[b]
        if _square_between(middle, a, b) >= bound * bound:
            continue
        _, _, w = _apart(points, following, a, b)
        distance = math.sqrt(_dot(w, w))
        for row in (a, following[a], b, following[b]):
            gap[row] = min(gap[row], distance)
    return gap


@compiled
def gap_hinge(
    points: Array,
    following: Indices,
    start: Indices,
    size: Indices,
    i: Indices,
    j: Indices,
    near: float,  # mm between midpoints, beyond which a pair adds nothing
    steps: float,  # along the curve: pairs nearer than these are neighbours
    distance: float,
) -> tuple[float, Array]:
    """Return the sum over pairs of segments of (distance - gap)+^2, mm^2, and its gradient [N, 3]."""
    middle, _ = _middles(points, following)
    total, gradient = 0.0, np.zeros_like(points)
    for pair in range(len(i)):
        a, b = i[pair], j[pair]
        if not _square_between(middle, a, b) < near * near:
            continue
        along = abs(a - b)
        if start[a] == start[b] and not min(along, size[a] - along) > steps:
            continue
        s, t, w = _apart(points, following, a, b)
        square = _dot(w, w)
        gap = math.sqrt(max(square, _LEAST_SQUARE))
        if not gap < distance:
            continue
        total += (distance - gap) ** 2
        if square < _LEAST_SQUARE:
            continue
        scale = -2 * (distance - gap) / gap
        for axis in range(3):
            pull = scale * w[axis]
            gradient[a, axis] += (1 - s) * pull
            gradient[following[a], axis] += s * pull
            gradient[b, axis] -= (1 - t) * pull
            gradient[following[b], axis] -= t * pull
    return total, gradient


@compiled
def bend_hinge(points: Array, following: Indices, radius: float) -> tuple[float, Array]:
    """Return the sum over vertices of (radius times curvature - 1)+^2, and its gradient [N, 3].

    The bend radius of a vertex is min(adjacent edges) / (2 tan(turning angle / 2)) (Rawdon 1998);
    2 tan(theta / 2) = 2 sqrt((1 - cos theta) / (1 + cos theta)).
    """
    total, gradient = 0.0, np.zeros_like(points)
    for k in range(len(points)):
        middle = following[k]
        last = following[middle]
        d = _minus(_row(points, middle), _row(points, k))
        e = _minus(_row(points, last), _row(points, middle))
        one, two = math.sqrt(_dot(d, d)), math.sqrt(_dot(e, e))
        cosine, product, shorter = _dot(d, e), one * two, min(one, two)
        if product == 0:  # an edge without length turns by no angle
            continue
        rest = product + cosine
        if 2 * cosine < -product:  # they cancel: from (product - cosine) rest = |d x e|^2
            normal = _cross(d, e)
            rest = _dot(normal, normal) / (product - cosine)
        open_ = rest > _FOLDED * product
        folded = rest if open_ else _FOLDED * product
        ratio = (product - cosine) / folded
        root = math.sqrt(max(ratio, _LEAST_SQUARE))
        hinge = 2 * root / shorter * radius - 1
        if hinge > 0:
            total += hinge * hinge
            slope = 2 * hinge * radius
            # the derivatives are those by the product, the cosine and the shorter edge
            by_ratio = slope / (shorter * root) / folded if ratio >= _LEAST_SQUARE else 0.0
            by_product = by_ratio * (1 - ratio * (1 if open_ else _FOLDED))
            by_cosine = -by_ratio * (1 + ratio) if open_ else -by_ratio
            by_shorter = -slope * 2 * root / (shorter * shorter)
            by_one = by_product * two + (by_shorter if one < two else 0.0)
            by_two = by_product * one + (by_shorter if two <= one else 0.0)
            for axis in range(3):
                pull_d = by_one * d[axis] / one + by_cosine * e[axis]
                pull_e = by_two * e[axis] / two + by_cosine * d[axis]
                gradient[k, axis] -= pull_d
                gradient[middle, axis] += pull_d - pull_e
                gradient[last, axis] += pull_e
    return total, gradient


@compiled
def look_up(mask: Mask, away: Array, bent: Mask) -> None:
    """Set `bent` (H, W) where the mask, interpolated bilinearly at offsets `away` (H, W, 2), is >= 0.5."""
    rows, columns = mask.shape
    for i in range(rows):
        for j in range(columns):
            x, y = j + away[i, j, 0], i + away[i, j, 1]
            if not (0 <= x <= columns - 1 and 0 <= y <= rows - 1):
                bent[i, j] = False
                continue
            left, top = min(int(x), columns - 2), min(int(y), rows - 2)
            p, q = x - left, y - top
            share = 0.0
            if mask[top, left]:
                share += (1 - q) * (1 - p)
            if mask[top, left + 1]:
                share += (1 - q) * p
            if mask[top + 1, left]:
                share += q * (1 - p)
            if mask[top + 1, left + 1]:
                share += q * p
            bent[i, j] = share >= 0.5
