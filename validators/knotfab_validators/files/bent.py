"""A silhouette mirrored and bent as a scene's view says (docs/conventions.md), and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from knotfab_formats.verdict import Bending
from knotfab_validators.arrays import Array, Mask

if TYPE_CHECKING:
    from knotfab_formats.scene import View

__all__ = ["Bend", "Bent", "bend_of", "bend_silhouette"]

# The outermost rows and columns of control points lie one step outside the frame.
ROWS, COLUMNS = 15, 11
UNIT = 1e-4  # a share of the picture's height


@dataclass(frozen=True)
class Bend:
    """A view's change of its picture: it mirrors it, then looks elsewhere for each pixel.

    `points` (2, ROWS, COLUMNS), right and down, in shares of the height, are the coefficients of a cubic
    B-spline; None: the picture is mirrored alone.
    """

    mirrored: bool
    points: Array | None


@dataclass(frozen=True)
class Bent:
    """A bent silhouette (H, W), and how far its pixels are from where they were, in shares of the height:
    `rms`, `most`; `stretch` is the largest change of a length, as a factor, anywhere in the frame, infinite
    where the picture folds."""

    mask: Mask
    rms: float
    most: float
    stretch: float
    mirrored: bool

    @property
    def figures(self) -> Bending:
        """What a report says of it."""
        return Bending(
            rms=self.rms, most=self.most, stretch=self.stretch, mirrored=self.mirrored or None
        )


def bend_of(view: View) -> Bend | None:
    """Read a view's change of its picture; None where the picture stays as it is."""
    if not view.bend_points:
        return Bend(True, None) if view.mirrored else None
    pairs = [[pair.split(",") for pair in row.split(" ")] for row in view.bend_points]
    points = np.moveaxis(np.array(pairs, dtype=np.float64), -1, 0)
    return Bend(bool(view.mirrored), UNIT * points)


def bend_silhouette(mask: Mask, bend: Bend) -> Bent:
    """Return the silhouette as its view has it drawn."""
    height, width = mask.shape
    if bend.mirrored:
        mask = np.fliplr(mask)
    if bend.points is None:
        return Bent(mask, 0.0, 0.0, 1.0, bend.mirrored)
    # a step between control points that lie on the frame's edges or within
    down = 1 + (np.arange(height) + 0.5) / height * (ROWS - 3)
    right = 1 + (np.arange(width) + 0.5) / width * (COLUMNS - 3)
    at = np.stack(np.meshgrid(down, right, indexing="ij"))
    dx, dy = (
        height * ndimage.map_coordinates(axis, at, order=3, prefilter=False) for axis in bend.points
    )
    y, x = np.mgrid[:height, :width]
    inside = ndimage.map_coordinates(mask.astype(np.float64), [y + dy, x + dx], order=1)
    bent = inside >= 0.5
    moved = np.hypot(dx, dy)[bent] / height if bent.any() else np.zeros(1)
    rms, most = float(np.sqrt(np.mean(moved**2))), float(moved.max())
    return Bent(bent, rms, most, _stretch(dx, dy), bend.mirrored)


def _stretch(dx: Array, dy: Array) -> float:
    """Give the largest factor by which a field changes a length, or its inverse; infinite where it folds."""
    (xy, xx), (yy, yx) = np.gradient(dx), np.gradient(dy)
    jacobian = np.stack([1 + xx, xy, yx, 1 + yy], axis=-1).reshape(-1, 2, 2)
    if np.linalg.det(jacobian).min() <= 0:
        return float("inf")
    # singular values of 2 x 2: the sum of squares is that of all entries, their product the determinant
    squares, product = (jacobian**2).sum((1, 2)), np.linalg.det(jacobian)
    longest = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4 * product**2, 0))))
    return float(max(longest.max(), (longest / product).max()))
