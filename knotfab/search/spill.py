"""A pull on strands that stand outside a silhouette, by how far outside they stand.

The rendered image pulls a strand only where it meets an edge: one that lies wholly outside feels
nothing. The distance to the silhouette has a slope everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from knotfab.render.picture import frame_mm, grid_at
from knotfab.scene.model import View

__all__ = ["Spill", "spill_of"]

_MARGIN = 0.5  # of the frame on each side; what is further out counts as its edge
_CELLS = 240  # of the longer side


@dataclass(frozen=True)
class Spill:
    """Callable term: (points [N, 3], spacing mm) -> scalar, length times distance in squared tube radii.

    `field` [1, 1, H, W] is the distance to the silhouette in tube radii, `projection` [3, 4] leads to it.
    """

    projection: Tensor
    field: Tensor
    radius: float

    def __call__(self, points: Tensor, spacing: float) -> Tensor:
        h = points @ self.projection[:, :3].T + self.projection[:, 3]
        height, width = self.field.shape[2:]
        last = torch.tensor([width - 1, height - 1], dtype=h.dtype, device=h.device)
        at = 2.0 * h[:, :2] / h[:, 2:] / last - 1.0
        out = torch.nn.functional.grid_sample(
            self.field, at[None, None], padding_mode="border", align_corners=True
        )
        return out.sum() * (spacing / self.radius)


def spill_of(view: View, mask: NDArray[np.bool_], radius: float, device: str = "cpu") -> Spill:
    """The term of one view with its silhouette (H, W); the tube's radius in mm."""
    cell = max(frame_mm(view)) / _CELLS
    wanted, camera = grid_at(view, mask, cell, _MARGIN)
    far = distance_transform_edt(~wanted) * (cell / view.magnification / radius)
    return Spill(
        torch.as_tensor(camera.projection, device=device),
        torch.as_tensor(far, dtype=torch.float64, device=device)[None, None],
        radius,
    )
