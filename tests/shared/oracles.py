"""Slow, plain truth: gradients against central differences, and every pixel against every capsule."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Felt, State
from knotfab.render.capsules import BEHIND, capsule_distance, cut_before_light
from knotfab.render.silhouette import Frame


def state_at(points: Array, reach: float = 12.0) -> State:
    """The state of one closed polyline with vertices (N, 3), whose neighbours lie within `reach` mm."""
    rings = polylines_of_sizes((len(points),))
    return State.at(points, rings, find_neighbours(points, rings, reach, 6))


def assert_slope(
    call: Callable[[Array], Felt], points: Array, rel: float = 1e-5, step: float = 1e-6
) -> None:
    """That the gradient (n, 3) of `call` is what its number changes by, along five random ways."""
    draw = np.random.default_rng(4)
    _, slope = call(points)
    assert slope.shape == points.shape
    for _ in range(5):
        way = draw.normal(size=points.shape)
        change = (call(points + step * way)[0] - call(points - step * way)[0]) / (2 * step)
        size = float(np.linalg.norm(slope) * np.linalg.norm(way))
        assert float((slope * way).sum()) == pytest.approx(change, rel=rel, abs=1e-7 * size)


def render_dense(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    tau: float,
    chunk_pixels: int = 4096,
) -> Tensor:
    """Image [height, width] of sigmoid(tau * max over capsules of the signed distance in px).

    Paper, sec. 3.3 (occupancy, max over primitives), with the ray-distance silhouette.
    """
    a, b, seen = cut_before_light(frame.local(starts), frame.local(ends), radius)
    count = frame.width * frame.height
    index = torch.arange(count, device=a.device)
    image = []
    for first in range(0, count, chunk_pixels):
        pixels = index[first : first + chunk_pixels]
        qx = ((pixels % frame.width).to(a.dtype) + frame.u0) * frame.step
        qy = ((pixels // frame.width).to(a.dtype) + frame.v0) * frame.step
        s = capsule_distance(a[None], b[None], qx[:, None], qy[:, None], radius, frame.focal_px)
        s = torch.where(seen, s, BEHIND)
        image.append(torch.sigmoid(tau * s.max(dim=1).values.clamp_min(BEHIND)))
    return torch.cat(image).reshape(frame.height, frame.width)
