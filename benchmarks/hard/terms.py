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

from knotfab.apps.paper.outlines import Pinhole, render_outlines, signed_distance
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
from paper.camera import paper_camera

from .measure import EPSILONS
from .pictures import circle, torus_knot
from .rendering import RenderCase
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


# The paper's two renderers on the same hard cases, and its closed forms as they are printed.


def applies(case: RenderCase) -> bool:
    """The paper's camera has no picture of one pixel across, and its tube has a radius."""
    return min(case.width, case.height) >= 2 and case.radius > 0


def _camera(case: RenderCase) -> Pinhole:
    half = (0.5 * case.step * (case.width - 1), 0.5 * case.step * (case.height - 1))
    near = max(1.5 * case.radius, 1e-9)
    return paper_camera(
        case.eye,
        focal=(*half, 1.0),
        near=near,
        far=1e12 * near,
        width=case.width,
        height=case.height,
    )


def _distance(case: RenderCase, pairs: tuple[Tensor, Tensor], q: Tensor) -> Tensor:
    return signed_distance(*pairs, q, _camera(case), case.radius) / case.step


def paper_error(case: RenderCase, balls: bool, most: int = 400) -> tuple[float, float, bool]:
    """Return (error px, share of 16 epsilons times condition, finite) of single against double precision.

    At random pixels, each against one capsule (`balls`: one sphere) of the case.
    """
    rng = np.random.default_rng(5)
    row = case.edges[rng.integers(len(case.edges), size=most)]
    u, v = rng.integers(case.width, size=most), rng.integers(case.height, size=most)
    camera = _camera(case)
    found: list[Tensor] = []
    slopes: list[Tensor] = []
    finite = True
    for dtype in (torch.float64, torch.float32):
        p = torch.as_tensor(case.points).to(dtype)
        one = p[row[:, 0]].clone().requires_grad_()
        two = p[row[:, 0] if balls else row[:, 1]].clone().requires_grad_()
        q = camera.plane(torch.as_tensor(u).to(dtype), torch.as_tensor(v).to(dtype))
        s = _distance(case, (one, two), q)
        slopes = list(torch.autograd.grad(s.sum(), (one, two)))
        finite &= bool(s.isfinite().all()) and all(bool(g.isfinite().all()) for g in slopes)
        found.append(s.detach().double())
        if dtype == torch.float64:
            eye = torch.tensor(case.eye, dtype=dtype).abs()
            depth = (one.detach()[:, 2] - case.eye[2]).abs().clamp_min(1e-30)
            kappa = s.detach().abs() + (q.abs().sum(-1) + 2 * case.radius / depth) / case.step
            for g, x in zip(slopes, (one.detach(), two.detach()), strict=True):
                kappa = kappa + (g.abs() * (x.abs() + 2 * eye)).sum(-1)
        p = p.requires_grad_()
        e = torch.as_tensor(case.edges)
        ends = None if balls else p[e[:, 1]]
        tau = case.tau / case.step
        shown = render_outlines(p[e[:, 0]], ends, camera, case.radius, tau)
        (g,) = torch.autograd.grad(shown.sum(), p)
        finite &= bool(shown.isfinite().all()) and bool(g.isfinite().all())
    shown = found[0] > -1e6 / case.step
    away = torch.where(shown & (found[1] > -1e6 / case.step), (found[0] - found[1]).abs(), 0.0)
    bound = EPSILONS * torch.finfo(torch.float32).eps * kappa.clamp_min(1e-300)
    return float(away.max()), float((away / bound).max()), finite


def _printed_conic(p: np.ndarray, radius: float) -> np.ndarray:
    """Return A..F as printed (focal length 1): the cone of tan(theta) = r / |p|."""
    x, y, z = p
    square = p @ p
    k = square**2 / (square + radius**2)
    return np.array([x * x - k, 2 * x * y, y * y - k, 2 * x * z, 2 * y * z, z * z - k])


def printed_corners(one: np.ndarray, other: np.ndarray, radius: float) -> np.ndarray:
    """Return [2, 2] points of contact on the ellipse of `one`, by vanishing point and slopes, as printed."""
    x0, y0 = (one - other)[:2] / (one - other)[2]
    a, b, c, d, e, f = _printed_conic(one, radius)
    first, last = b * x0 - 2 * c * y0 - e, b * y0 + d
    rest = c * y0**2 + e * y0 + f
    alpha = first**2 - 4 * c * x0 * last - 4 * c * rest - 4 * a * c * x0**2
    alpha += 4 * b * (2 * c * x0 * y0 + e * x0)
    beta = -2 * first * last - 4 * b * rest + 4 * a * (2 * c * x0 * y0 + e * x0)
    gamma = last**2 - 4 * a * rest
    root = np.sqrt(beta**2 - 4 * alpha * gamma)
    found = []
    for m in ((-beta + root) / (2 * alpha), (-beta - root) / (2 * alpha)):
        lead = a + b * m + c * m * m
        x = (b * m * x0 - b * y0 + 2 * c * m * m * x0 - 2 * c * m * y0 - e * m - d) / (2 * lead)
        found.append((x, m * (x - x0) + y0))
    return np.array(found)


def printed_fails(case: RenderCase) -> str:
    """Give "" where the printed forms serve; else what goes wrong first: not finite, or how far off, px."""
    worst = 0.0
    p = (case.points - np.array(case.eye)).astype(np.float64)
    for i, j in case.edges[:100]:
        for one, other in ((p[i], p[j]), (p[j], p[i])):
            with np.errstate(all="ignore"):
                corners = printed_corners(one, other, case.radius)
                if not np.isfinite(corners).all():
                    return "not finite"
                # a corner lies on the true outline where its ray touches the tube's surface
                rays = np.concatenate([corners, np.ones((2, 1))], 1)
                rays /= np.linalg.norm(rays, axis=1)[:, None]
                miss = np.linalg.norm(np.cross(rays, one), axis=1) - case.radius
                worst = max(worst, float(np.abs(miss).max() / (abs(one[2]) * case.step)))
    return f"off by {worst:.2g} px" if worst > 1e-3 else ""
