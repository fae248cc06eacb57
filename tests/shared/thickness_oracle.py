"""The contract's thickness by enumeration of all chords, in extended precision."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array

Long = np.longdouble
Wide = NDArray[np.longdouble]

ROUNDING = 1e-17  # a hundred units of extended precision


@dataclass(frozen=True)
class Enumerated:
    """MinRad, and half the shortest doubly critical chord."""

    min_rad: float
    half_dcsd: float

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
    chords = (_vertex_vertex(v), _vertex_edge(v, edges), _edge_edge(v, edges))
    return Enumerated(rad, min(float(lengths.min(initial=np.inf)) for lengths in chords) / 2)


@dataclass(frozen=True)
class _Vertices:
    point: Wide
    into: Wide
    out: Wide

    @property
    def longest(self) -> float:
        return float(np.nanmax(np.abs(self.out)))

    def turns(self, k: NDArray[np.int64], chord: Wide) -> NDArray[np.bool_]:
        """Tell whether the length of chords that leave vertices k turns there, to rise or to fall."""
        behind = (self.into[k] * chord).sum(axis=1)
        ahead = (self.out[k] * chord).sum(axis=1)
        e = ROUNDING * np.sqrt((chord * chord).sum(axis=1)) * self.longest
        rises = (np.isnan(behind) | (behind >= -e)) & (np.isnan(ahead) | (ahead <= e))
        falls = (behind <= e) & (ahead >= -e)
        turned: NDArray[np.bool_] = rises | falls
        return turned


def _vertex_vertex(v: _Vertices) -> Wide:
    i, j = np.triu_indices(len(v.point), 1)
    d = v.point[j] - v.point[i]
    return _norm(d[v.turns(i, d) & v.turns(j, -d)])


def _vertex_edge(v: _Vertices, edges: NDArray[np.int64]) -> Wide:
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
    return _norm(d[v.turns(i, d)])


def _edge_edge(v: _Vertices, edges: NDArray[np.int64]) -> Wide:
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
    return _norm((b + t[:, None] * w - a - s[:, None] * u)[inside])


def _norm(x: Wide) -> Wide:
    length: Wide = np.sqrt((x * x).sum(axis=1))
    return length
