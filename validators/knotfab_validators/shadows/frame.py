"""The silhouette of a picture file, and its mask on the grid on which shadows are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Mask

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


def working_frame(width: int, height: int, longer: int = LONGER_SIDE) -> WorkingFrame:
    """The working frame of a picture of `width` x `height` pixels: `longer` on its longer side."""
    scale = longer / max(width, height)
    w, h = max(1, round(width * scale)), max(1, round(height * scale))
    return WorkingFrame(w, h, max(1, round(w / 4)), max(1, round(h / 4)))


def padded_mask(mask: Mask, frame: WorkingFrame) -> Mask:
    """The mask (H, W) on the padded working frame: True where the pixel square under the centre is.

    Each working pixel takes the value of the picture's pixel that its centre lies in; nothing is
    smoothed. The padding is False.
    """
    height, width = mask.shape
    # whole numbers: a centre on the line between two pixels always takes the latter
    rows = (2 * np.arange(frame.height) + 1) * height // (2 * frame.height)
    columns = (2 * np.arange(frame.width) + 1) * width // (2 * frame.width)
    return np.pad(
        mask[np.ix_(rows, columns)], ((frame.pad_y, frame.pad_y), (frame.pad_x, frame.pad_x))
    )
