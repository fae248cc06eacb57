"""How far the renderers are off on a hard case: against doubles, 50 digits and finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from knotfab.render.capsules import BEHIND, capsule_distance, cut_before_light
from knotfab.render.device import render as render_compiled
from knotfab.render.device import render_torch
from knotfab.render.silhouette import NEAREST_RADII

from .pictures import signed_distance_px
from .rendering import RenderCase, frame_at

EPSILONS = 16.0  # how many machine epsilons times the condition number an error may be
SINGLE, DOUBLE = (float(torch.finfo(kind).eps) for kind in (torch.float32, torch.float64))
_CUTOFF = 40.0

Render = Callable[..., Tensor]
FORMS: dict[str, Render] = {"torch": render_torch, "compiled": render_compiled}


@dataclass(frozen=True)
class Distances:
    """Signed distance (px, positive inside) to the whole silhouette at each pixel, [P], and who gives it."""

    s: Tensor  # [P]
    winner: Tensor  # [P]


@dataclass(frozen=True)
class ForwardError:
    """Largest error (px) of single precision, its condition number (px), and the worst share of the bound."""

    error_px: float
    condition_px: float
    share: float
    image_share: float  # the same of the tiled image, in units of its own bound
    finite: bool


@dataclass(frozen=True)
class GradientError:
    """Relative errors: double precision against central differences, single against double."""

    double: float
    single: float
    finite: bool


def _ends(case: RenderCase, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    p = torch.as_tensor(case.points).to(dtype)
    e = torch.as_tensor(case.edges)
    return p[e[:, 0]], p[e[:, 1]]


def _rays(
    case: RenderCase, dtype: torch.dtype, pixels: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    frame = frame_at(case, dtype)
    pixel = torch.arange(case.width * case.height) if pixels is None else pixels
    u, v = pixel % case.width, pixel // case.width
    return (u.to(dtype) + frame.u0) * frame.step, (v.to(dtype) + frame.v0) * frame.step


def distances(case: RenderCase, dtype: torch.dtype, pixels: Tensor | None = None) -> Distances:
    """Return every pixel, or those of these flat indices, against every capsule in this precision."""
    frame = frame_at(case, dtype)
    starts, ends = _ends(case, dtype)
    a, b, seen = cut_before_light(frame.local(starts), frame.local(ends), case.radius)
    qx, qy = _rays(case, dtype, pixels)
    at_once = max(1, 400_000 // len(a))
    found, who = [], []
    for x, y in zip(torch.split(qx, at_once), torch.split(qy, at_once), strict=True):
        s = capsule_distance(a, b, x[:, None], y[:, None], case.radius, frame.focal_px)
        best = torch.where(seen, s, BEHIND).max(1)
        found.append(best.values)
        who.append(best.indices)
    return Distances(torch.cat(found), torch.cat(who))


def _condition(
    case: RenderCase, winner: Tensor, pixels: Tensor | None = None, epsilon: float = SINGLE
) -> Tensor:
    """Return [P] sum over all inputs of |ds/dx| |x|, px: what one relative rounding of each can do.

    The largest of the place itself and two places within single precision of it, since a singular place
    has no gradient that would tell. Nor has one near a kink: the strand's nearest point, clamped to its ends,
    may be at the other end within the roundings that are allowed, and the depth there is another.
    """
    frame = frame_at(case, torch.float64)
    starts, ends = _ends(case, torch.float64)
    one, two = starts[winner], ends[winner]
    qx, qy = _rays(case, torch.float64, pixels)
    generator = torch.Generator().manual_seed(1)
    worst = torch.zeros(len(winner), dtype=torch.float64)
    for jitter in (0.0, 1e-7, 1e-7):
        inputs = [
            (x + jitter * x.abs() * torch.randn(x.shape, generator=generator, dtype=x.dtype))
            for x in (one, two, qx, qy, torch.full_like(qx, case.radius))
        ]
        inputs = [x.detach().requires_grad_() for x in inputs]
        p, q, x, y, r = inputs
        a, b, seen = cut_before_light(frame.local(p), frame.local(q), case.radius)
        s = torch.where(seen, capsule_distance(a, b, x, y, r, frame.focal_px), 0.0)
        total = s.detach().abs() + _rounded(s, inputs, frame.eye)
        t = _nearest(a, b, x, y)
        slack = EPSILONS * epsilon * _rounded(t, [p, q, x, y], frame.eye)
        free = (t + slack).clamp(0, 1) - (t - slack).clamp(0, 1)
        deeper = (b - a)[:, 2].abs() / torch.minimum(a[:, 2], b[:, 2])
        total = total + (s.abs() * deeper * free).detach() / (EPSILONS * epsilon)
        worst = torch.maximum(worst, total)
    return worst


def _rounded(value: Tensor, inputs: list[Tensor], eye: Tensor) -> Tensor:
    """Sum |dv/dx| |x| over inputs, [P]; the first two are a strand's ends, which are less the eye and less
    each other before they are anything else."""
    edge = (inputs[1] - inputs[0]).detach().abs()
    total = torch.zeros_like(value).detach()
    slopes = torch.autograd.grad(value.sum(), inputs, retain_graph=True)
    for x, slope in zip(inputs, slopes, strict=True):
        size = x.detach().abs()
        if x.ndim == 2:
            size = size + eye.abs() + (x.detach() - eye).abs() + edge
        total = total + (slope.abs() * size).reshape(len(total), -1).sum(1)
    return total


def _nearest(a: Tensor, b: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Return [P] where along a-b, 0 to 1 and beyond, the line of the ray (x, y, 1) comes nearest."""
    d = torch.stack([x, y, torch.ones_like(x)], -1)
    across, way = (p - ((p * d).sum(-1) / (d * d).sum(-1))[:, None] * d for p in (a, b - a))
    return -(across * way).sum(-1) / (way * way).sum(-1).clamp_min(1e-300)


