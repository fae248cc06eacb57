"""The paper's pinhole camera: place, turn, focal lengths, clipping depths and image size.

Paper, section 3.1. The camera's axes are x right, y down (with the picture's rows) and z away from the
eye; the image plane is z = f_z, and the picture covers |x| <= f_x, |y| <= f_y of it, pixel centres on
its edges included. Lengths are in the paper's own unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, radians, sin

import torch
from torch import Tensor

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class PaperCamera:
    """The camera (t, theta, f, z-, z+, W, H) of the paper's section 3.1; defaults are its Table 1.

    `turn_rad` are the angles about x, then y, then z that take the world's axes to the camera's.
    """

    place: Triple = (0.0, 0.0, 0.0)
    turn_rad: Triple = (0.0, 0.0, 0.0)
    focal: Triple = (1.0, 1.0, 2.0)
    near: float = 1e-3
    far: float = 1e3
    width: int = 256
    height: int = 256

    def __post_init__(self) -> None:
        if min(self.focal) <= 0 or not 0 < self.near < self.far:
            raise ValueError(
                "focal lengths and clipping depths must be positive, near before far; got "
                f"{self.focal}, {self.near}, {self.far}"
            )
        if min(self.width, self.height) < 2:
            raise ValueError(f"an image needs 2 x 2 pixels, got {self.width} x {self.height}")

    def axes(self, like: Tensor) -> Tensor:
        """Return [3, 3] rows: the camera's x, y and z in the world; dtype and device of `like`."""
        (a, b, c) = self.turn_rad
        about_x = [[1.0, 0.0, 0.0], [0.0, cos(a), -sin(a)], [0.0, sin(a), cos(a)]]
        about_y = [[cos(b), 0.0, sin(b)], [0.0, 1.0, 0.0], [-sin(b), 0.0, cos(b)]]
        about_z = [[cos(c), -sin(c), 0.0], [sin(c), cos(c), 0.0], [0.0, 0.0, 1.0]]
        x, y, z = (
            torch.tensor(m, dtype=torch.float64, device=like.device)
            for m in (about_x, about_y, about_z)
        )
        return (z @ y @ x).T.to(like.dtype)

    def local(self, points: Tensor) -> Tensor:
        """Map [..., 3] world -> [..., 3] camera coordinates."""
        place = torch.tensor(self.place, dtype=points.dtype, device=points.device)
        return (points - place) @ self.axes(points).T

    @property
    def pitch(self) -> tuple[float, float]:
        """Distance of neighbouring pixel centres on the image plane, along x and y."""
        return 2 * self.focal[0] / (self.width - 1), 2 * self.focal[1] / (self.height - 1)

    def plane(self, u: Tensor, v: Tensor) -> Tensor:
        """Map [...] pixel columns and rows -> [..., 2] places on the image plane (the paper's set Q)."""
        across, down = self.pitch
        return torch.stack([u * across - self.focal[0], v * down - self.focal[1]], -1)

    def half_diagonal(self, pixels: int) -> float:
        """Measure how far the centres of a square of so many pixels lie from its middle, on the plane."""
        return 0.5 * (pixels - 1) * hypot(*self.pitch)


def camera_around(
    middle: Sequence[float],
    distance: float,
    azimuth_deg: float = 0.0,
    elevation_deg: float = 0.0,
    *,
    width: int = 256,
    height: int = 256,
    focal: Triple = (1.0, 1.0, 2.0),
) -> PaperCamera:
    """Return a camera that looks at `middle` from `distance`.

    At azimuth and elevation 0 it looks along the world's z. Azimuth turns it about the world's y,
    elevation raises it towards the world's -y (up in the picture).
    """
    about_y, about_x = radians(azimuth_deg), -radians(elevation_deg)
    # way is the camera's z in the world, R_y R_x (0, 0, 1)
    way = (sin(about_y) * cos(about_x), -sin(about_x), cos(about_y) * cos(about_x))
    x, y, z = (m - distance * w for m, w in zip(middle, way, strict=True))
    return PaperCamera((x, y, z), (about_x, about_y, 0.0), focal=focal, width=width, height=height)
