"""Polygons carried along isotopies in certified steps, and resampled without changing their type.

A homeomorphism keeps the type of a curve, but says nothing of the polygon through a few of its points. So
the polygon itself is carried along the path of homeomorphisms from the identity to the one in question,
in straight-line steps that are each certified (`certificate.certify`). Where no step is
short enough, the polygon is too coarse for the map, and gets more vertices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from knotfab.base.arrays import Array
from knotfab.geometry import kernels
from knotfab.geometry.measures import Neighbours, find_neighbours
from knotfab.geometry.polylines import (
    Polylines,
    arc_lengths,
    dot,
    number_runs,
    points_at,
    polylines_of,
)

Parameters = tuple[Array, ...]  # increasing, one array a curve, in [0, period)
Path = Callable[[Array, float], Array]  # (points, share of the way) -> points

# shortest share of a motion along straight lines: there one step is mostly enough
_STRAIGHT = 1 / 64
_SKIP = 6  # pairs nearer along the curve are always tested, as in the flow


@dataclass(frozen=True)
class Curves:
    """Smooth closed curves: periodic cubic splines through polygons, parametrised by arc length."""

    knots: Parameters  # [n] parameter of each polygon's vertices, from 0
    periods: tuple[float, ...]  # length of each polygon, mm
    splines: tuple[CubicSpline, ...]

    @classmethod
    def through(cls, polygons: Sequence[Array]) -> Curves:
        """Return the curves through the vertices of closed polygons [(n, 3) mm]."""
        knots, periods, splines = [], [], []
        for polygon in polygons:
            closed = np.concatenate([polygon, polygon[:1]])
            arc = arc_lengths(polygon)
            knots.append(arc[:-1])
            periods.append(float(arc[-1]))
            splines.append(CubicSpline(arc, closed, bc_type="periodic"))
        return cls(tuple(knots), tuple(periods), tuple(splines))

    def at(self, where: Parameters) -> list[Array]:
        """Return the points of each curve at its parameters, [(n, 3)]."""
        return [np.asarray(s(w)) for s, w in zip(self.splines, where, strict=True)]


def refine_parameters(where: Parameters, periods: Sequence[float]) -> Parameters:
    """Add a parameter midway between each two, which doubles their number."""
    out = []
    for w, period in zip(where, periods, strict=True):
        ahead = np.append(w[1:], w[0] + period)
        out.append(np.sort(np.stack([w, 0.5 * (w + ahead)]).ravel() % period))
    return tuple(out)


def space_evenly(
    where: Parameters, image: Sequence[Array], periods: Sequence[float], edge_mm: float
) -> Parameters:
    """Return parameters at which vertices on polygons `image` are evenly `edge_mm` apart."""
    out = []
    for w, polygon, period in zip(where, image, periods, strict=True):
        arc = arc_lengths(polygon)
        count = max(24, round(arc[-1] / edge_mm))
        even = np.linspace(0.0, arc[-1], count, endpoint=False)
        out.append(np.sort(np.interp(even, arc, np.append(w, w[0] + period)) % period))
    return tuple(out)


def _on_polygon(polygon: Array, where: Array, period: float, wanted: Array) -> Array:
    """Interpolate the closed polygon with vertices at `where` linearly at `wanted`."""
    return np.stack(
        [np.interp(wanted, where, polygon[:, k], period=period) for k in range(3)], axis=1
    )


def certify_same_type(
    old: Sequence[Array],
    old_where: Parameters,
    new: Sequence[Array],
    new_where: Parameters,
    periods: Sequence[float],
) -> Carried:
    """Certify that closed polygons are isotopic by the motion that matches their parameters.

    Both are cut at all parameters of either, which changes neither, and each point goes straight to
    the one of the same parameter, in as many certified steps as it takes: `reached` is then 1. (A single
    step says nothing about a corner that a smooth curve rounds: there the ends of an edge go as far as the
    edge is long, however short it is.)
    """
    start, end = [], []
    for p, at_p, q, at_q, period in zip(old, old_where, new, new_where, periods, strict=True):
        both = np.unique(np.concatenate([at_p, at_q]))
        # parameters that differ by rounding alone would make edges of no length
        both = both[np.diff(both, append=both[0] + period) > 1e-9 * period]
        start.append(_on_polygon(p, at_p, period, both))
        end.append(_on_polygon(q, at_q, period, both))
    rings = polylines_of(start)
    points = np.concatenate(start)
    step = np.concatenate(end) - points
    return carry(points, rings, lambda at, share: points + share * step, np.inf, _STRAIGHT, 1.0)


def _reach(points: Array, rings: Polylines, step: Array) -> float:
    """Return the reach of a list of pairs, mm, that suffices to certify `step` and a few steps like it."""
    edge = points[rings.next] - points
    after = edge + step[rings.next] - step
    longest = np.sqrt(max(float(dot(edge, edge).max()), float(dot(after, after).max())))
    return float(2 * longest + 4 * np.sqrt(dot(step, step).max()))


@dataclass(frozen=True)
class Carried:
    """The polygon that was reached, and the record of its certificates."""

    points: Array
    reached: float  # share of the way; 1: all of it is proved
    steps: int
    refused: int
    least_margin: float  # mm


def carry(
    points: Array,
    rings: Polylines,
    path: Path,
    longest: float,
    shortest: float = 1e-4,
    first: float = 0.02,
) -> Carried:
    """Carry closed polygons (N, 3) along `path` from share 0, where it is the identity, to 1.

    Every step is certified; one that fails is halved, and the next may be longer again. The
    polygons' vertices are on the images of the curves throughout.

    Args:
        path: continuous in the share; each point goes its own way.
        longest: no step moves a vertex further than about this, mm.
        shortest: share of the way at which the polygon is found too coarse: `reached` is then below 1.
        first: share that is tried first.
    """
    here, share, stride, steps, refused = points, 0.0, first, 0, 0
    least = np.inf
    while share < 1.0:
        ahead = min(1.0, share + stride)
        there = path(points, ahead)
        step = there - here
        furthest = float(np.sqrt(dot(step, step).max()))
        verdict = _verdict(here, step, rings) if furthest <= longest else None
        if verdict is None or not verdict.valid:
            refused += verdict is not None
            stride = 0.5 * (ahead - share)
            if stride < shortest:
                break
            continue
        here, share, steps = there, ahead, steps + 1
        least = min(least, verdict.margin)
        stride *= 1.5
    return Carried(here, share, steps, refused, float(least))


def _verdict(points: Array, step: Array, rings: Polylines) -> Certificate:
    near = find_neighbours(points, rings, _reach(points, rings, step), _SKIP)
    return certify(points, step, rings, near)


# Certificates of isotopy: a straight-line motion of all vertices that provably crosses nothing.

_ROUNDING = 1e-13  # a share of the coordinates by which double precision may be off


@dataclass(frozen=True)
class Certificate:
    """The verdict on one step: `margin` is the least (distance - relative displacement), mm."""

    valid: bool
    reason: str
    margin: float


def certify(points: Array, step: Array, rings: Polylines, near: Neighbours) -> Certificate:
    """Return whether moving `points` (N, 3) by `step` in straight lines provably keeps the knot type.

    `near` may be older than `points`: what it leaves out is covered by a bound on the motion since.
    """
    if not np.isfinite(step).all():
        return Certificate(False, "the step is not finite", -np.inf)
    room = near.reach - 2 * near.moved(points)
    lists = (rings.next, rings.start, rings.size, near.i, near.j)
    found, margin = kernels.step_margin(points, step, *lists, near.skip, room)
    if found == kernels.FOLDS:
        return Certificate(False, "adjacent segments may fold back", margin)
    if found == kernels.TOO_OLD:
        return Certificate(False, "the neighbour list is too old", margin)
    # the error of double precision follows the size of the coordinates
    if not margin > _ROUNDING * float(np.abs(points).max()):
        return Certificate(False, "strands may pass through each other", margin)
    return Certificate(True, "isotopy", margin)


def step_limits(points: Array, rings: Polylines, near: Neighbours, largest: float) -> Array:
    """Return how far each vertex may move so that strands in `near` cannot meet: 0.45 of their gap, [N]."""
    return 0.45 * kernels.step_limits(points, rings.next, near.i, near.j, largest / 0.45)


# Resampling as a certified isotopy: new vertices, evenly spaced along the curve.


# vertices of a ring: with twelve, the corners of rings about specks and stars come nearer than their sides
_LEAST = 24


def _interpolate(points: Array, parameter: Array, where: Array) -> Array:
    """Interpolate the closed polyline with vertices at `parameter` [n + 1] at `where`."""
    return points_at(np.concatenate([points, points[:1]]), parameter, where)


def resample(
    points: Array, rings: Polylines, edge_mm: float
) -> tuple[Array, Polylines, Certificate]:
    """Resample rings evenly, about `edge_mm` apart, on the cubic spline through their vertices.

    The straight-line motion from the old polygons to the new, matched by arc length and refined to the
    vertices of both, is certified as an isotopy. Where it is not, the same is tried along the old
    polygons themselves; and where that fails too, they come back with the refusal.
    """
    verdict = Certificate(False, "nothing to resample", -np.inf)
    for smooth in (True, False):
        fresh, old_union, new_union = [], [], []
        for part in rings.split(points):
            new, old_at, new_at = _resample_one(part, edge_mm, smooth)
            fresh.append(new)
            old_union.append(old_at)
            new_union.append(new_at)
        both = polylines_of(old_union)
        start = np.concatenate(old_union)
        step = np.concatenate(new_union) - start
        near = find_neighbours(start, both, 3.0 * edge_mm, 6)
        verdict = certify(start, step, both, near)
        if verdict.valid:
            return np.concatenate(fresh), polylines_of(fresh), verdict
    return points, rings, verdict


def _resample_one(part: Array, edge_mm: float, smooth: bool) -> tuple[Array, Array, Array]:
    """Resample one ring; also return old and new positions at the vertices of both."""
    arc = arc_lengths(part)
    count = max(_LEAST, round(arc[-1] / edge_mm))
    where = np.linspace(0.0, arc[-1], count + 1)
    if smooth:
        spline = CubicSpline(arc, np.concatenate([part, part[:1]]), bc_type="periodic")
        # a second pass makes vertices even in the new polygon's length, not only in the old one's
        for _ in range(2):
            at = arc_lengths(spline(where[:-1]))
            where = np.interp(np.linspace(0.0, at[-1], count + 1), at, where)
        fresh = np.asarray(spline(where[:-1]))
    else:
        fresh = _interpolate(part, arc, where[:-1])
    union = np.unique(np.concatenate([arc[:-1], where[:-1]]))
    union = union[np.diff(union, append=arc[-1]) > 1e-6 * arc[-1] / count]
    return fresh, _interpolate(part, arc, union), _interpolate(fresh, where, union)


def subdivide(points: Array, rings: Polylines, edge_mm: float) -> tuple[Array, Polylines]:
    """Split edges longer than `edge_mm`. The curves stay the same, so nothing needs a certificate."""
    fresh = []
    for part in rings.split(points):
        edge = np.roll(part, -1, axis=0) - part
        pieces = np.maximum(1, np.round(np.linalg.norm(edge, axis=1) / edge_mm)).astype(int)
        first, number = number_runs(pieces)
        share = number / pieces[first]
        fresh.append(part[first] + share[:, None] * edge[first])
    return np.concatenate(fresh), polylines_of(fresh)
