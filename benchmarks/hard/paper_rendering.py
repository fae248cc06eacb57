"""The paper's two renderers on the same hard cases, and its closed forms as they are printed."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from knotfab.apps.paper.outlines import render_outlines, signed_distance
from paper.camera import PaperCamera

from .measure import EPSILONS
from .rendering import RenderCase


def applies(case: RenderCase) -> bool:
    """The paper's camera has no picture of one pixel across, and its tube has a radius."""
    return min(case.width, case.height) >= 2 and case.radius > 0


def _camera(case: RenderCase) -> PaperCamera:
    half = (0.5 * case.step * (case.width - 1), 0.5 * case.step * (case.height - 1))
    near = max(1.5 * case.radius, 1e-9)
    return PaperCamera(
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
