"""Cut segments before they reach the light's plane: matter at the light or behind it casts no shadow."""

from __future__ import annotations

import torch
from torch import Tensor

from knotfab.render.silhouette import least_depth

__all__ = ["cut_before_light"]


def cut_before_light(
    a: Tensor,  # [n, 3] receiver axes, mm
    b: Tensor,  # [n, 3]
    radius: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """Keep of segments a-b what is deeper than `silhouette.NEAREST_RADII` tube radii; [n] which have any.

    A ray's line goes on behind the light, so without the cut a segment that crosses the light's plane
    would be hit there. What is not cut comes back to the last bit; what has no part left comes back as
    it was. Where one end is more than twice as deep, the one whose coordinates are smaller comes
    first: places between are found from the first, and a rounding of the far one would be much.
    Differentiable with respect to `a` and `b`.
    """
    least = least_depth(radius)
    with torch.no_grad():
        # most often nothing is near the light, and all is about as deep
        low, high = torch.stack([a[:, 2], b[:, 2]]).aminmax() if len(a) else (least, least)
        if low >= least and high <= 2 * low:
            return a, b, a.new_ones(len(a), dtype=torch.bool)
    near_a, near_b = a[:, 2] < least, b[:, 2] < least
    seen = ~(near_a & near_b)
    if bool((near_a | near_b).any()):
        a, b = _cut(a, b, near_a, near_b, least)
    one, two = a.detach(), b.detach()
    uneven = (two[:, 2] < 0.5 * one[:, 2]) | (one[:, 2] < 0.5 * two[:, 2])
    # across and along count alike: an end near the light may lie far to the side
    far_first = seen & uneven & (_size(two) < _size(one))
    if bool(far_first.any()):
        swap = far_first[:, None]
        a, b = torch.where(swap, b, a), torch.where(swap, a, b)
    return a, b, seen


def _size(p: Tensor) -> Tensor:
    """Return [n] how far across times how deep."""
    return p[:, :2].abs().amax(1) * p[:, 2]


def _cut(
    a: Tensor, b: Tensor, near_a: Tensor, near_b: Tensor, least: float
) -> tuple[Tensor, Tensor]:
    """Return segments with an end at the depth `least` where they cross it."""
    change = b[:, 2] - a[:, 2]
    crossing = near_a ^ near_b
    t = (least - a[:, 2]) / torch.where(crossing, change, 1.0)
    at = a[:, :2] + t[:, None] * (b - a)[:, :2]
    # its depth is known: interpolated, it would be off by a rounding of a far end's
    at = torch.cat([at, torch.full_like(at[:, :1], least)], 1)
    a_cut = torch.where((near_a & crossing)[:, None], at, a)
    b_cut = torch.where((near_b & crossing)[:, None], at, b)
    return a_cut, b_cut
