"""A view's picture by the distance to outlines in the image plane, of capsules or of ellipses.

The paper's renderers (section 3.3) behind the calls of `DeviceImage`, to be measured beside the ray
distance: in torch alone, and in double precision, which conics need.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from knotfab.base.arrays import Real
from knotfab.geometry.polylines import Polylines
from knotfab.render.frame import Frame, number
from knotfab.render.silhouette import least_depth
from knotfab.torch_forms.outlines import Won, render_outlines, winners
from knotfab.torch_forms.tensors import DeviceImage

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
class OutlineImage(DeviceImage):
    """A picture [height, width] on a device and its frame; capsules, or ellipses at vertices, draw it."""

    renderer: Literal["capsule", "ellipse"] = "capsule"

    def find_winners(self, points: Real, rings: Polylines, radius: float, reach_px: float) -> Won:
        """Find which capsule, or ellipse, is the largest at each pixel within reach of one."""
        eye = self._eye(radius)
        return winners(*self._ends(points, rings), eye, radius, reach_px * eye.pitch)

    def _image(
        self, p: Tensor, q: Tensor, radius: float, tau: float, cutoff: float, won: Won | None = None
    ) -> Tensor:
        eye, ends = self._eye(radius), None if self.renderer == "ellipse" else q
        return render_outlines(p, ends, eye, radius, tau / eye.pitch, cutoff, won)

    def _error(
        self, p: Tensor, q: Tensor, radius: float, tau: float, cutoff: float, won: Any
    ) -> Tensor:
        return ((self._image(p, q, radius, tau, cutoff, won) - self.target) ** 2).sum()

    def _eye(self, radius: float) -> _Eye:
        return _Eye(self.frame, least_depth(radius) - radius)

    def _ends(self, points: Real, rings: Polylines, slopes: bool = False) -> tuple[Tensor, Tensor]:
        p, q = super()._ends(points, rings, slopes)
        return p, p if self.renderer == "ellipse" else q
