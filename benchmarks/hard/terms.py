"""Hard cases of the search's own terms, grace, bend, clearance and length, each with its definition.

They are worked out in double precision alone, by compiled loops; the definitions below share nothing with
these and are evaluated in numpy's long double, which has 11 bits more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits import terms as bend
from knotfab.limits import terms as clearance
from knotfab.limits import terms as length
from knotfab.limits.terms import Limits, State
from knotfab.render.device import known
from knotfab.search.objective import Grace, Weights
from knotfab_formats.scene import SettledRegion

from .curves import circle, torus_knot
from .values import ValueCase

RADIUS = 0.2
_REGION = SettledRegion(kind="box", size_mm=(1e3, 1e3, 1e3))
LIMITS = Limits(RADIUS, 0.1, 0.5, 5.0, _REGION)
TERMS = ("grace", "bend", "clearance", "length")


def term_case(
    kind: str, name: str, why: str, points: Array, smooth: bool = True, jumps: bool = False
) -> ValueCase:
    """Make the term `kind` of one closed polygon (n, 3), whose mean edge counts as the one it has here."""
    spacing = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).mean())
    f = partial(_value, kind, spacing)
    oracle = partial(_ORACLES[kind], spacing)
    return ValueCase(name, why, (torch.as_tensor(points),), f, smooth, jumps, oracle=oracle)


def term_cases() -> tuple[ValueCase, ...]:
    """Return all of them, in one order."""
    knot = torus_knot(2, 3, 40) / 3
    doubled, spiked, touching = knot.copy(), knot.copy(), knot.copy()
    doubled[5] = doubled[4]
    spiked[7] = spiked[5]
    touching[20] = touching[3]
    straight = np.zeros((12, 3))
    straight[:, 0] = np.minimum(np.arange(12), 12 - np.arange(12)) / 3
    s = np.linspace(0, 3, 16)
    there = np.stack([s, 0 * s, 0 * s], 1)
    hairpin = np.concatenate([there, there[::-1] + (0.0, 0.0, 0.3)])
    uneven = knot.copy()
    uneven[9] = knot[8] + 1e-9 * (knot[9] - knot[8])
    ordinary = "none: what the others are held against"
    return (
        term_case("grace", "grace", ordinary, knot),
        term_case("grace", "grace at a cusp", "there and back: half a turn", spiked, False),
        term_case(
            "grace",
            "grace, doubled point",
            "an edge without direction or length",
            doubled,
            False,
            True,
        ),
        term_case(
            "grace", "grace, edge of 1e-9", "a turn over hardly any length", uneven, False, True
        ),
        term_case("grace", "grace of a line", "no turn: the energy's least", straight, False),
        term_case("bend", "bend", ordinary, knot),
        term_case(
            "bend", "bend at a cusp", "half a turn: the tangent of a right angle", spiked, False
        ),
        term_case("bend", "bend, doubled point", "0 / 0", doubled, False, True),
        term_case("clearance", "clearance", ordinary, 0.5 * knot),
        term_case(
            "clearance",
            "clearance, points that meet",
            "distance 0 has no direction",
            touching,
            False,
        ),
        term_case(
            "clearance",
            "clearance, parallel",
            "two strands: all their points are nearest",
            hairpin,
            False,
        ),
        term_case("length", "length term", ordinary, knot),
        term_case(
            "length", "length term at its limit", "the hinge's corner", _of_length(4.95), False
        ),
    )


def _of_length(length_mm: float) -> Array:
    ring = circle(24)
    return ring * (length_mm / np.linalg.norm(np.roll(ring, -1, 0) - ring, axis=1).sum())


def _value(kind: str, spacing: float, points: Tensor) -> Tensor:
    rings = polylines_of_sizes((len(points),))
    plain = points.detach().numpy().astype(np.float64)
    near = find_neighbours(plain, rings, 1e3, 2)
    state = replace(State.at(plain, rings, near), spacing=spacing)
    terms = {
        "bend": bend.bend_term,
        "clearance": clearance.clearance_term,
        "length": length.length_term,
    }
    found = Grace(RADIUS, 1.0)(state, Weights()) if kind == "grace" else terms[kind](state, LIMITS)
    return known(found[0], (points, found[1]))


def _edges(points: Array) -> tuple[Array, Array]:
    edge = np.roll(points, -1, 0) - points
    return edge, np.sqrt((edge * edge).sum(1))


def _units(points: Array) -> tuple[Array, Array]:
    """Return unit tangents, nothing where an edge has no length, and lengths."""
    edge, size = _edges(points)
    return edge / np.where(size > 0, size, 1)[:, None], size


def _grace(spacing: float, points: Array) -> float:
    """Return r times the sum of |t' - t|² over the mean of both edges, and half the length in radii."""
    unit, size = _units(points)
    turn = np.roll(unit, -1, 0) - unit
    energy = ((turn * turn).sum(1) / (0.5 * (size + np.roll(size, -1)))).sum()
    return float(LIMITS.radius * energy + 0.5 * size.sum() / LIMITS.radius)


