"""What lies at the light or behind it casts no shadow: segments are cut before they reach its plane."""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["NEAREST_RADII", "cut_before_light"]

NEAREST_RADII = (
    2.5  # centre lines nearer to the light's plane than this many tube radii are cut away
)
_LEAST_MM = 1e-9


def cut_before_light(
    a: Tensor,  # [n, 3] receiver axes, mm
    b: Tensor,  # [n, 3]
    radius: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """The parts of segments a-b deeper than `NEAREST_RADII` tube radii, and [n] which have any.

    A ray's line goes on behind the light, so without the cut a segment that crosses the light's plane
    would be hit there. What is not cut comes back to the last bit; what has no part left comes back as
    it was. Differentiable with respect to `a` and `b`.
    """
    least = max(NEAREST_RADII * radius, _LEAST_MM)
    near_a, near_b = a[:, 2] < least, b[:, 2] < least
    seen = ~(near_a & near_b)
    if not bool((near_a | near_b).any()):
        return a, b, seen
    change = b[:, 2] - a[:, 2]
    crossing = near_a ^ near_b
    t = (least - a[:, 2]) / torch.where(crossing, change, 1.0)
    at = a + t[:, None] * (b - a)
    at = torch.cat([at[:, :2], at[:, 2:].clamp_min(least)], 1)
    a_cut = torch.where((near_a & crossing)[:, None], at, a)
    b_cut = torch.where((near_b & crossing)[:, None], at, b)
    return a_cut, b_cut, seen
