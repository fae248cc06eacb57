"""A pull on strands that stand outside a silhouette, by how far outside they stand.

The rendered image pulls a strand only where it meets an edge: one that lies wholly outside feels
nothing. The distance to the silhouette has a slope everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from knotfab.limits.base import State
from knotfab.problem import TargetView
from knotfab.render.picture import grid_at
from knotfab.search.objective import Term, Weights

__all__ = ["Spill"]

_MARGIN = 0.5  # of the frame on each side; what is further out counts as its edge
_CELLS = 240  # of the longer side
# of a strand that stands a tube radius outside, against one tube radius squared of image
_WEIGHT = 0.5


@dataclass(frozen=True)
class Spill(Term):
    """Length times distance outside a silhouette, in squared tube radii.

    `field` [1, 1, H, W] is the distance to the silhouette in tube radii, `projection` [3, 4] leads to it.
    """

    projection: Tensor
    field: Tensor
    radius: float

    @classmethod
    def of(cls, target: TargetView, radius: float, device: str = "cpu") -> Spill:
        """The term of one view; the tube's radius in mm."""
        view = target.view
        cell = view.longer_mm / _CELLS
        wanted, camera = grid_at(view, target.mask, cell, _MARGIN)
        far = distance_transform_edt(~wanted) * (cell / view.magnification / radius)
        return cls(
            torch.as_tensor(camera.projection, device=device),
            torch.as_tensor(far, dtype=torch.float64, device=device)[None, None],
            radius,
        )

    def __call__(self, state: State, weights: Weights) -> Tensor:
        h = state.points @ self.projection[:, :3].T + self.projection[:, 3]
        height, width = self.field.shape[2:]
        last = torch.tensor([width - 1, height - 1], dtype=h.dtype, device=h.device)
        at = 2.0 * h[:, :2] / h[:, 2:] / last - 1.0
        out = torch.nn.functional.grid_sample(
            self.field, at[None, None], padding_mode="border", align_corners=True
        )
        return out.sum() * (_WEIGHT * weights.image * state.spacing / self.radius)
