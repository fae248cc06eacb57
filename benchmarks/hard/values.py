"""Hard cases of the losses and of the network: scalar functions of tensors, each with why it is hard."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from math import pi

import numpy as np
import torch
from torch import Tensor
from torch.func import functional_call

from knotfab.apps.paper.network_search import Coupling, CouplingNetwork, Rigid, rotation
from knotfab.base.arrays import Array
from knotfab.limits.region import region_excess
from knotfab.render.device import known
from knotfab_formats.scene import SettledRegion
from paper.losses import (
    ball,
    bending_loss,
    box,
    knot_lengths,
    length_loss,
    mobius_loss,
    occupancy_loss,
    squared_curvature,
)

from .measure import EPSILONS
from .pictures import circle, torus_knot

Function = Callable[..., Tensor]


@dataclass(frozen=True)
class ValueCase:
    """`f` of `inputs` (float64), a scalar. The first input's rows are points.

    `smooth`: differentiable there. `jumps`: the value itself jumps there, so that it has no slopes.
    `move`: of a network, where it takes points [..., 3] of order `size`. `oracle`: the definition, in numpy,
    of what is only ever worked out in double precision; its points are of a longer one.
    """

    name: str
    why: str
    inputs: tuple[Tensor, ...]
    f: Function
    smooth: bool = True
    jumps: bool = False
    move: Callable[[Tensor], Tensor] | None = None
    size: float = 1.0
    oracle: Callable[[Array], float] | None = None


def _knots(points: np.ndarray) -> tuple[Tensor]:
    return (torch.as_tensor(points)[None],)


def _mobius(count: int) -> Function:
    u, v = torch.triu_indices(count, count, 1)
    return lambda knots: mobius_loss(knots, 0.4, (u, v))


def _neighbours(count: int) -> Function:
    u = torch.arange(count)
    return lambda knots: mobius_loss(knots, 0.4, (u, (u + 1) % count))


def spill(points: Tensor, region: SettledRegion, radius: float, power: int = 1) -> Tensor:
    """Measure how far balls about points [n, 3] stick out of a region, summed, or the squares of that."""
    excess, away = region_excess(points.detach().numpy(), region, radius)
    over = np.maximum(excess, 0.0)
    slope = np.where(over > 0, power * over ** (power - 1), 0.0)
    return known(float((over**power).sum()), (points, slope[:, None] * away))


def _curvature(knots: Tensor) -> Tensor:
    return squared_curvature(knots).sum()


def loss_cases() -> tuple[ValueCase, ...]:
    """Return the paper's losses and the product's region, in one order."""
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
    pipe = SettledRegion(kind="cylinder", size_mm=(1.5, 4.0, 1.5))
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
            "an edge without direction: moved apart, its ends turn by any angle",
            _knots(doubled),
            _curvature,
            False,
            jumps=True,
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
            lambda p: spill(p, pipe, 0.9, 2),
            False,
        ),
    )


def network_case(
    name: str,
    why: str,
    depth: int,
    log_scale: float,
    weight: float,
    far: float = 1.0,
    back: bool = False,
    seed: int = 4,
) -> tuple[ValueCase, CouplingNetwork]:
    """Return a weighted sum of where a network takes (or brings back) seven points, of points and weights.

    And the network itself, whose weights are those of a new one plus normal noise times `weight`.
    """
    network = CouplingNetwork(depth, 6, 3, log_scale=log_scale)
    generator = torch.Generator().manual_seed(seed)

    def noise(like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=generator, dtype=torch.float64)

    names, weights = zip(*network.named_parameters(), strict=True)
    moved = tuple((w.detach() + weight * noise(w)) for w in weights)
    points = far * noise(torch.zeros(7, 3))
    share = noise(points)
    network.load_state_dict(dict(zip(names, moved, strict=True)), strict=False)

    kinds = {}
    for dtype in (torch.float64, torch.float32):
        kinds[dtype] = CouplingNetwork(depth, 6, 3, log_scale=log_scale, dtype=dtype)
        if back:
            kinds[dtype].forward = kinds[dtype].inverse  # type: ignore[method-assign]

    def f(p: Tensor, *given: Tensor) -> Tensor:
        fixed = dict(zip(names, given, strict=True))
        found: Tensor = functional_call(kinds[p.dtype], fixed, (p,), tie_weights=False)
        return (found * share.to(p.dtype)).sum()

    move = network.inverse if back else network.forward
    return ValueCase(name, why, (points, *moved), f, move=move, size=far), network


def network_cases() -> tuple[ValueCase, ...]:
    """Return the invertible network and its rotation, in one order."""
    shares = torch.arange(9.0, dtype=torch.float64).reshape(3, 3)

    def turn_points(turn: Tensor) -> Tensor:
        return (rotation(turn) * shares.to(turn.dtype)).sum()

    def turning(name: str, why: str, *t: float) -> ValueCase:
        turn = torch.tensor(t, dtype=torch.float64)
        return ValueCase(name, why, (turn,), turn_points, move=lambda p: p @ rotation(turn).T)

    networks = (
        network_case("8 layers", "none: what the others are held against", 8, 1.0, 0.1),
        network_case("scale near 0", "each layer shrinks by up to e^-6", 3, 6.0, 2.0),
        network_case(
            "inverse of scale near 0", "each layer grows by up to e^6", 3, 6.0, 2.0, back=True
        ),
        network_case("24 layers", "roundings and slopes add up", 24, 0.1, 0.03),
        network_case(
            "24 layers back", "the inverse, through all of them", 24, 0.1, 0.03, back=True
        ),
        network_case("weights of 1e3", "tanh is a step, shifts are thousands", 4, 1.0, 1e3),
        network_case("far away", "points at 1e6", 8, 0.1, 0.1, far=1e6),
        network_case("back from far away", "the inverse at 1e6", 8, 0.1, 0.1, far=1e6, back=True),
    )
    return (
        *(case for case, _ in networks),
        turning("rotation by pi", "the quaternion's real part vanishes", 1e18, -1e18, 1e18),
        turning("rotation near pi", "the same, off by 2e-8", 1e8, 2e7, -3e7),
        turning("rotation by 0", "no axis", 0.0, 0.0, 0.0),
        turning("rotation", "none", 0.3, -0.5, 0.9),
    )


def round_trip_share(network: CouplingNetwork, points: Tensor) -> tuple[float, float]:
    """Measure how far inverse(forward(x)) is off in single and in double precision, as shares of the bound.

    `network` is in double precision. The bound is 16 machine epsilons times the condition number: the
    sum over all inputs, the weights on the way there and on the way back, and what each layer hands on,
    of |df/dx| |x|.
    """
    share = torch.randn(points.shape, generator=torch.Generator().manual_seed(6)).double()
    there, back = network, deepcopy(network)
    start = points.clone().requires_grad_()
    handed: list[Tensor] = []

    def nudge(p: Tensor) -> Tensor:
        handed.append(torch.zeros_like(p, requires_grad=True))
        return p * (1 + handed[-1])

    p = start
    for layer in there.layers:
        p = nudge(layer(p))
    for layer in reversed(back.layers):
        assert isinstance(layer, Rigid | Coupling)
        p = nudge(layer.inverse(p))
    inputs = [start, *there.parameters(), *back.parameters()]
    slopes = torch.autograd.grad((share * p).sum(), [*inputs, *handed])
    weights = [x.detach() for x in inputs] + [torch.ones_like(x) for x in handed]
    condition = sum(float((g * x).abs().sum()) for g, x in zip(slopes, weights, strict=True))
    found = []
    for dtype in (torch.float32, torch.float64):
        kind = deepcopy(network).to(dtype)
        with torch.no_grad():
            ended = kind.inverse(kind(points.to(dtype))).double()
            off = abs(float((share * (ended - points)).sum()))
        found.append(off / (EPSILONS * torch.finfo(dtype).eps * max(condition, 1e-300)))
    return found[0], found[1]
