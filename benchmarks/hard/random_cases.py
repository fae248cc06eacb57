"""Random hard cases of each kind: a generator that draws a case and says what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from scipy import ndimage

from benchmarks.hard.curves import hard_knots
from benchmarks.hard.isotopy import fuzz
from benchmarks.hard.measure import forward_error, image
from benchmarks.hard.random_values import random_loss, random_network, round_trip_share
from benchmarks.hard.rendering import RenderCase, frame_at
from benchmarks.hard.value_error import value_error
from knotfab.geometry.tube import mesh_volume, sweep
from knotfab.picture.silhouette import trace_polygon
from knotfab.start.filling import fill
from knotfab.torch_forms.dense import render_dense


def _capsules(rng: np.random.Generator) -> str:
    """Capsules anywhere, before and behind the light, at any scale: "" or what is wrong."""
    n, scale = int(rng.integers(1, 12)), 10.0 ** rng.integers(-6, 7)
    p = rng.normal(size=(2 * n, 3)) * (12, 10, 150) + (0, 0, rng.choice([0, 100, 500]))
    doubled = rng.random(2 * n) < 0.2
    p[doubled] = p[0]
    case = RenderCase(
        "random",
        "",
        p * scale,
        np.arange(2 * n).reshape(-1, 2),
        radius=float(10.0 ** rng.uniform(-6, 1.5) * scale),
        tau=float(10.0 ** rng.uniform(-1, 6)),
        width=int(rng.integers(1, 40)),
        height=int(rng.integers(1, 40)),
        step=2.0 ** -float(rng.integers(6, 11)),
    )
    found = forward_error(case)
    if not found.finite:
        return "not finite, or tiled and dense differ"
    if max(found.share, found.image_share) > 1:
        return f"error {found.share:.2g} and {found.image_share:.2g} of its bound"
    at = torch.as_tensor(case.points, dtype=torch.float32).requires_grad_()
    e = torch.as_tensor(case.edges)
    frame = frame_at(case, torch.float32)
    dense = render_dense(at[e[:, 0]], at[e[:, 1]], frame, case.radius, case.tau)
    (gradient,) = torch.autograd.grad(dense.sum(), at)
    whole = bool(gradient.isfinite().all()) and bool(image(case, torch.float32).isfinite().all())
    return "" if whole else "the gradient is not finite"


def _picture(rng: np.random.Generator) -> str:
    """Blurred noise, from specks to blobs, filled by a tube of any thickness."""
    noise = ndimage.gaussian_filter(rng.normal(size=(160, 200)), float(rng.uniform(0, 12)))
    mask = noise > np.quantile(noise, rng.uniform(0.2, 0.95))
    polygon = trace_polygon(mask)
    if not polygon.is_valid:
        return "the outline is not valid"
    if polygon.is_empty:
        return ""
    template = fill(polygon, float(10.0 ** rng.uniform(0.4, 1.8)))
    whole = all(np.isfinite(c).all() and len(c) >= 3 for c in template.curves)
    return "" if whole else "the template is not finite"


def _steps(rng: np.random.Generator) -> str:
    """A hundred adversarial steps on one of the hard knots."""
    cases = hard_knots()
    found = fuzz(cases[int(rng.integers(len(cases)))], 100, int(rng.integers(2**31)))
    return f"{found.faults} crossings accepted" if found.faults or found.changed else ""


def _tube(rng: np.random.Generator) -> str:
    """A random closed curve, at a share of its own bending limit."""
    count = int(rng.integers(12, 400))
    s = 2 * np.pi * np.arange(count) / count
    points = np.zeros((count, 3))
    for k in range(1, 5):
        points += np.cos(k * s[:, None] + rng.uniform(0, 7, 3)) * rng.normal(size=3) * 20 / k
    edges = np.roll(points, -1, 0) - points
    length = np.linalg.norm(edges, axis=1)
    cosine = (edges * np.roll(edges, 1, 0)).sum(1) / (length * np.roll(length, 1))
    tangent = np.sqrt((1 - cosine).clip(0) / (1 + cosine).clip(1e-12))
    bend = float((np.minimum(length, np.roll(length, 1)) / (2 * tangent).clip(1e-12)).min())
    radius = min(bend, 50.0) * float(rng.uniform(0.5, 1.05))
    sides = int(rng.integers(3, 65))
    vertices, faces = sweep(points, radius, sides)  # may refuse, with a sentence
    wanted = np.pi * radius**2 * length.sum()
    if not np.isfinite(vertices).all():
        return "the tube is not finite"
    off = abs(mesh_volume(vertices, faces) / wanted - 1)
    # 3 sides are only as exact as their facets, which cut inside where two rings are turned
    return "" if off < (5e-3 if sides == 3 else 1e-3) else f"the volume is off by {off:.2g}"


def _losses(rng: np.random.Generator) -> str:
    """A loss of random polygons with points that coincide, at any scale."""
    case = random_loss(rng)
    found = value_error(case)
    if not found.finite:
        return f"{case.name}: not finite"
    return "" if found.share <= 1 else f"{case.name}: {found.share:.2g} of its bound"


def _network(rng: np.random.Generator) -> str:
    """A network of random weights: its value, and its way there and back."""
    network, case = random_network(rng)
    found = value_error(replace(case, smooth=False))
    if not found.finite:
        return "not finite"
    shares = (found.share, *round_trip_share(network, case.inputs[0]))
    told = ", ".join(f"{share:.2g}" for share in shares)
    return "" if max(shares) <= 1 else f"{told} of the bound (value, there and back)"


KINDS: dict[str, Callable[[np.random.Generator], str]] = {
    "capsules": _capsules,
    "picture": _picture,
    "steps": _steps,
    "tube": _tube,
    "losses": _losses,
    "network": _network,
}
