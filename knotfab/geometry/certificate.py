"""Certificates of isotopy: a straight-line motion of all vertices that provably crosses nothing.

Two segments whose end points move by da0, da1 and db0, db1 cannot meet if every relative displacement
|da - db| stays below their distance, because the relative displacement of any two of their points is a
convex combination of those of their ends. Adjacent segments share an end, and cannot overlap as
long as both keep a positive component along one direction throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.arrays import Array, Indices
from knotfab.geometry.neighbours import Neighbours, closest_parameters
from knotfab.geometry.polylines import Polylines, dot

__all__ = ["Certificate", "certify", "step_limits"]

_ROUNDING = 1e-13  # of the coordinates: what double precision may be off by


@dataclass(frozen=True)
class Certificate:
    """The verdict on one step: `margin` is the least (distance - relative displacement), mm."""

    valid: bool
    reason: str
    margin: float


def _gap_bound(points: Array, rings: Polylines, i: Indices, j: Indices) -> Array:
    """A lower bound of the distance of segments i and j: that of their middles less their halves."""
    edge = points[rings.next] - points
    half = 0.5 * np.sqrt(dot(edge, edge))
    middle = points + 0.5 * edge
    apart = middle[i] - middle[j]
    return np.asarray(np.sqrt(dot(apart, apart)) - half[i] - half[j])


def _exact_gap(points: Array, rings: Polylines, i: Indices, j: Indices) -> Array:
    u, v = points[rings.next[i]] - points[i], points[rings.next[j]] - points[j]
    s, t = closest_parameters(points[i], u, points[j], v)
    apart = points[i] + s[:, None] * u - points[j] - t[:, None] * v
    return np.asarray(np.sqrt(dot(apart, apart)))


def _relative(step: Array, rings: Polylines, i: Indices, j: Indices) -> Array:
    """The largest relative displacement between the ends of segments i and those of j."""
    ends_i, ends_j = (step[i], step[rings.next[i]]), (step[j], step[rings.next[j]])
    worst = np.zeros(len(i))
    for a in ends_i:
        for b in ends_j:
            worst = np.maximum(worst, dot(a - b, a - b))
    return np.asarray(np.sqrt(worst))


def certify(points: Array, step: Array, rings: Polylines, near: Neighbours) -> Certificate:
    """Whether moving `points` (N, 3) by `step` along straight lines keeps the knot type.

    `near` may be older than `points`: what it leaves out is covered by a bound on the motion since.
    """
    if not np.isfinite(step).all():
        return Certificate(False, "the step is not finite", -np.inf)
    old = points[rings.next] - points
    new = old + step[rings.next] - step
    after_old, after_new = old[rings.next], new[rings.next]
    towards = old / np.sqrt(dot(old, old))[:, None]
    towards = towards + towards[rings.next]
    for edge in (old, new, after_old, after_new):
        if not (dot(edge, towards) > 0).all():
            return Certificate(False, "adjacent segments may fold back", -np.inf)
    half = 0.5 * float(np.sqrt(max(dot(old, old).max(), dot(new, new).max())))
    largest = float(np.sqrt(dot(step, step).max()))
    margin = near.reach - 2 * half - 2 * near.moved(points) - 2 * largest
    if margin <= 0:
        return Certificate(False, "the neighbour list is too old", margin)
    margin = float(np.minimum(margin, _far_margin(points, step, rings, near.i, near.j)))
    for k in range(2, near.skip):
        margin = float(np.minimum(margin, _near_margin(points, step, old, new, rings, k)))
    if not margin > _ROUNDING * _scale(points):
        return Certificate(False, "strands may pass through each other", margin)
    return Certificate(True, "isotopy", margin)


def _scale(points: Array) -> float:
    """The scale that rounding errors follow, mm."""
    return float(np.abs(points).max())


def _far_margin(points: Array, step: Array, rings: Polylines, i: Indices, j: Indices) -> float:
    """The least (distance - relative displacement) of segment pairs (i, j), as a lower bound."""
    if len(i) == 0:
        return np.inf
    moved = _relative(step, rings, i, j)
    slack = _gap_bound(points, rings, i, j) - moved
    doubt = np.flatnonzero(slack <= 0)
    if len(doubt):
        slack[doubt] = _exact_gap(points, rings, i[doubt], j[doubt]) - moved[doubt]
    return float(slack.min())


def _near_margin(
    points: Array, step: Array, old: Array, new: Array, rings: Polylines, k: int
) -> float:
    """The same for segments `k` steps apart on one ring.

    A run of edges that all keep a positive component along one direction, before and after, is monotone
    along it throughout, so its segments cannot meet: only the others need a distance.
    """
    rows = np.arange(len(points))
    rows = rows[(rings.size > 2 * k) | ((rings.size == 2 * k) & (rows - rings.start < k))]
    run = [rings.ahead(m)[rows] for m in range(k + 1)]
    heading = points[rings.next[run[-1]]] - points[rows]
    monotone = np.ones(len(rows), dtype=bool)
    for edges in (old, new):
        for m in run:
            monotone &= dot(edges[m], heading) > 0
    rest = rows[~monotone]
    return _far_margin(points, step, rings, rest, rings.ahead(k)[rest])


def step_limits(points: Array, rings: Polylines, near: Neighbours, largest: float) -> Array:
    """[N] how far each vertex may go so that strands in `near` cannot meet: 0.45 of their gap."""
    gap = np.full(len(points), largest / 0.45)
    distance = _gap_bound(points, rings, near.i, near.j)
    doubt = np.flatnonzero(distance < largest / 0.45)
    i, j = near.i[doubt], near.j[doubt]
    distance = _exact_gap(points, rings, i, j)
    for rows in (i, rings.next[i], j, rings.next[j]):
        np.minimum.at(gap, rows, distance)
    return 0.45 * gap
