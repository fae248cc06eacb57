"""A frame as a function of turns and distances that carry gradients: the view as an unknown.

The paper names this as future work (section 7: the viewer's configuration is found along with the knot).
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from knotfab.render.frame import Frame, Sheet

__all__ = ["posed_frame", "tensor_frame", "turn_matrix"]


def tensor_frame(frame: Frame, dtype: torch.dtype, device: str | torch.device = "cpu") -> Frame:
    """Return the view of a frame for tensors."""
    axes, eye = (torch.as_tensor(x, dtype=dtype, device=device) for x in (frame.axes, frame.eye))
    return replace(frame, axes=axes, eye=eye)


def turn_matrix(turn_deg: Tensor) -> Tensor:
    """Return [3, 3] the turn of a view by [3] azimuth, elevation, roll: columns are its x, y, z there.

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
    """Return the frame of `sheet` seen from a light at these numbers, differentiable in all of them.

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
