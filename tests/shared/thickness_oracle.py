"""The contract's thickness by enumeration, twice: in extended precision, and in exact fractions."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array

Long = np.longdouble
Wide = NDArray[np.longdouble]
Exact = tuple[Fraction, Fraction, Fraction]

ROUNDING = 1e-17  # a hundred units of extended precision


@dataclass(frozen=True)
class Enumerated:
    """MinRad, half the shortest doubly critical chord, and half the shortest strut.

    A strut is a chord whose length falls in no direction, to first order: a local minimum.
    """

    min_rad: float
    half_dcsd: float
    half_strut: float

    @property
    def value(self) -> float:
        return min(self.min_rad, self.half_dcsd)


def enumerate_chords(polygons: Sequence[Array], closed: Sequence[bool]) -> Enumerated:
    """All pairs of vertices, of a vertex and an edge, and of two edges.

    Critical: perpendicular inside an edge; at a vertex, products with the edges that arrive and
    leave of different signs or zero. Left out: pairs on one edge, and insides of adjacent edges.
    """
    point, into, out, edge = [], [], [], []
    rad = np.inf
    offset = 0
    origin = polygons[0][0].astype(Long)
    for polygon, is_closed in zip(polygons, closed, strict=True):
        p = polygon.astype(Long) - origin  # exact: digits that all share would cost precision
        n = len(p)
        ahead = np.roll(p, -1, axis=0) - p
        behind = np.roll(ahead, 1, axis=0)
        a, b = _norm(ahead), _norm(behind)
        inner = slice(None) if is_closed else slice(1, -1)
        with np.errstate(divide="ignore", invalid="ignore"):
            # tan(theta/2) = |a x b| / (|a| |b| + a . b)
            across = _norm(np.cross(behind, ahead))
            radii = np.minimum(a, b) * (a * b + (ahead * behind).sum(1)) / (2 * across)
            # beyond a right angle that sum loses digits: tan(theta/2) = |u - v| / |u + v| does not
            u, v = ahead / a[:, None], behind / b[:, None]
            sharp = np.minimum(a, b) * _norm(u + v) / (2 * _norm(u - v))
            radii = np.where((ahead * behind).sum(1) < 0, sharp, radii)
        radii = np.where(across == 0, np.where((ahead * behind).sum(1) > 0, np.inf, 0), radii)
        rad = min(rad, float(radii[inner].min(initial=np.inf)))
        if not is_closed:
            ahead[-1] = behind[0] = np.nan  # nothing arrives at the start, or leaves the end
        point.append(p)
        into.append(behind)
        out.append(ahead)
        index = np.arange(n if is_closed else n - 1)
        edge.append(np.column_stack([index, (index + 1) % n]) + offset)
        offset += n
    v = _Vertices(np.concatenate(point), np.concatenate(into), np.concatenate(out))
    edges = np.concatenate(edge)
    found = [*_vertex_vertex(v), *_vertex_edge(v, edges), *_edge_edge(v, edges)]
    chords = [c for c, _ in found]
    struts = [c[s] for c, s in found]
    shortest = [
        min((float(x.min()) for x in kind if len(x)), default=np.inf) for kind in (chords, struts)
    ]
    return Enumerated(rad, shortest[0] / 2, shortest[1] / 2)


@dataclass(frozen=True)
class _Vertices:
    point: Wide
    into: Wide
    out: Wide

    @property
    def longest(self) -> float:
        return float(np.nanmax(np.abs(self.out)))

    def turns(
        self, k: NDArray[np.int64], chord: Wide
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Tell whether the length of chords that leave vertices k turns there, and whether to rise."""
        behind = (self.into[k] * chord).sum(axis=1)
        ahead = (self.out[k] * chord).sum(axis=1)
        e = ROUNDING * np.sqrt((chord * chord).sum(axis=1)) * self.longest
        rises = (np.isnan(behind) | (behind >= -e)) & (np.isnan(ahead) | (ahead <= e))
        falls = (behind <= e) & (ahead >= -e)
        return rises | falls, rises


Found = tuple[Wide, NDArray[np.bool_]]


def _vertex_vertex(v: _Vertices) -> Iterator[Found]:
    i, j = np.triu_indices(len(v.point), 1)
    d = v.point[j] - v.point[i]
    one, rises_one = v.turns(i, d)
    other, rises_other = v.turns(j, -d)
    keep = one & other
    yield _norm(d)[keep], (rises_one & rises_other)[keep]


def _vertex_edge(v: _Vertices, edges: NDArray[np.int64]) -> Iterator[Found]:
    i, e = (x.ravel() for x in np.indices((len(v.point), len(edges))))
    own = (edges[e] == i[:, None]).any(axis=1)
    i, e = i[~own], e[~own]
    a = v.point[edges[e, 0]]
    u = v.point[edges[e, 1]] - a
    along, square = ((v.point[i] - a) * u).sum(axis=1), (u * u).sum(axis=1)
    e = ROUNDING * square
    inside = (along >= -e) & (along <= square + e) & (square > 0)
    i, a, u, t = i[inside], a[inside], u[inside], (along[inside] / square[inside])[:, None]
    d = a + t * u - v.point[i]
    turns, rises = v.turns(i, d)
    yield _norm(d)[turns], rises[turns]


