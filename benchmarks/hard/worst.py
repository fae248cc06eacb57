"""What an optimiser may turn to make an error as large as it can be: from numbers to shares of a bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from benchmarks.hard.crossing import passes_through
from benchmarks.hard.light import LampCase
from benchmarks.hard.measure import FORMS, double_error, forward_error, image
from benchmarks.hard.pictures import hopf_link, torus_knot
from benchmarks.hard.rendering import RenderCase
from benchmarks.hard.terms import TERMS, paper_error, term_case
from benchmarks.hard.value_error import value_error
from benchmarks.hard.values import ValueCase, network_case, round_trip_share
from knotfab.base.arrays import Array
from knotfab.geometry.carry import certify
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab_formats.bounds import MOST_MM
from paper.losses import (
    ball,
    bending_loss,
    box,
    length_loss,
    mobius_loss,
    occupancy_loss,
    squared_curvature,
)

KEPT = Path(__file__).with_name("worst.json")  # the worst that CMA-ES found of each in an hour

_CAPSULES = 3
_CORNERS = 9  # corners of a polygon
_RING = 7  # corners of each of two
_BISECTIONS = 24
_FURTHEST = 4.0  # times a step


@dataclass(frozen=True)
class Hunt:
    """`share` takes `size` numbers, each of order 1, to the share of its bound that a case comes to.

    At most 1 where all is well; infinite where something is not finite.
    """

    name: str
    size: int
    share: Callable[[Array], float]


def _power(x: float, low: float, high: float) -> float:
    """Return 10 to a power that goes from `low` to `high` as x goes from -2 to 2, and no further."""
    return float(10 ** np.clip(0.5 * (low + high) + 0.25 * (high - low) * x, low, high))


def _aside(x: Array, low: float, high: float) -> Array:
    """Return (3,) a way of four numbers: a direction and how far."""
    size = float(np.linalg.norm(x[:3]))
    way = x[:3] / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    return np.asarray(way * _power(x[3], low, high))


def _capsules(x: Array) -> RenderCase:
    """Return capsules in a chain of offsets from a nanometre to a metre, so that they can meet in any way."""
    depth = 500.0 + 250.0 * x[3]
    start = np.array([12 * x[4], 10 * x[5], 0.0]) * 2.0**-10 * depth + (0.0, 0.0, depth)
    points = []
    for row in x[6:].reshape(_CAPSULES, 8):
        start = start + _aside(row[:4], -6, 3)
        points += [start, start + _aside(row[4:], -6, 3)]
    eye, radius = float(100 * x[2]), _power(x[0], -6, 1.5)
    # no piece holds its own light, or reaches behind it or beside what it lights
    for point in points:
        depth = max(abs(point[2] - eye), 1.5 * radius)
        point[:] = *np.clip(point[:2], -depth, depth), eye + depth
    return RenderCase(
        "hunted",
        "",
        np.array(points),
        np.arange(2 * _CAPSULES, dtype=np.int64).reshape(-1, 2),
        radius=radius,
        tau=_power(x[1], -1, 5),
        width=20,
        height=16,
        eye=(0.0, 0.0, eye),
    )


def _rendered(form: str, x: Array) -> float:
    case = _capsules(x)
    found = forward_error(case, FORMS[form])
    points = torch.as_tensor(case.points, dtype=torch.float32).requires_grad_()
    moved = replace(case, points=points)  # type: ignore[arg-type]
    (slope,) = torch.autograd.grad(image(moved, torch.float32, FORMS[form]).sum(), points)
    if not (found.finite and bool(slope.isfinite().all())):
        return np.inf
    return max(found.share, found.image_share)


def _in_digits(x: Array) -> float:
    return double_error(_capsules(x), count=2)


def _papers(balls: bool, x: Array) -> float:
    _, share, finite = paper_error(_capsules(x), balls, most=60)
    return share if finite else np.inf


def _polygon(x: Array) -> Array:
    """Return (n, 3) corners that follow each other at a micrometre to some mm: mostly about one."""
    ways = np.array([_aside(row + (0, 0, 0, 1.5), -6, 0.6) for row in x.reshape(-1, 4)])
    return np.asarray(np.cumsum(ways, axis=0))


def _valued(make: Callable[[Array], ValueCase], x: Array) -> float:
    found = value_error(make(_polygon(x)))
    return found.share if found.finite else np.inf


def _term(kind: str, points: Array) -> ValueCase:
    return term_case(kind, kind, "", points, smooth=False)


_LOSSES: dict[str, Callable[[Tensor], Tensor]] = {
    "Moebius": lambda k: mobius_loss(k, 0.4, tuple(torch.triu_indices(_CORNERS, _CORNERS, 1))),
    "curvature": lambda k: squared_curvature(k).sum(),
    "bending": lambda k: bending_loss(k, 1.0),
    "length budget": lambda k: length_loss(k, 1.0),
    "box": lambda k: occupancy_loss(k, 0.2, box((-0.9, -0.9, -0.3), (0.9, 0.9, 0.3))),
    "ball": lambda k: occupancy_loss(k, 0.2, ball((0.0, 0.0, 0.0), 0.5)),
}


def _loss(kind: str, points: Array) -> ValueCase:
    return ValueCase(kind, "", (torch.as_tensor(points)[None],), _LOSSES[kind], smooth=False)


def _networked(x: Array) -> float:
    """Return a network's value, and its way there and back."""
    case, network = network_case(
        "hunted",
        "",
        int(np.clip(round(4 + 3 * x[0]), 1, 12)),
        log_scale=_power(x[1], -2, 0.4),
        weight=_power(x[2], -3, 2),
        far=_power(x[3], -3, 6),
        back=bool(x[4] > 0),
        seed=int(abs(1000 * x[5])),
    )
    found = value_error(replace(case, smooth=False))
    shares = (found.share, *round_trip_share(network, case.inputs[0]))
    return max(shares) if found.finite else np.inf


