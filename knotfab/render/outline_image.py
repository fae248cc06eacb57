"""A view's picture by the distance to outlines in the image plane, of capsules or of ellipses.

The paper's renderers (section 3.3) behind the calls of `tensors.DeviceImage`, to be measured beside the ray
distance: in torch alone, and in double precision, which conics need.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from knotfab.base.arrays import Array, Real
from knotfab.geometry.polylines import Polylines
from knotfab.render.frame import Frame, number
from knotfab.render.outlines import Won, render_outlines, winners
from knotfab.render.silhouette import least_depth

__all__ = ["OutlineImage"]


@dataclass(frozen=True)
class _Eye:
    """`outlines.Pinhole` of a frame of tensors: its image plane lies at depth 1."""

    frame: Frame
    near: float  # spheres are seen that lie wholly beyond, mm
    far: float = 1e9  # no infinity, which would have no slope

    @property
    def width(self) -> int:
        return self.frame.width

    @property
    def height(self) -> int:
        return self.frame.height

    @property
    def pitch(self) -> float:
        """The side of a pixel on the image plane."""
        return number(self.frame.step)

    @property
    def focal(self) -> tuple[float, float, float]:
        return 0.5 * self.width * self.pitch, 0.5 * self.height * self.pitch, 1.0

    def local(self, points: Tensor) -> Tensor:
        found: Tensor = self.frame.local(points)
        return found

    def plane(self, u: Tensor, v: Tensor) -> Tensor:
        u0, v0 = number(self.frame.u0), number(self.frame.v0)
        return torch.stack([(u + u0) * self.pitch, (v + v0) * self.pitch], -1)

    def half_diagonal(self, pixels: int) -> float:
        return float(np.sqrt(0.5)) * (pixels - 1) * self.pitch


@dataclass(frozen=True)
class OutlineImage:
    """A picture [height, width] on a device and its frame; capsules, or ellipses at vertices, draw it."""

    frame: Frame
    target: Tensor
    renderer: Literal["capsule", "ellipse"]

    @classmethod
    def of(
        cls, frame: Frame, target: Real, device: str, renderer: Literal["capsule", "ellipse"]
    ) -> OutlineImage:
        """The picture of arrays."""
        there = torch.as_tensor(target, device=device).double()
        return cls(frame.tensors(there.dtype, device), there, renderer)

    def squared_error(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float, won: Any
    ) -> tuple[float, Array]:
        """What `DeviceImage.squared_error` is, of this image."""
        p, q = self._ends(points, rings, slopes=True)
        error = ((self._image(p, q, radius, tau, cutoff, won) - self.target) ** 2).sum()
        (slope,) = torch.autograd.grad(error, p)
        return float(error.detach()), slope.cpu().numpy()

    def find_winners(self, points: Real, rings: Polylines, radius: float, reach_px: float) -> Won:
        """Which capsule, or ellipse, is the largest at each pixel within reach of one."""
        p, q = self._ends(points, rings)
        eye = self._eye(radius)
        return winners(p, p if q is None else q, eye, radius, reach_px * eye.pitch)

    def render(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float
    ) -> Real:
        """The image of the tube about vertices (N, 3); tau per px."""
        with torch.no_grad():
            image = self._image(*self._ends(points, rings), radius, tau, cutoff)
        return np.asarray(image.cpu().numpy())

    def _image(
        self,
        starts: Tensor,
        ends: Tensor | None,
        radius: float,
        tau: float,
        cutoff: float,
        won: Won | None = None,
    ) -> Tensor:
        eye = self._eye(radius)
        return render_outlines(starts, ends, eye, radius, tau / eye.pitch, cutoff, won)

    def _eye(self, radius: float) -> _Eye:
        return _Eye(self.frame, least_depth(radius) - radius)

    def _ends(
        self, points: Real, rings: Polylines, slopes: bool = False
    ) -> tuple[Tensor, Tensor | None]:
        p = torch.as_tensor(points, dtype=self.target.dtype, device=self.target.device)
        p.requires_grad_(slopes)
        if self.renderer == "ellipse":
            return p, None
        return p, p[torch.as_tensor(rings.next, device=p.device)]