def _edge_edge(v: _Vertices, edges: NDArray[np.int64]) -> Iterator[Found]:
    i, j = np.triu_indices(len(edges), 1)
    adjacent = (edges[i][:, :, None] == edges[j][:, None, :]).any(axis=(1, 2))
    i, j = i[~adjacent], j[~adjacent]
    a, b = v.point[edges[i, 0]], v.point[edges[j, 0]]
    u, w = v.point[edges[i, 1]] - a, v.point[edges[j, 1]] - b
    normal = np.cross(u, w)
    square = (normal * normal).sum(axis=1)
    skew = square > 0  # parallel edges: a chord can be slid until an end is a vertex
    a, b, u, w, normal, square = (x[skew] for x in (a, b, u, w, normal, square))
    s = (np.cross(b - a, w) * normal).sum(axis=1) / square
    t = (np.cross(b - a, u) * normal).sum(axis=1) / square
    inside = (s >= -ROUNDING) & (s <= 1 + ROUNDING) & (t >= -ROUNDING) & (t <= 1 + ROUNDING)
    d = (b + t[:, None] * w - a - s[:, None] * u)[inside]
    yield _norm(d), np.ones(len(d), dtype=np.bool_)


def _norm(x: Wide) -> Wide:
    length: Wide = np.sqrt((x * x).sum(axis=1))
    return length


# --- exactly ------------------------------------------------------------------------------------


def exact_thickness(polygons: Sequence[Array]) -> float:
    """The thickness of closed polygons: every comparison in fractions, one square root at the end."""
    squares = []  # squares of thickness, twice over
    points = [[_exact(p) for p in polygon] for polygon in polygons]
    vertices = [(k, i) for k, p in enumerate(points) for i in range(len(p))]
    tightest = math.inf
    for k, i in vertices:
        before, after = _edge(points[k], i - 1), _edge(points[k], i)
        a, b, c = _dot(before, before), _dot(after, after), _dot(before, after)
        # 1 / tan(theta/2) = (1 + cos) / sin, cos = c / sqrt(a b), sin = sqrt(a b - c c) / sqrt(a b)
        root = math.sqrt(a * b)
        sine = math.sqrt(a * b - c * c)
        one_plus = root + float(c) if c > 0 else float(a * b - c * c) / (root - float(c))
        if sine > 0 or c < 0:
            half = math.sqrt(min(a, b)) / 2
            tightest = min(tightest, half * one_plus / sine if sine > 0 else 0.0)
    for (k, i), (m, j) in ((x, y) for x in vertices for y in vertices):
        p, q = points[k], points[m]
        here, there = p[i], q[j]
        d = _minus(there, here)
        if (k, i) < (m, j) and _turns(p, i, d) and _turns(q, j, _minus(here, there)):
            squares.append(_dot(d, d))
        if k != m or i not in (j, (j + 1) % len(q)):
            u = _edge(q, j)
            t = -_dot(d, u) / _dot(u, u)
            foot = _along(d, u, t)
            if 0 <= t <= 1 and _turns(p, i, foot):
                squares.append(_dot(foot, foot))
        apart = k != m or (i - j) % len(p) not in (0, 1, len(p) - 1)
        if (k, i) < (m, j) and apart:
            u, w = _edge(p, i), _edge(q, j)
            uu, ww, uw, du, dw = _dot(u, u), _dot(w, w), _dot(u, w), _dot(d, u), _dot(d, w)
            det = uu * ww - uw * uw
            if det:
                s, t = (du * ww - dw * uw) / det, (du * uw - dw * uu) / det
                if 0 <= s <= 1 and 0 <= t <= 1:
                    chord = _along(_along(d, w, t), u, -s)
                    squares.append(_dot(chord, chord))
    return min(tightest, math.sqrt(min(squares)) / 2) if squares else tightest


def _exact(p: Array) -> Exact:
    return Fraction(float(p[0])), Fraction(float(p[1])), Fraction(float(p[2]))


def _minus(a: Exact, b: Exact) -> Exact:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _along(a: Exact, u: Exact, t: Fraction) -> Exact:
    return a[0] + t * u[0], a[1] + t * u[1], a[2] + t * u[2]


def _dot(a: Exact, b: Exact) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _edge(points: list[Exact], i: int) -> Exact:
    return _minus(points[(i + 1) % len(points)], points[i % len(points)])


def _turns(points: list[Exact], i: int, chord: Exact) -> bool:
    return _dot(_edge(points, i - 1), chord) * _dot(_edge(points, i), chord) <= 0
