"""The silhouette of a capsule by ray distance: exact, and without a singular case.

A pixel's ray meets the capsule around the segment a-b exactly when the line of the ray comes within
the radius of the segment. With p = z (x, y, 1) and the ray direction D = (q, 1), the moment p x D has the
components z (dy, -dx, dx q_y - dy q_x), d = (x, y) - q: small differences are taken first, so single
precision keeps its digits however far away the light is.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from knotfab.render.silhouette import Frame, Sheet, least_depth

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
    """Return how far rays pass from segments a-b, and the depth of the closest point, both mm.

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


# Segments are cut before the light's plane: matter at the light or behind it casts no shadow.


def cut_before_light(
    a: Tensor,  # [n, 3] receiver axes, mm
    b: Tensor,  # [n, 3]
    radius: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """Cut segments a-b at `silhouette.NEAREST_RADII` tube radii of depth; return which have a part left, [n].

    A ray's line goes on behind the light, so without the cut a segment that crosses the light's plane
    would be hit there. What is not cut is returned bit for bit, and so is what has no part
    left. If one end is more than twice as deep as the other, the one with the smaller coordinates
    comes first, since places between are computed from the first, and the far one has larger rounding errors.
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
    """Return how far points [n, 3] are off the axis, the larger of both ways, times their depth, [n]."""
    return p[:, :2].abs().amax(1) * p[:, 2]


def _cut(
    a: Tensor, b: Tensor, near_a: Tensor, near_b: Tensor, least: float
) -> tuple[Tensor, Tensor]:
    """Return segments whose end is moved to the depth `least` where they cross it."""
    change = b[:, 2] - a[:, 2]
    crossing = near_a ^ near_b
    t = (least - a[:, 2]) / torch.where(crossing, change, 1.0)
    at = a[:, :2] + t[:, None] * (b - a)[:, :2]
    # its depth is known: interpolated, it would be off by a rounding of a far end's
    at = torch.cat([at, torch.full_like(at[:, :1], least)], 1)
    a_cut = torch.where((near_a & crossing)[:, None], at, a)
    b_cut = torch.where((near_b & crossing)[:, None], at, b)
    return a_cut, b_cut


# A frame that is differentiable in its turns and distances: the view as an unknown.


def tensor_frame(frame: Frame, dtype: torch.dtype, device: str | torch.device = "cpu") -> Frame:
    """Return a frame whose numbers are tensors."""
    axes, eye = (torch.as_tensor(x, dtype=dtype, device=device) for x in (frame.axes, frame.eye))
    return replace(frame, axes=axes, eye=eye)


def turn_matrix(turn_deg: Tensor) -> Tensor:
    """Return the rotation of a view by azimuth, elevation and roll [3]; its columns are x, y, z, [3, 3].

    Azimuth turns light, wall and picture about the scene's y axis (docs/conventions.md); then
    elevation raises the light, and roll turns the picture counter-clockwise seen from the light.
    """
    a, e, r = torch.deg2rad(turn_deg)
    zero, one = torch.zeros_like(a), torch.ones_like(a)

    def matrix(*entries: Tensor) -> Tensor:
        return torch.stack(entries).reshape(3, 3)

    about_y = matrix(a.cos(), zero, a.sin(), zero, one, zero, -a.sin(), zero, a.cos())
    about_x = matrix(one, zero, zero, zero, e.cos(), e.sin(), zero, -e.sin(), e.cos())
    about_z = matrix(r.cos(), -r.sin(), zero, r.sin(), r.cos(), zero, zero, zero, one)
    return about_y @ about_x @ about_z


def posed_frame(
    sheet: Sheet,
    turn_deg: Tensor,  # [3] azimuth, elevation, roll
    light_distance_mm: Tensor,  # [] light to the middle of the piece
    wall_distance_mm: Tensor,  # [] middle of the piece to the wall
) -> Frame:
    """Return the frame of `sheet` for a light at these angles and distances, differentiable in all.

    Without elevation and roll it equals `frame_of(camera_of(view, ...))`.
    """
    turn = turn_matrix(turn_deg)
    right, upright, back = turn.T
    tilt = torch.deg2rad(turn.new_tensor(sheet.wall_tilt_deg))
    down = -(tilt.cos() * upright + tilt.sin() * back)
    axes = torch.stack([right, down, torch.linalg.cross(right, down)])
    # middle is the way from the light to the middle of the sheet, in the receiver's axes
    middle = axes @ (-(light_distance_mm + wall_distance_mm) * back)
    return Frame(
        axes,
        light_distance_mm * back,
        middle[0] / sheet.pixel_mm - 0.5 * (sheet.width - 1),
        middle[1] / sheet.pixel_mm - 0.5 * (sheet.height - 1),
        sheet.pixel_mm / middle[2],
        sheet.width,
        sheet.height,
    )
