"""The view of one light in torch: points become (x, y, depth) in the receiver's own axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from knotfab.scene.camera import Camera

__all__ = ["Frame", "Number", "frame_of", "number"]

Number = float | Tensor  # a tensor [] where it has a gradient


def number(value: Number) -> float:
    """The value without its gradient."""
    return float(value.detach()) if isinstance(value, Tensor) else value


@dataclass(frozen=True)
class Frame:
    """A pinhole whose axes are those of its receiver plane: x right, y down, z away from the light.

    A pixel (u, v) has the ray direction ((u + u0) * step, (v + v0) * step, 1); `focal_px` turns
    a length at depth 1 into pixels. Pixels are square. The numbers may be tensors [] with a gradient, where
    the view itself is an unknown.
    """

    axes: Tensor  # [3, 3] rows x, y, z
    eye: Tensor  # [3]
    u0: Number
    v0: Number
    step: Number
    width: int
    height: int

    @property
    def focal_px(self) -> Number:
        """Pixels per unit of x/z."""
        return 1.0 / self.step

    def local(self, points: Tensor) -> Tensor:
        """[..., 3] scene mm -> [..., 3] receiver axes, mm from the light."""
        return (points - self.eye) @ self.axes.T

    def pixels(self, local: Tensor) -> Tensor:
        """[..., 3] receiver axes -> [..., 2] pixel coordinates."""
        uv = local[..., :2] / local[..., 2:] * self.focal_px
        return uv - torch.tensor([self.u0, self.v0], dtype=uv.dtype, device=uv.device)

    def fixed(self) -> Frame:
        """The same view with its present numbers, without gradient."""
        if not isinstance(self.step, Tensor):
            return self
        u0, v0, step = (number(n) for n in (self.u0, self.v0, self.step))
        return Frame(self.axes.detach(), self.eye.detach(), u0, v0, step, self.width, self.height)


def frame_of(camera: Camera, dtype: torch.dtype, device: str | torch.device = "cpu") -> Frame:
    """The torch frame of a camera with square pixels.

    Raises:
        ValueError: when the camera's pixels are not square (to a part in a million).
    """
    pitch, pitch_v = np.linalg.norm(camera.du), np.linalg.norm(camera.dv)
    if abs(pitch / pitch_v - 1) > 1e-6:
        raise ValueError(f"pixels must be square, got {pitch} x {pitch_v} mm")
    right, down = camera.du / pitch, camera.dv / pitch_v
    axes = np.stack([right, down, np.cross(right, down)])
    corner = axes @ (camera.corner - camera.eye)
    distance = float(corner[2])
    return Frame(
        torch.as_tensor(axes, dtype=dtype, device=device),
        torch.as_tensor(camera.eye, dtype=dtype, device=device),
        float(corner[0] / pitch),
        float(corner[1] / pitch),
        float(pitch / distance),
        camera.width,
        camera.height,
    )
