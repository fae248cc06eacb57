"""How well the picture can be read from elsewhere: a quick estimate to choose depth profiles by.

The contract's legibility (turn the part about its middle, silhouette it, stretch both silhouettes to
their bounding boxes, largest IoU), on a coarse grid and from the centre line alone.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from knotfab.arrays import Array, Mask

__all__ = ["legibility", "stretch_mask"]


_GRID = 64


def stretch_mask(mask: Mask) -> Mask:
    """The mask cropped to its bounding box and stretched to the estimate's grid."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    at = (np.arange(_GRID) + 0.5) / _GRID
    v = rows[0] + (at * (rows[-1] + 1 - rows[0])).astype(int)
    u = columns[0] + (at * (columns[-1] + 1 - columns[0])).astype(int)
    return np.asarray(mask[np.ix_(v, u)])


def _silhouette(points: Array, radius: float, light_distance: float) -> Mask:
    """Silhouette of the tube through `points` (axis view, dense samples), stretched to the grid."""
    scale = light_distance / (light_distance - points[:, 2])
    at = points[:, :2] * scale[:, None]
    low, high = at.min(0) - radius, at.max(0) + radius
    cell = (high - low) / _GRID
    column, row = np.clip(((at - low) / cell).astype(int), 0, _GRID - 1).T
    empty = np.ones((_GRID, _GRID), dtype=bool)
    empty[_GRID - 1 - row, column] = False
    return np.asarray(distance_transform_edt(empty, sampling=(cell[1], cell[0])) <= radius)


def _turns(angle_deg: float) -> list[Array]:
    a = np.deg2rad(angle_deg)
    c, s = np.cos(a), np.sin(a)
    sideways = [np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]]) for d in (s, -s)]
    return sideways + [np.array([[1, 0, 0], [0, c, -d], [0, d, c]]) for d in (s, -s)]


def legibility(
    points: Array, radius: float, light_distance: float, target: Mask, angle_deg: float
) -> float:
    """Largest IoU of the turned part's silhouette with the target's.

    Args:
        points: (n, 3) mm in the view's own axes (z towards the light), about a grid cell apart.
        radius: tube radius, mm.
        light_distance: mm from the light to the part's middle.
        target: the picture's mask from `stretched`.
        angle_deg: the turn.
    """
    centred = points - 0.5 * (points.min(0) + points.max(0))
    worst = 0.0
    for turn in _turns(angle_deg):
        seen = _silhouette(centred @ turn.T, radius, light_distance)
        worst = max(worst, float((seen & target).sum() / (seen | target).sum()))
    return worst
