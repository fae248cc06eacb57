"""The silhouette of a picture file, and its mask on the grid on which shadows are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from knotfab_validators.arrays import Mask

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["LONGER_SIDE", "WorkingFrame", "padded_mask", "working_frame"]

LONGER_SIDE = 1024
"""Pixels on the longer side of the frame at which shadow and picture are compared."""


@dataclass(frozen=True)
class WorkingFrame:
    """A picture's frame, resampled and padded.

    `width` and `height` are the frame's pixels at the working resolution, `pad_x` and `pad_y` the
    pixels added on each side. Pixel (i, j) of the padded image is pixel (i - pad_x, j - pad_y) of
    the frame.
    """

    width: int
    height: int
    pad_x: int
    pad_y: int

    @property
    def padded_width(self) -> int:
        return self.width + 2 * self.pad_x

    @property
    def padded_height(self) -> int:
        return self.height + 2 * self.pad_y

    @property
    def window(self) -> tuple[slice, slice]:
        """The frame's rows and columns of the padded image."""
        rows = slice(self.pad_y, self.pad_y + self.height)
        return rows, slice(self.pad_x, self.pad_x + self.width)

    @property
    def mask(self) -> Mask:
        """The frame on the padded image."""
        inside = np.zeros((self.padded_height, self.padded_width), dtype=bool)
        inside[self.window] = True
        return inside


def working_frame(width: int, height: int, longer: int = LONGER_SIDE) -> WorkingFrame:
    """Return the working frame of a picture of `width` x `height` pixels: `longer` on its longer side."""
    scale = longer / max(width, height)
    w, h = max(1, round(width * scale)), max(1, round(height * scale))
    return WorkingFrame(w, h, max(1, round(w / 4)), max(1, round(h / 4)))


def padded_mask(mask: Mask, frame: WorkingFrame) -> Mask:
    """Return the mask (H, W) on the padded working frame: True where it covers half of a pixel or more.

    Looked up under a working pixel's centre instead, a picture of twice as many pixels would lie aside by
    half of one of its own. The padding is False.
    """
    height, width = mask.shape
    across = mask.astype(np.int32) @ _overlaps(width, frame.width).T
    covered = _overlaps(height, frame.height) @ across.astype(np.int64)
    return np.pad(
        2 * covered >= height * width, ((frame.pad_y, frame.pad_y), (frame.pad_x, frame.pad_x))
    )


def _overlaps(pixels: int, wanted: int) -> csr_array:
    """Return (wanted, pixels) how much of each of `pixels` each of `wanted` covers, times `wanted`.

    Whole numbers, so that ties are ties; each row sums to `pixels`.
    """
    from scipy.sparse import csr_array

    cuts = np.union1d(np.arange(wanted + 1) * pixels, np.arange(pixels + 1) * wanted)
    at = cuts[:-1]
    places = (at // pixels, at // wanted)
    return csr_array((np.diff(cuts).astype(np.int32), places), shape=(wanted, pixels))
