"""A view whose numbers are unknowns: turns, light and wall distance and tube radius carry gradients.

The frame of `knotfab.render.frame` as a function of a few tensors (the paper's future work, section 7:
the viewer's configuration and the thickness are found along with the knot).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from knotfab.render.capsule import capsule_distance
from knotfab.render.frame import Frame
from knotfab.render.tiled import CUTOFF, winners

__all__ = ["FreeFrame", "Sheet", "free_frame", "render_free", "turn_matrix", "winners_of"]


@dataclass(frozen=True)
class Sheet:
    """What stays fixed of a view: the raster on the receiver, and the receiver's tilt."""

    width: int
    height: int
    pixel_mm: float  # of the (square) pixels, on the receiver
    wall_tilt_deg: float = 0.0


@dataclass(frozen=True)
class FreeFrame:
    """A `Frame` whose numbers are tensors: everything is differentiable, `radius_mm` too."""

    axes: Tensor  # [3, 3] rows x right, y down, z away from the light
    eye: Tensor  # [3] mm
    u0: Tensor  # []
    v0: Tensor  # []
    step: Tensor  # [] a pixel's change of x/z
    radius_mm: Tensor  # []
    width: int
    height: int

    def local(self, points: Tensor) -> Tensor:
        """[..., 3] scene mm -> [..., 3] receiver axes, mm from the light."""
        return (points - self.eye) @ self.axes.T

    def fixed(self) -> Frame:
        """The same view with its present numbers, without gradient."""
        return Frame(
            self.axes.detach(),
            self.eye.detach(),
            float(self.u0.detach()),
            float(self.v0.detach()),
            float(self.step.detach()),
            self.width,
            self.height,
        )


def turn_matrix(turn_deg: Tensor) -> Tensor:
    """[3, 3] the turn of a view by [3] azimuth, elevation and roll: columns are its x, y, z in the scene.

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


def free_frame(
    sheet: Sheet,
    turn_deg: Tensor,  # [3] azimuth, elevation, roll
    light_distance_mm: Tensor,  # [] light to the middle of the piece
    wall_distance_mm: Tensor,  # [] middle of the piece to the wall
    radius_mm: Tensor,  # []
) -> FreeFrame:
    """The frame of `sheet` seen from a light at these numbers.

    Without elevation and roll it equals `frame_of(camera_of(view, ...))`.
    """
    turn = turn_matrix(turn_deg)
    right, upright, back = turn.T
    tilt = torch.deg2rad(torch.as_tensor(sheet.wall_tilt_deg, dtype=turn.dtype))
    down = -(tilt.cos() * upright + tilt.sin() * back)
    axes = torch.stack([right, down, torch.linalg.cross(right, down)])
    # from the light to the middle of the sheet, in the receiver's axes
    middle = axes @ (-(light_distance_mm + wall_distance_mm) * back)
    return FreeFrame(
        axes,
        light_distance_mm * back,
        middle[0] / sheet.pixel_mm - 0.5 * (sheet.width - 1),
        middle[1] / sheet.pixel_mm - 0.5 * (sheet.height - 1),
        sheet.pixel_mm / middle[2],
        radius_mm,
        sheet.width,
        sheet.height,
    )


def render_free(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: FreeFrame,
    tau: float,
    cutoff: float = CUTOFF,
    won: tuple[Tensor, Tensor] | None = None,
) -> Tensor:
    """[height, width] the image of `render_tiled`, differentiable in the view and the radius as well.

    `won` takes the winners of an earlier call, as in `render_tiled`.
    """
    a, b = frame.local(starts), frame.local(ends)
    if won is None:
        won = winners_of(starts, ends, frame, tau, cutoff)
    pixel, capsule = won
    qx = ((pixel % frame.width).to(a.dtype) + frame.u0) * frame.step
    qy = ((pixel // frame.width).to(a.dtype) + frame.v0) * frame.step
    s = capsule_distance(a[capsule], b[capsule], qx, qy, frame.radius_mm, 1.0 / frame.step)
    image = torch.zeros(frame.width * frame.height, dtype=a.dtype, device=a.device)
    image = image.index_put((pixel,), torch.sigmoid(tau * s))
    return image.reshape(frame.height, frame.width)


def winners_of(
    starts: Tensor, ends: Tensor, frame: FreeFrame, tau: float, cutoff: float = CUTOFF
) -> tuple[Tensor, Tensor]:
    """(pixel, capsule) of `knotfab.render.tiled.winners` at the frame's present numbers."""
    at = frame.fixed()
    a, b = at.local(starts.detach()), at.local(ends.detach())
    return winners(a, b, at, float(frame.radius_mm.detach()), cutoff / tau)