def condition(case: RenderCase) -> Tensor:
    """Return [P] the condition number of each pixel's distance, px, for the winners of both precisions."""
    kinds = [distances(case, dtype).winner for dtype in (torch.float64, torch.float32)]
    return torch.maximum(*(_condition(case, kind) for kind in kinds))


def image(case: RenderCase, dtype: torch.dtype, render: Render = render_torch) -> Tensor:
    """Return [height, width] by one form of the tiled renderer."""
    starts, ends = _ends(case, dtype)
    return render(starts, ends, frame_at(case, dtype), case.radius, case.tau, _CUTOFF)


def forward_error(case: RenderCase, render: Render = render_torch) -> ForwardError:
    """Return single against double precision: the distances of all pixels, and the tiled image."""
    exact, rough = distances(case, torch.float64), distances(case, torch.float32)
    kappa = torch.maximum(_condition(case, exact.winner), _condition(case, rough.winner))
    shown = exact.s > 0.5 * BEHIND
    same = bool(((rough.s > 0.5 * BEHIND) == shown).all())
    away = torch.where(shown, (rough.s.double() - exact.s).abs(), 0.0)
    bound = EPSILONS * SINGLE * kappa.clamp_min(1e-300)
    share = away / bound
    worst = int(share.argmax())
    wanted = torch.sigmoid(case.tau * exact.s).reshape(case.height, case.width)
    single, double = (image(case, t, render) for t in (torch.float32, torch.float64))
    # the sigmoid's slope is at most a quarter; its own rounding and what the cut-off leaves out
    allowed = (0.25 * case.tau * bound + 4 * SINGLE).reshape(wanted.shape)
    image_share = ((single.double() - wanted).abs() / allowed).max()
    finite = all(bool(x.isfinite().all()) for x in (exact.s, rough.s, single, double))
    agree = bool((double - wanted).abs().max() <= 1e-9)
    return ForwardError(
        float(away.max()),
        float(kappa[worst]),
        float(share.max()),
        float(image_share),
        finite and same and agree,
    )


