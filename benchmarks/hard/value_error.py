"""How far a scalar function is off on a hard case: its precision, both gradients, one-sided slopes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .measure import EPSILONS
from .values import ValueCase


@dataclass(frozen=True)
class Found:
    """What is measured; `condition` is relative: sum |df/dx| |x| over |f|, with edges beside x (`_size`)."""

    condition: float
    error: float  # the error in its precision, over |f| (absolute where f is 0 but for rounding)
    share: float  # the error over 16 of its epsilons times condition
    double: float  # gradient against central differences, relative
    single: float  # single precision's gradient against it, relative
    finite: bool


def value_error(case: ValueCase) -> Found:
    """Return single against double precision, both gradients, all that must be finite.

    What is only ever worked out in double precision is held against its definition in a longer one.
    """
    value, slopes = _slopes(case, case.inputs)
    if case.oracle is None:
        rough, rough_slopes = _slopes(case, tuple(x.float() for x in case.inputs))
        epsilon = torch.finfo(torch.float32).eps
    else:
        exact = case.oracle(case.inputs[0].numpy().astype(np.longdouble))
        rough, rough_slopes = torch.tensor(float(exact), dtype=torch.float64), slopes
        epsilon = torch.finfo(torch.float64).eps
    finite = all(bool(x.isfinite().all()) for x in (value, rough, *slopes, *rough_slopes))
    generator = torch.Generator().manual_seed(1)
    sizes = [_size(x, edges=case.oracle is not None) for x in case.inputs]
    size = sum(float((s.abs() * x).sum()) for s, x in zip(slopes, sizes, strict=True))
    # a singular place has no gradient that would tell: look beside it
    for _ in range(0 if case.smooth else 2):
        near = tuple(
            x * (1 + 1e-7 * torch.randn(x.shape, generator=generator, dtype=x.dtype))
            for x in case.inputs
        )
        _, beside = _slopes(case, near)
        both = zip(beside, sizes, strict=True)
        size = max(size, sum(float((s.abs() * x).sum()) for s, x in both))
    here = float(value)
    total = abs(here) + size
    away = abs(float(rough) - here)
    # a value that is all rounding has no relative error
    scale = abs(here) if abs(here) > 1e-12 * size else 1.0
    share = away / max(EPSILONS * epsilon * total, 1e-300)
    off = sum(
        float((r.double() - s).square().sum()) for r, s in zip(rough_slopes, slopes, strict=True)
    )
    norm = max(sum(float(s.square().sum()) for s in slopes) ** 0.5, 1e-30)
    double = _against_differences(case, slopes) if case.smooth else 0.0
    return Found(total / scale, away / scale, share, double, off**0.5 / norm, finite)


def _size(x: Tensor, edges: bool) -> Tensor:
    """Return what is rounded of each coordinate: itself, and both ends' where edges are formed."""
    if not edges:
        return x.abs()
    edge = (x.roll(-1, 0) - x).abs()
    return x.abs() + edge + edge.roll(1, 0)


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
    """Return along random motions, by central differences of the fourth order."""
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
    high, low = (_along(case, ways, k * h) for k in (1, -1))
    return (high - low) / (2 * h)


@torch.no_grad()
def _along(case: ValueCase, ways: list[Tensor], h: float) -> float:
    return float(case.f(*(x + h * w for x, w in zip(case.inputs, ways, strict=True))))


def slope_excess(case: ValueCase, dtype: torch.dtype, step: float = 1e-6) -> float:
    """Measure how far the gradient leaves what the one-sided slopes allow, relative; 0 for a subgradient.

    A subgradient's slope along v lies between f'(x; v) and -f'(x; -v), whichever is larger. The
    directions: all points anywhere, and each point alone, anywhere and along its own gradient.
    """
    if case.oracle is not None:
        dtype = torch.float64  # there is no other
    _, found = _slopes(case, tuple(x.to(dtype) for x in case.inputs))
    slopes = [g.double() for g in found]
    generator = torch.Generator().manual_seed(4)
    here = float(case.f(*case.inputs))
    whole = sum(float(g.square().sum()) for g in slopes) ** 0.5
    worst = 0.0
    for ways in _directions(case, slopes, generator):
        ahead, behind = (_along(case, ways, k * step) for k in (1, -1))
        right, left = (ahead - here) / step, (here - behind) / step
        low, high = min(left, right), max(left, right)
        along = sum(float((g * w).sum()) for g, w in zip(slopes, ways, strict=True))
        length = sum(float(w.square().sum()) for w in ways) ** 0.5
        # a slope of a thousandth of the steepest is nothing
        scale = max(abs(low), abs(high), 1e-3 * whole * length, 1e-30)
        worst = max(worst, max(low - along, along - high, 0.0) / scale)
    return worst if np.isfinite(worst) else np.inf


def _directions(
    case: ValueCase, slopes: list[Tensor], generator: torch.Generator
) -> Iterator[list[Tensor]]:
    sizes = [float(x.abs().mean()) or 1.0 for x in case.inputs]

    def anywhere(like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=generator, dtype=like.dtype)

    for _ in range(4):
        yield [size * anywhere(x) for size, x in zip(sizes, case.inputs, strict=True)]
    still = [torch.zeros_like(x) for x in case.inputs[1:]]
    points = case.inputs[0]
    slope = slopes[0] / slopes[0].norm().clamp_min(1e-30)
    for row in range(points.numel() // points.shape[-1]):
        for way in (anywhere(points), slope):
            alone = torch.zeros_like(points).view(-1, points.shape[-1])
            alone[row] = way.reshape(alone.shape)[row]
            yield [sizes[0] * alone.reshape(points.shape), *still]
