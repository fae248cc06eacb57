"""The silhouette of a capsule by ray distance: exact, and without a singular case.

A pixel's ray meets the capsule around the segment a-b exactly when the line of the ray comes within
the radius of the segment. With p = z (x, y, 1) and the ray direction D = (q, 1), the moment p x D has the
components z (dy, -dx, dx q_y - dy q_x), d = (x, y) - q: small differences are taken first, so single
precision keeps its digits however far away the light is.
"""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["BEHIND", "capsule_distance", "ray_miss"]

BEHIND = -1e9  # the signed distance (px) of segments behind the light
_TINY = 1e-30
_NEAREST = 1e-12  # mm; what is seen is deeper (clip.py), and the square of the inverse is a number


def _moment(p: Tensor, qx: Tensor, qy: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return p x D for p = (x, y, z) on the last axis and D = (qx, qy, 1), differences first."""
    z = p[..., 2]
    mx = z * qy - p[..., 1]
    my = p[..., 0] - z * qx
    return mx, my, -(mx * qx + my * qy)


def ray_miss(
    a: Tensor,  # [..., 3] receiver axes, mm
    b: Tensor,  # [..., 3]
    qx: Tensor,  # [...] ray direction, x/z
    qy: Tensor,  # [...]
) -> tuple[Tensor, Tensor]:
    """Measure how far rays pass from segments a-b (mm), and the depth of the segment's closest point (mm).

    All arguments broadcast; differentiable with respect to `a` and `b`.
    """
    ax, ay, az = _moment(a, qx, qy)
    ex, ey, ez = (m1 - m0 for m0, m1 in zip((ax, ay, az), _moment(b, qx, qy), strict=True))
    square = ex * ex + ey * ey + ez * ez
    # a ray that runs along the segment has no best t: any serves, so take the first end
    t = (-(ax * ex + ay * ey + az * ez) / square.clamp_min(_TINY)).clamp(0.0, 1.0)
    # the least distance does not depend on t to first order, the depth there does
    at = t.detach()
    cx, cy, cz = ax + at * ex, ay + at * ey, az + at * ez
    stretch = 1.0 + qx * qx + qy * qy  # |D|^2
    # a ray through the segment itself has an offset of mere rounding, which points anywhere: no gradient
    lost = 4.0 * torch.finfo(a.dtype).eps * a.detach()[..., :2]
    least = (lost * lost).sum(-1).clamp_min(_TINY)
    miss = ((cx * cx + cy * cy + cz * cz) / stretch).clamp_min(least).sqrt()
    return miss, a[..., 2] + t * (b[..., 2] - a[..., 2])


def capsule_distance(
    a: Tensor,  # [..., 3] receiver axes, mm
    b: Tensor,  # [..., 3]
    qx: Tensor,  # [...] ray direction, x/z
    qy: Tensor,  # [...]
    radius: float | Tensor,
    focal_px: float | Tensor,
) -> Tensor:
    """Return the signed distance in pixels of rays to the silhouettes of capsules, positive inside.

    All arguments broadcast; differentiable with respect to every tensor among them (the ray-distance
    form; equals the paper's capsule silhouette, sec. 3.3, in sign everywhere).
    """
    miss, depth = ray_miss(a, b, qx, qy)
    ahead = depth > _NEAREST
    # the depth that is not used must not overflow either: its gradient, infinite times zero, would be NaN
    return torch.where(ahead, (radius - miss) * (focal_px / torch.where(ahead, depth, 1.0)), BEHIND)