def sampled_error(
    case: RenderCase, count: int = 2000, render: Render = render_torch
) -> tuple[float, float]:
    """Sample an image too large for every pixel against every capsule: `count` pixels anywhere and on edges.

    Returns the largest error of the tiled single precision image in px (at the slope of an edge), and
    the largest share of its bound, as in `ForwardError.image_share`. Infinite where a pixel or the
    gradient is not finite.
    """
    starts, ends = _ends(case, torch.float32)
    starts = starts.requires_grad_()
    frame = frame_at(case, torch.float32)
    shown = render(starts, ends, frame, case.radius, case.tau, _CUTOFF).flatten()
    (gradient,) = torch.autograd.grad(shown.sum(), starts)
    shown = shown.detach()
    if not bool(gradient.isfinite().all() and shown.isfinite().all()):
        return np.inf, np.inf
    generator = torch.Generator().manual_seed(5)
    edge = ((shown > 0.01) & (shown < 0.99)).nonzero()[:, 0]
    picked = (torch.randint(n, (count,), generator=generator) for n in (len(shown), len(edge)))
    anywhere, on_edge = picked
    pixels = torch.cat([anywhere, edge[on_edge]])
    exact = distances(case, torch.float64, pixels)
    bound = EPSILONS * SINGLE * _condition(case, exact.winner, pixels)
    away = (shown[pixels].double() - torch.sigmoid(case.tau * exact.s)).abs()
    slope = 0.25 * case.tau
    return float(away.max()) / slope, float((away / (slope * bound + 4 * SINGLE)).max())


def double_error(case: RenderCase, count: int = 5) -> float:
    """Measure the largest error of double precision against 50 digits, in 16 epsilons times condition."""
    exact = distances(case, torch.float64)
    kappa = _condition(case, exact.winner, epsilon=DOUBLE)
    frame = frame_at(case, torch.float64)
    qx, qy = _rays(case, torch.float64)
    order = exact.s.abs().argsort()[: 4 * count : 4]
    special = [v * case.width + u for u, v in case.kinks]
    p = case.points - np.array(case.eye)
    worst = 0.0
    for k in [*order.tolist(), *special]:
        i, j = case.edges[int(exact.winner[k])]
        true = signed_distance_px(
            p[i].tolist(), p[j].tolist(), (float(qx[k]), float(qy[k])), case.radius, frame.focal_px
        )
        found = float(exact.s[k])
        if true is None:
            worst = max(worst, 0.0 if found <= 0.5 * BEHIND else np.inf)
            continue
        allowed = EPSILONS * DOUBLE * max(float(kappa[k]), 1e-300)
        worst = max(worst, abs(found - float(true)) / allowed)
    return worst


def gradient_condition(case: RenderCase) -> float:
    """Measure how much the gradient changes, relative, when each input is off by a rounding of single
    precision."""
    points = torch.as_tensor(case.points)
    g = _gradient(lambda p: _loss(case, p, torch.float64), points)
    moved = _gradient(lambda p: _loss(case, p, torch.float64), points.float().double() * (1 + 1e-7))
    size = max(float(g.norm()), 1e-30)
    return max(float(((moved - g) * v).sum().abs()) for v in _ways(points, 4)) / size


def _loss(
    case: RenderCase, points: Tensor, dtype: torch.dtype, render: Render = render_torch
) -> Tensor:
    """Return a weighted sum of the image's pixels; the weights are fixed."""
    e = torch.as_tensor(case.edges)
    shown = render(
        points[e[:, 0]], points[e[:, 1]], frame_at(case, dtype), case.radius, case.tau, _CUTOFF
    )
    generator = torch.Generator().manual_seed(2)
    weight = torch.rand(shown.shape, generator=generator, dtype=torch.float64).to(dtype)
    return (weight * shown).sum()


def _gradient(f: Callable[[Tensor], Tensor], points: Tensor) -> Tensor:
    at = points.detach().clone().requires_grad_()
    (gradient,) = torch.autograd.grad(f(at), at, allow_unused=True)
    return torch.zeros_like(points) if gradient is None else gradient