def _passed(start: Array, x: Array) -> float:
    """Measure how far along a step the certificate lets two rings, or a knot, go, over how far until edges
    meet."""
    corners, step = x.reshape(2, -1, 3)
    points = start + 0.3 * corners
    sizes = (_RING, _RING) if len(points) == 2 * _RING else (len(points),)
    rings = polylines_of_sizes(sizes)
    near = find_neighbours(points, rings, 1e3, 2)
    meets = _least(lambda f: passes_through(points, f * step, rings.next))
    stops = _least(lambda f: not certify(points, f * step, rings, near).valid)
    return stops / meets


def _least(holds: Callable[[float], bool]) -> float:
    """Give the least factor from which on something holds, by bisection; the furthest where it never does."""
    low, high = 0.0, _FURTHEST
    if not holds(high):
        return high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def _lit(x: Array) -> float:
    far = _power(x[0], 1, 6)
    at = np.array([far * x[1], far * x[2], -100.0 + (far + 100) * _power(x[3], -9, -0.05)])
    reach = float(np.hypot(np.hypot(*at[:2]), far - at[2]))
    widest = 2 * min(far - at[2], reach)
    lamp = min(widest * _power(x[4], -9, -0.01), MOST_MM)  # a scene takes no wider one
    case = LampCase("hunted", "", (at[0], at[1], at[2]), lamp, far)
    claimed = case.claimed()
    return case.true() / claimed if np.isfinite(claimed) else np.inf


HUNTS: dict[str, Hunt] = {
    hunt.name: hunt
    for hunt in (
        *(Hunt(f"{f} renderer", 6 + 8 * _CAPSULES, partial(_rendered, f)) for f in FORMS),
        Hunt("double precision", 6 + 8 * _CAPSULES, _in_digits),
        Hunt("ellipse", 6 + 8 * _CAPSULES, partial(_papers, True)),
        Hunt("capsule", 6 + 8 * _CAPSULES, partial(_papers, False)),
        *(Hunt(kind, 4 * _CORNERS, partial(_valued, partial(_term, kind))) for kind in TERMS),
        *(Hunt(kind, 4 * _CORNERS, partial(_valued, partial(_loss, kind))) for kind in _LOSSES),
        Hunt("network", 6, _networked),
        Hunt(
            "certificate, two rings", 12 * _RING, partial(_passed, np.concatenate(hopf_link(_RING)))
        ),
        Hunt("certificate, a trefoil", 6 * 12, partial(_passed, torus_knot(2, 3, 12))),
        Hunt("lamp", 5, _lit),
    )
}
