"""The contract's thickness by enumeration of all chords, in extended precision, and polygons to try it on."""

from collections.abc import Callable, Sequence
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


Random = np.random.Generator
Polygons = list[Array]


def _regular(rng: Random) -> Polygons:
    n = int(rng.integers(3, 26))
    t = 2 * np.pi * np.arange(n) / n
    return [np.column_stack([np.cos(t), np.sin(t), 0 * t])]


def _stack(rng: Random) -> Polygons:
    ring = _regular(rng)[0]
    turn = rng.choice([0.0, np.pi / len(ring), rng.random()])
    c, s = np.cos(turn), np.sin(turn)
    other = ring @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return [ring, other + [0, 0, rng.choice([0.01, 0.5, 1.0])]]


def _zigzag(rng: Random) -> Polygons:
    n, height = int(rng.integers(2, 7)), rng.choice([0.2, 1.0, 3.0])
    x = np.arange(2 * n + 1) * 0.5
    there = np.column_stack([x, height * (np.arange(2 * n + 1) % 2), 0 * x])
    gap = rng.choice([1.0, 4.0])
    return [np.concatenate([there, there[::-1] * [1, rng.choice([-1, 1]), 1] + [0, gap + 3, 0]])]


def _slit(rng: Random) -> Polygons:
    """Long parallel edges, or nearly parallel by an angle from 1 to 1e-12."""
    length, gap = rng.choice([5.0, 50.0, 1000.0]), rng.choice([0.5, 1.0, 2.0])
    tilt = length * 10.0 ** rng.integers(-12, -1) * rng.choice([-1, 0, 1])
    lift = length * 10.0 ** rng.integers(-12, -1) * rng.choice([-1, 0, 1])
    split = int(rng.integers(1, 5))
    x = np.linspace(0, length, split + 1)
    back = np.linspace(length, 0, int(rng.integers(1, 5)) + 1)
    slant = gap + tilt * back / length
    upper = np.column_stack([back, slant, lift * (back / length - 0.37)])
    return [np.concatenate([np.column_stack([x, 0 * x, 0 * x]), upper])]


def _lattice(rng: Random) -> Polygons:
    """A closed walk of unit steps, mostly not simple: thickness 0 or 1/2, right angles everywhere."""
    half = rng.integers(0, 3, int(rng.integers(2, 7)))
    steps = np.eye(3)[np.concatenate([half, rng.permutation(half)])]
    steps[len(half) :] *= -1
    return [np.cumsum(rng.permutation(steps) if rng.random() < 0.5 else steps, axis=0)]


def _flat(rng: Random) -> Array:
    points = rng.normal(size=(int(rng.integers(4, 14)), 3))
    points[:, 2] = 0
    return points


def _gaussian(rng: Random) -> Polygons:
    return [rng.normal(size=(int(rng.integers(3, 20)), 3)) for _ in range(int(rng.integers(1, 4)))]


def _smooth(rng: Random) -> Polygons:
    """Random waves, sampled finely: bends and strands both decide."""
    polygons = []
    for _ in range(int(rng.integers(1, 3))):
        s = 2 * np.pi * np.arange(int(rng.integers(20, 50)))[:, None]
        s, k = s / len(s), np.arange(1, 4)
        waves = rng.normal(size=(2, 3, 3)) / k[:, None] ** 1.5
        polygons.append(np.cos(s * k) @ waves[0] + np.sin(s * k) @ waves[1])
    return polygons


def _bends(rng: Random) -> Polygons:
    """Legs joined by turns of about 180 degrees: chords at the edge of being critical."""
    n, off = int(rng.integers(1, 9)), rng.choice([0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1])
    t = np.linspace(0, np.pi * (1 + rng.choice([-1, 1]) * off), n + 1)
    turn = np.column_stack([np.sin(t), -np.cos(t), rng.choice([0, 1e-7, 0.3]) * t])
    end = np.array([np.cos(t[-1]), np.sin(t[-1]), 0])
    leg = rng.choice([0.5, 3.0, 30.0])
    first = np.linspace(turn[0] - [leg, 0, 0], turn[0], 3)[:-1]
    last = np.linspace(turn[-1], turn[-1] + leg * end, 3)[1:]
    return [np.concatenate([first, turn, last])]


def _touching(rng: Random) -> Polygons:
    """Two crossing strands a very small or vanishing distance apart."""
    gap = rng.choice([0.0, 1e-9, 1e-6, 1e-3])
    one = np.array([[-3.0, 0, 0], [0, 0, 0], [3, 0, 0], [3, -9, 0], [-3, -9, 0]])
    other = one[:, [1, 0, 2]] * [1, 1, -1] + [rng.choice([0.0, 0.7]), rng.choice([0.0, 0.3]), gap]
    other[3:, 2] += 5
    return [one, other]


def _rods(rng: Random) -> Polygons:
    n = int(rng.integers(2, 6))
    rods = []
    for k in range(n):
        rod = np.array([[0.0, k, 0], [rng.choice([4, 7]), k, 0]])
        rods.append(rod if k % 2 == 0 else rod[::-1])
    away = [[-3.0, n, 9], [-3, -1, 9]]
    return [np.concatenate([*rods, away])]


KINDS: dict[str, Callable[[Random], Polygons]] = {
    "regular": _regular, "stacked": _stack, "zigzag": _zigzag, "slit": _slit, "lattice": _lattice,
    "planar": lambda rng: [_flat(rng)], "gaussian": _gaussian, "smooth": _smooth, "bends": _bends,
    "touching": _touching, "rods": _rods,
}  # fmt: skip


def place(polygons: Polygons, rng: Random) -> Polygons:
    """Perhaps turned, scaled by 1e-6 to 1e6, or moved far away (up to 1e6 of its size)."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.6 else np.eye(3)
    scale = rng.choice([1.0, 1e-6, 1e6])
    shift = rng.choice([0.0, 1.0, 1e6]) * rng.normal(size=3)
    return [(p @ turn + shift) * scale for p in polygons]