def _bend(spacing: float, points: Array) -> float:
    """Hinge of 2 tan(turn / 2) over the shorter edge; a turn is at most what leaves 1e-9 of its cosine."""
    unit, size = _units(points)
    after, longer = np.roll(unit, -1, 0), np.roll(size, -1)
    less, more = ((after - unit) ** 2).sum(1), ((after + unit) ** 2).sum(1)
    tangent = np.sqrt(np.maximum(less / np.maximum(more, 2e-9), 1e-12))
    shorter = np.minimum(size, longer)
    hinge = 2 * tangent / np.where(shorter > 0, shorter, np.inf) * 1.06 * LIMITS.bend_radius - 1
    return float(spacing / LIMITS.radius * (np.maximum(hinge, 0) ** 2).sum())


def _length(spacing: float, points: Array) -> float:
    over = max(0.0, float(_edges(points)[1].sum()) - 0.99 * LIMITS.length)
    return (over / LIMITS.radius) ** 2


def _clearance(spacing: float, points: Array) -> float:
    """Hinge of the least of nine: inside both segments, or an end of one against the other."""
    n, edge = len(points), _edges(points)[0]
    distance = LIMITS.separation * 1.02
    middle = points + 0.5 * edge
    total = 0.0
    for i in range(n):
        for j in range(i + 2, n):
            along = min(j - i, n - j + i)
            away = np.sqrt(((middle[i] - middle[j]) ** 2).sum())
            if (
                along < 2
                or along <= 0.5 * np.pi * LIMITS.separation / spacing
                or away >= distance + 1.5 * spacing
            ):
                continue
            gap = _gap(points[i], edge[i], points[j], edge[j])
            total += max(0.0, float(distance - gap)) ** 2
    return float(spacing / LIMITS.radius**3 * total)


def _gap(a: Array, d: Array, b: Array, e: Array) -> float:
    """Return the distance of segments a + s d and b + t e."""
    best = [
        np.sqrt(((p - (q + np.clip((p - q) @ w / max(w @ w, 1e-300), 0, 1) * w)) ** 2).sum())
        for p, q, w in ((a, b, e), (a + d, b, e), (b, a, d), (b + e, a, d))
    ]
    normal = np.cross(d, e)
    square = normal @ normal
    if square > 0:
        s, t = np.cross(b - a, e) @ normal / square, np.cross(b - a, d) @ normal / square
        if 0 <= s <= 1 and 0 <= t <= 1:
            best.append(abs((b - a) @ normal) / np.sqrt(square))
    return float(max(min(best), 1e-6))


_ORACLES: dict[str, Callable[..., float]] = {
    "grace": _grace,
    "bend": _bend,
    "clearance": _clearance,
    "length": _length,
}
