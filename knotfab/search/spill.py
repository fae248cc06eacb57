"""A pull on strands that stand outside a silhouette, by how far outside they stand.

The rendered image pulls a strand only where it meets an edge: one that lies wholly outside feels
nothing. The distance to the silhouette has a slope everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from knotfab.base.arrays import Array
from knotfab.geometry.projection import project
from knotfab.limits.base import Felt, State
from knotfab.problem import TargetView
from knotfab.render.picture import grid_at
from knotfab.search.objective import Term, Weights

__all__ = ["Spill"]

_MARGIN = 0.5  # a share of the frame on each side; a place further out counts as its edge
_CELLS = 240  # cells along the longer side
# weight of a strand that stands a tube radius outside, against one tube radius squared of image
_WEIGHT = 0.5


@dataclass(frozen=True)
class Spill(Term):
    """Length times distance outside a silhouette, in squared tube radii.

    `field` (H, W) is the distance to the silhouette in tube radii, `projection` (3, 4) leads to it.
    """

    projection: Array
    field: Array
    radius: float

    @classmethod
    def of(cls, target: TargetView, radius: float) -> Spill:
        """Return the term of one view; the tube's radius in mm."""
        view = target.view
        cell = view.longer_mm / _CELLS
        wanted, camera = grid_at(view, target.mask, cell, _MARGIN, beside=target.ends)
        far = distance_transform_edt(~wanted) * (cell / view.magnification / radius)
        return cls(camera.projection, far, radius)

    def __call__(self, state: State, weights: Weights) -> Felt:
        seen = project(state.points, self.projection)
        last = np.array(self.field.shape[::-1]) - 1
        at = np.clip(seen.places, 0.0, last)
        cell = np.minimum(at.astype(np.int64), last - 1)
        share = at - cell
        # the field is bilinear between the middles of four cells
        (u, v), (x, y) = cell.T, share.T
        f = self.field
        upper, lower = f[v, u], f[v + 1, u]
        rise, fall = f[v, u + 1] - upper, f[v + 1, u + 1] - lower
        upper, lower = upper + x * rise, lower + x * fall
        slope = np.column_stack([(1.0 - y) * rise + y * fall, lower - upper])
        slope[at != seen.places] = 0.0  # beyond the edge it stays what it is there
        scale = _WEIGHT * weights.image * state.spacing / self.radius
        return scale * float(((1.0 - y) * upper + y * lower).sum()), scale * seen.pull(slope)
