"""The view of one light: points become (x, y, depth) in the receiver's own axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from knotfab.base.arrays import Real
from knotfab.base.compiled import compiled
from knotfab.scene.camera import Camera

__all__ = ["Frame", "Number", "Sheet", "frame_of", "number"]

Number: TypeAlias = Any  # a float, or a tensor [] where it has a gradient


def number(value: Number) -> float:
    """Return the value without its gradient."""
    return float(value if isinstance(value, float | int) else value.detach())


@compiled
def _turn_to(points: Real, axes: Real, eye: Real) -> Real:
    """Return (n, 3) points about `eye` in these axes (3, 3), rounded as `Frame.local` says it."""
    out = np.empty_like(points)
    for n in range(len(points)):
        x, y, z = points[n, 0] - eye[0], points[n, 1] - eye[1], points[n, 2] - eye[2]
        for k in range(3):
            out[n, k] = x * axes[k, 0] + y * axes[k, 1] + z * axes[k, 2]
    return out


@dataclass(frozen=True)
class Frame:
    """A pinhole whose axes are those of its receiver plane: x right, y down, z away from the light.

    A pixel (u, v) has the ray direction ((u + u0) * step, (v + v0) * step, 1); `focal_px` turns
    a length at depth 1 into pixels. Pixels are square. A frame of arrays takes arrays of points,
    one of tensors (`torch_forms.posed_frame.tensor_frame`) takes tensors; only there may the numbers be
    tensors [] with a gradient, where the view itself is an unknown.
    """

    axes: Any  # (3, 3) rows x, y, z
    eye: Any  # (3,)
    u0: Number
    v0: Number
    step: Number
    width: int
    height: int

    @property
    def focal_px(self) -> Number:
        """Pixels per unit of x/z."""
        return 1.0 / self.step

    def local(self, points: Any) -> Any:
        """Map (..., 3) scene mm -> (..., 3) receiver axes, mm from the light."""
        if isinstance(points, np.ndarray) and points.ndim == 2 and points.dtype == self.axes.dtype:
            return _turn_to(points, self.axes, self.eye)
        away = points - self.eye
        x, y, z = (away[..., k : k + 1] for k in range(3))
        across, along, deep = self.axes.T
        # no product of matrices: every library rounds that in its own way
        return x * across + y * along + z * deep

    def pixels(self, local: Any) -> Any:
        """Map (..., 3) receiver axes -> (..., 2) pixel coordinates."""
        uv = local[..., :2] / local[..., 2:] * self.focal_px
        corner = [number(self.u0), number(self.v0)]
        if isinstance(uv, np.ndarray):
            return uv - np.array(corner, dtype=uv.dtype)
        return uv - uv.new_tensor(corner)

    def arrays(self) -> Frame:
        """Return the same view for arrays: its present numbers, without gradient."""
        if isinstance(self.axes, np.ndarray):
            return self
        axes, eye = (x.detach().cpu().numpy() for x in (self.axes, self.eye))
        u0, v0, step = (number(n) for n in (self.u0, self.v0, self.step))
        return Frame(axes, eye, u0, v0, step, self.width, self.height)


@dataclass(frozen=True)
class Sheet:
    """The fixed part of a view: the raster on the receiver, and the receiver's tilt."""

    width: int
    height: int
    pixel_mm: float  # the side of the (square) pixels, on the receiver
    wall_tilt_deg: float = 0.0


def frame_of(
    camera: Camera, dtype: type[np.floating[Any]] = np.float64, *, stretched: bool = False
) -> Frame:
    """Return the frame, of arrays, of a camera with square pixels.

    Args:
        stretched: where pixels are not quite square, the axis that points down is stretched until they are.
            Points keep their pixels then; a tube is as much wider across that axis as pixels are.

    Raises:
        ValueError: when the camera's pixels are not square (to a part in a million), unless `stretched`.
    """
    pitch, pitch_v = np.linalg.norm(camera.du), np.linalg.norm(camera.dv)
    square = abs(pitch / pitch_v - 1) <= 1e-6
    if not (square or stretched):
        raise ValueError(f"pixels must be square, got {pitch} x {pitch_v} mm")
    right, down = camera.du / pitch, camera.dv / pitch_v
    axes = np.stack([right, down, np.cross(right, down)])
    if not square:
        axes[1] *= pitch / pitch_v
    corner = axes @ (camera.corner - camera.eye)
    distance = float(corner[2])
    return Frame(
        axes.astype(dtype),
        np.asarray(camera.eye, dtype=dtype),
        float(corner[0] / pitch),
        float(corner[1] / pitch),
        float(pitch / distance),
        camera.width,
        camera.height,
    )
