"""Hard cases of the losses and of the network: scalar functions of tensors, and how far they are off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
import torch
from torch import Tensor
from torch.func import functional_call

from knotfab.effects.region import outside
from knotfab.paper.losses import (
    ball,
    bending_loss,
    box,
    knot_lengths,
    length_loss,
    mobius_loss,
    occupancy_loss,
    squared_curvature,
)
from knotfab.scene.model import Region
from knotfab.search.network import CouplingNetwork
from knotfab.search.network.rigid import rotation

from .curves import circle, torus_knot
from .measure import EPSILONS

__all__ = ["Found", "ValueCase", "loss_cases", "network_cases", "value_error"]

Function = Callable[..., Tensor]


@dataclass(frozen=True)
class ValueCase:
    """`f` of `inputs` (float64), a scalar. `smooth`: differentiable there."""

    name: str
    why: str
    inputs: tuple[Tensor, ...]
    f: Function
    smooth: bool = True


@dataclass(frozen=True)
class Found:
    """What is measured; `condition` is relative: sum |df/dx| |x| over |f|."""

    condition: float
    error: float  # of single precision, over |f| (absolute where f is 0)
    share: float  # of 16 epsilons times condition
    double: float  # gradient against central differences, relative
    single: float  # single precision's gradient against it, relative
    finite: bool


def value_error(case: ValueCase) -> Found:
    """Single against double precision, both gradients, all that must be finite."""
    value, slopes = _slopes(case, case.inputs)
    rough, rough_slopes = _slopes(case, tuple(x.float() for x in case.inputs))
    finite = all(bool(x.isfinite().all()) for x in (value, rough, *slopes, *rough_slopes))
    generator = torch.Generator().manual_seed(1)
    size = sum(float((s.abs() * x.abs()).sum()) for s, x in zip(slopes, case.inputs, strict=True))
    # a singular place has no gradient that would tell: look beside it
    for _ in range(0 if case.smooth else 2):
        near = tuple(
            x * (1 + 1e-7 * torch.randn(x.shape, generator=generator, dtype=x.dtype))
            for x in case.inputs
        )
        _, beside = _slopes(case, near)
        size = max(size, sum(float((s * x).abs().sum()) for s, x in zip(beside, near, strict=True)))
    here = float(value)
    total = abs(here) + size
    away = abs(float(rough) - here)
    scale = abs(here) or 1.0
    share = away / max(EPSILONS * torch.finfo(torch.float32).eps * total, 1e-300)
    off = sum(
        float((r.double() - s).square().sum()) for r, s in zip(rough_slopes, slopes, strict=True)
    )
    norm = max(sum(float(s.square().sum()) for s in slopes) ** 0.5, 1e-30)
    double = _against_differences(case, slopes) if case.smooth else 0.0
    return Found(total / scale, away / scale, share, double, off**0.5 / norm, finite)


def _slopes(case: ValueCase, inputs: tuple[Tensor, ...]) -> tuple[Tensor, list[Tensor]]:
    at = [x.detach().clone().requires_grad_() for x in inputs]
    with torch.autograd.set_detect_anomaly(True):
        value = case.f(*at)
        if not value.requires_grad:
            return value, [torch.zeros_like(x) for x in at]
        found = torch.autograd.grad(value, at, allow_unused=True)
    slopes = [torch.zeros_like(x) if g is None else g for x, g in zip(at, found, strict=True)]
    return value.detach(), slopes


def _against_differences(case: ValueCase, slopes: list[Tensor]) -> float:
    """Along random motions, by central differences of the fourth order."""
    generator = torch.Generator().manual_seed(3)
    worst, norm = 0.0, 1e-30
    for _ in range(2):
        ways = [
            torch.randn(x.shape, generator=generator, dtype=x.dtype)
            * (float(x.abs().mean()) or 1.0)
            for x in case.inputs
        ]
        along = sum(float((s * w).sum()) for s, w in zip(slopes, ways, strict=True))
        norm = max(norm, abs(along))
        best = np.inf
        for h in (1e-4, 1e-5):
            one, two = (_central(case, ways, k * h) for k in (1, 2))
            best = min(best, abs((4 * one - two) / 3 - along))
        worst = max(worst, best)
    return worst / norm


def _central(case: ValueCase, ways: list[Tensor], h: float) -> float:
    high, low = (
        case.f(*(x + k * h * w for x, w in zip(case.inputs, ways, strict=True))) for k in (1, -1)
    )
    return float(high - low) / (2 * h)


def _knots(points: np.ndarray) -> tuple[Tensor]:
    return (torch.as_tensor(points)[None],)


def _mobius(count: int) -> Function:
    u, v = torch.triu_indices(count, count, 1)
    return lambda knots: mobius_loss(knots, 0.4, (u, v))


def _neighbours(count: int) -> Function:
    u = torch.arange(count)
    return lambda knots: mobius_loss(knots, 0.4, (u, (u + 1) % count))


def _curvature(knots: Tensor) -> Tensor:
    return squared_curvature(knots).sum()


def loss_cases() -> tuple[ValueCase, ...]:
    """The paper's losses and the product's region, in one order."""
    knot = torus_knot(2, 3, 40) / 3
    near = circle(24) * (1.0, 0.1, 1.0) + 0.01 * torus_knot(2, 3, 24)
    doubled, spiked = knot.copy(), knot.copy()
    doubled[5] = doubled[4]
    spiked[7] = spiked[5]  # there and back: a cusp of half a turn at 6
    crossed = knot.copy()
    crossed[20] = crossed[3]
    straight = np.zeros((12, 3))
    straight[:, 0] = np.minimum(np.arange(12), 12 - np.arange(12)) / 3
    point = np.zeros((6, 3)) + 0.7
    edge = knot.copy()
    edge[0] = (0.5, 0.0, 0.0)
    bars = box((-0.9, -0.9, -0.3), (0.9, 0.9, 0.3))
    mesh_box = Region(kind="cylinder", size_mm=(1.5, 0.5, 1.5))
    return (
        ValueCase(
            "length",
            "none: what the others are held against",
            _knots(knot),
            lambda k: knot_lengths(k).sum(),
        ),
        ValueCase(
            "length of a point",
            "length 0: no direction",
            _knots(point),
            lambda k: knot_lengths(k).sum(),
            False,
        ),
        ValueCase(
            "length at its budget",
            "the hinge's corner",
            _knots(knot),
            lambda k: length_loss(k, float(knot_lengths(torch.as_tensor(knot)[None]).sum())),
            False,
        ),
        ValueCase("Moebius", "strands within two radii", _knots(near), _mobius(24)),
        ValueCase(
            "Moebius, coincident points",
            "d = 0 far along the knot: 1/d^2",
            _knots(crossed),
            _mobius(40),
            False,
        ),
        ValueCase(
            "Moebius, u next to v",
            "1/d^2 - 1/g^2 of neighbours: all digits cancel",
            _knots(circle(40)),
            _neighbours(40),
            False,
        ),
        ValueCase(
            "Moebius of a point",
            "every distance and every way is 0",
            _knots(point),
            _mobius(6),
            False,
        ),
        ValueCase("curvature", "none", _knots(knot), _curvature),
        ValueCase(
            "curvature at a cusp", "half a turn: the sine is 0", _knots(spiked), _curvature, False
        ),
        ValueCase("curvature of a line", "no turn: acos at 1", _knots(straight), _curvature, False),
        ValueCase(
            "curvature, doubled point",
            "an edge without direction",
            _knots(doubled),
            _curvature,
            False,
        ),
        ValueCase(
            "curvature, tiny",
            "edges of 1e-20: products underflow",
            _knots(1e-12 * knot),
            lambda k: 1e-24 * _curvature(k),
        ),
        ValueCase(
            "bending at its limit",
            "the hinge's corner on a circle",
            _knots(circle(40)),
            lambda k: bending_loss(k, float((2 * pi / 40 / (2 * np.sin(pi / 40))) ** 2)),
            False,
        ),
        ValueCase(
            "occupancy, box",
            "points in and out, edges and corners",
            _knots(1.3 * knot),
            lambda k: occupancy_loss(k, 0.2, bars),
        ),
        ValueCase(
            "occupancy, on the boundary",
            "a point exactly on the ball's surface",
            _knots(edge),
            lambda k: occupancy_loss(k, 0.2, ball((0.0, 0.0, 0.0), 0.5)),
            True,
        ),
        ValueCase(
            "occupancy, in the middle",
            "the ball's own middle has no direction",
            _knots(point),
            lambda k: occupancy_loss(k, 2.0, ball((0.7, 0.7, 0.7), 0.5)),
            False,
        ),
        ValueCase(
            "region, on the axis",
            "a cylinder's axis has no direction",
            (torch.tensor([[0.0, 0.6, 0.0], [0.9, 0.1, 0.0]], dtype=torch.float64),),
            lambda p: outside(p, mesh_box, 0.1).clamp_min(0).square().sum(),
        ),
    )


def _network(
    name: str,
    why: str,
    depth: int,
    log_scale: float,
    weight: float,
    far: float = 1.0,
    back: bool = False,
    smooth: bool = True,
) -> ValueCase:
    """A weighted sum of where the network takes (or brings back) seven points, of points and weights."""
    network = CouplingNetwork(depth, 6, 3, log_scale=log_scale)
    generator = torch.Generator().manual_seed(4)

    def noise(like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=generator, dtype=torch.float64)

    names, weights = zip(*network.named_parameters(), strict=True)
    moved = tuple((w.detach() + weight * noise(w)) for w in weights)
    points = far * noise(torch.zeros(7, 3))
    share = noise(points)

    kinds = {}
    for dtype in (torch.float64, torch.float32):
        kinds[dtype] = CouplingNetwork(depth, 6, 3, log_scale=log_scale, dtype=dtype)
        if back:
            kinds[dtype].forward = kinds[dtype].inverse  # type: ignore[method-assign]

    def f(p: Tensor, *given: Tensor) -> Tensor:
        fixed = dict(zip(names, given, strict=True))
        found: Tensor = functional_call(kinds[p.dtype], fixed, (p,), tie_weights=False)
        return (found * share.to(p.dtype)).sum()

    return ValueCase(name, why, (points, *moved), f, smooth)


def network_cases() -> tuple[ValueCase, ...]:
    """The invertible network and its rotation, in one order."""
    shares = torch.arange(9.0, dtype=torch.float64).reshape(3, 3)

    def turned(turn: Tensor) -> Tensor:
        return (rotation(turn) * shares.to(turn.dtype)).sum()

    def turn(*t: float) -> tuple[Tensor]:
        return (torch.tensor(t, dtype=torch.float64),)

    return (
        _network("8 layers", "none: what the others are held against", 8, 1.0, 0.1),
        _network("scale near 0", "each layer shrinks by up to e^-6", 3, 6.0, 2.0, smooth=False),
        _network(
            "inverse of scale near 0",
            "each layer grows by up to e^6",
            3,
            6.0,
            2.0,
            back=True,
            smooth=False,
        ),
        _network("64 layers", "roundings and slopes add up", 64, 0.05, 0.02),
        _network("64 layers back", "the inverse, through all of them", 64, 0.05, 0.02, back=True),
        _network(
            "weights of 1e3", "tanh is a step, shifts are thousands", 4, 1.0, 1e3, smooth=False
        ),
        _network("far away", "points at 1e6", 8, 0.1, 0.1, far=1e6),
        _network("back from far away", "the inverse at 1e6", 8, 0.1, 0.1, far=1e6, back=True),
        ValueCase(
            "rotation by pi",
            "the quaternion's real part vanishes",
            turn(1e18, -1e18, 1e18),
            turned,
            False,
        ),
        ValueCase("rotation near pi", "the same, off by 2e-8", turn(1e8, 2e7, -3e7), turned, False),
        ValueCase("rotation by 0", "no axis", turn(0.0, 0.0, 0.0), turned),
        ValueCase("rotation", "none", turn(0.3, -0.5, 0.9), turned),
    )