def _pixel_mm(case: RenderCase) -> float:
    """Return one pixel at the depth of the nearest point that is seen."""
    depth = case.points[:, 2] - case.eye[2]
    least = max(NEAREST_RADII * case.radius, 1e-9)
    return case.step * float(np.clip(depth, least, None).min())


def _ways(points: Tensor, count: int) -> list[Tensor]:
    """Return smooth random motions of the points, each of order 1: waves in the points' order."""
    generator = torch.Generator().manual_seed(3)
    turn = torch.linspace(0, 2 * np.pi, len(points) + 1, dtype=torch.float64)[:-1, None]
    found = []
    for _ in range(count):
        v = torch.zeros_like(points)
        for k in range(4):
            size, phase = torch.rand(2, 3, generator=generator, dtype=torch.float64)
            v = v + size * torch.cos(k * turn + 2 * np.pi * phase)
        found.append(v)
    return found


def gradient_error(case: RenderCase, ways: int = 3, render: Render = render_torch) -> GradientError:
    """Measure a fixed weighted sum of the image, along `ways` smooth random motions of the points."""
    points = torch.as_tensor(case.points)
    g = _gradient(lambda p: _loss(case, p, torch.float64, render), points)
    single = _gradient(lambda p: _loss(case, p, torch.float32, render), points.float())
    pixel = _pixel_mm(case)
    least = 1e-4 / max(case.tau, 1.0) * pixel
    double_off, single_off = 0.0, 0.0
    for v in _ways(points, ways):
        # the step that suits: rounding spoils a small one, curvature a large one
        slopes = []
        for h in (least, 10 * least):
            ahead, behind = (
                float(_loss(case, points + k * h * v, torch.float64, render)) for k in (1, -1)
            )
            slopes.append((ahead - behind) / (2 * h))
        along = float((g * v).sum())
        # below a thousandth of the slope of one pixel's edge, the sigmoid's rounding is all there is
        scale = max(abs(along), 0.1 * float(g.norm()), 1e-3 * 0.25 * case.tau / pixel)
        double_off = max(double_off, min(abs(slope - along) for slope in slopes) / scale)
        single_off = max(single_off, abs(float((single.double() * v).sum()) - along) / scale)
    finite = bool(g.isfinite().all() and single.isfinite().all())
    return GradientError(double_off, single_off, finite)


def subgradient_excess(
    case: RenderCase, dtype: torch.dtype, directions: int = 6, render: Render = render_torch
) -> float:
    """Return at the case's kinks: how far the gradient leaves what the one-sided slopes allow, relative.

    A subgradient's slope along v lies between f'(x; v) and -f'(x; -v).
    """
    points = torch.as_tensor(case.points)
    generator = torch.Generator().manual_seed(4)
    h = 1e-6 * _pixel_mm(case)
    worst = 0.0
    for pixel in case.kinks:

        def value(p: Tensor, pixel: tuple[int, int] = pixel) -> Tensor:
            e = torch.as_tensor(case.edges)
            frame = frame_at(case, p.dtype, pixel)
            return render(p[e[:, 0]], p[e[:, 1]], frame, case.radius, case.tau).sum()

        g = _gradient(value, points.to(dtype)).double()
        worst = worst if bool(g.isfinite().all()) else np.inf
        here = float(value(points))
        for _ in range(directions):
            v = torch.randn(points.shape, generator=generator, dtype=torch.float64)
            right = (float(value(points + h * v)) - here) / h
            left = (here - float(value(points - h * v))) / h
            low, high = min(left, right), max(left, right)
            along = float((g * v).sum())
            excess = max(low - along, along - high, 0.0)
            # a slope below a thousandth of a hard edge's counts as nothing
            worst = max(worst, excess / max(abs(low), abs(high), 1e-3 * case.tau / _pixel_mm(case)))
    return worst
