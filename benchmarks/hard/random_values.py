"""Random hard cases of the losses and of the network, for the fuzz, and the network's way there and back."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import torch
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.torch_forms.network import Coupling, CouplingNetwork, Rigid
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
from .values import ValueCase, network_case, spill

KINDS = ("length", "budget", "Moebius", "curvature", "bending", "box", "ball", "region")


def random_polygons(rng: np.random.Generator) -> Array:
    """[knots, n, 3] closed polygons: smooth or not, with points that coincide, cusps and straight runs."""
    knots, n = int(rng.integers(1, 3)), int(rng.integers(3, 40))
    turn = 2 * np.pi * np.arange(n)[:, None] / n
    p = np.zeros((knots, n, 3))
    for knot in p:
        for k in range(1, 4):
            knot += np.cos(k * turn + rng.uniform(0, 7, 3)) * rng.normal(size=3) / k
    p += rng.choice([0.0, 0.0, 1e-6, 0.3]) * rng.normal(size=p.shape)
    for _ in range(int(rng.integers(0, 4))):
        knot, i = p[rng.integers(knots)], int(rng.integers(n))
        kind = rng.integers(5)
        if kind == 0:  # doubled
            knot[i] = knot[i - 1]
        elif kind == 1:  # coincident far along the knot, or on the other knot
            knot[i] = p[rng.integers(knots), rng.integers(n)]
        elif kind == 2:  # there and back
            knot[i] = knot[i - 2]
        elif kind == 3:  # a straight run
            run = np.arange(i, i + min(6, n - 1)) % n
            knot[run] = np.linspace(knot[run[0]], knot[run[-1]], len(run))
        else:  # all in one place
            knot[:] = knot[i]
    return p


def random_loss(rng: np.random.Generator) -> ValueCase:
    """One of the losses of random polygons at a random scale, its limit near or far."""
    kind = KINDS[int(rng.integers(len(KINDS)))]
    scale = 10.0 ** float(rng.integers(-6, 7))
    points = random_polygons(rng) * scale + scale * rng.choice([0.0, 0.0, 3.0]) * rng.normal(size=3)
    size = float(10.0 ** rng.uniform(-2, 1) * scale)
    knots = torch.as_tensor(points)
    near = float(rng.choice([1.0, 0.5, 2.0]))
    whole = float(knot_lengths(knots).sum()) * near
    sharpest = near * float(squared_curvature(knots).median())
    count = knots.shape[0] * knots.shape[1]
    u, v = (torch.as_tensor(k) for k in rng.integers(0, count, (2, 60)))
    pairs = u[u != v], v[u != v]
    low, high = np.sort(rng.normal(size=(2, 3)) * scale, axis=0)
    middle = points[0, int(rng.integers(points.shape[1]))]
    shape = str(rng.choice(["box", "cylinder", "sphere"]))
    extents = tuple(float(x) for x in 3 * size * rng.uniform(0.5, 1.5, 3))
    # smaller than a scene may ask for: the term itself must bear it
    region = SettledRegion.model_construct(
        kind=shape, size_mm=extents, center_mm=tuple(middle.tolist())
    )

    def f(k: Tensor) -> Tensor:
        if kind == "length":
            return knot_lengths(k).sum()
        if kind == "budget":
            return length_loss(k, whole)
        if kind == "Moebius":
            return mobius_loss(k, size, pairs)
        if kind == "curvature":
            return squared_curvature(k).sum()
        if kind == "bending":
            return bending_loss(k, sharpest)
        if kind == "box":
            return occupancy_loss(k, size, box(tuple(low.tolist()), tuple(high.tolist())))
        if kind == "ball":
            return occupancy_loss(k, size, ball(tuple(middle.tolist()), size))
        return spill(k.reshape(-1, 3), region, size)

    return ValueCase(kind, "random polygons", (knots,), f, smooth=False)


def random_network(rng: np.random.Generator) -> tuple[CouplingNetwork, ValueCase]:
    """A network of random weights, scales from near 0 to huge, and its value at random points."""
    depth = int(rng.integers(1, 17))
    case, network = network_case(
        "random",
        "random weights",
        depth,
        log_scale=float(10.0 ** rng.uniform(-2, np.log10(min(6.0, 30.0 / depth)))),
        weight=float(10.0 ** rng.uniform(-3, 2)),
        far=float(10.0 ** rng.uniform(-3, 6)),
        back=bool(rng.integers(2)),
        seed=int(rng.integers(2**31)),
    )
    return network, case


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
