"""The grid on which shadow and picture are compared, and drawings of that comparison."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab_validators.arrays import Mask
from knotfab_validators.files.picture import write_image

if TYPE_CHECKING:
    from scipy.sparse import csr_array

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
    """Return the working frame of a picture (px), with `longer` px on its longer side."""
    scale = longer / max(width, height)
    w, h = max(1, round(width * scale)), max(1, round(height * scale))
    return WorkingFrame(w, h, max(1, round(w / 4)), max(1, round(h / 4)))


def padded_mask(mask: Mask, frame: WorkingFrame) -> Mask:
    """Resample the mask (H, W) to the padded working frame, True where half of a pixel is.

    Sampling at the centres instead would shift a picture of twice the resolution by half of its own
    pixels. The padding is False.
    """
    height, width = mask.shape
    across = mask.astype(np.int32) @ _overlap_weights(width, frame.width).T
    covered = _overlap_weights(height, frame.height) @ across.astype(np.int64)
    return np.pad(
        2 * covered >= height * width, ((frame.pad_y, frame.pad_y), (frame.pad_x, frame.pad_x))
    )


def _overlap_weights(pixels: int, wanted: int) -> csr_array:
    """Return how much of each of `pixels` each of `wanted` covers, times `wanted`: (wanted, pixels).

    Integer weights keep ties exact; each row sums to `pixels`.
    """
    from scipy.sparse import csr_array

    cuts = np.union1d(np.arange(wanted + 1) * pixels, np.arange(pixels + 1) * wanted)
    at = cuts[:-1]
    places = (at // pixels, at // wanted)
    return csr_array((np.diff(cuts).astype(np.int32), places), shape=(wanted, pixels))


# Pictures of a verified shadow: the shadow alone, and beside its target with their difference.

PANEL_PX = 512  # longer side of a panel
GAP_PX = 16
PAPER = (250, 248, 244)
FRAME = (240, 237, 231)  # colour inside the picture's frame, slightly darker than the padding
INK = (44, 46, 52)
SHARED = (201, 203, 206)
SPILL = (214, 94, 50)  # colour of shadow where none should be
MISSING = (38, 110, 168)  # colour of missing shadow


def write_shadow(path: Path, shadow: Mask | NDArray[np.float32], frame: WorkingFrame) -> None:
    """Write the shadow inside the picture's frame, black on white, at the working resolution.

    Args:
        shadow: (H, W), on the padded working frame; a soft one from 0 to 1.
    """
    grey = np.rint(255.0 * (1.0 - shadow[frame.window])).astype(np.uint8)
    write_image(path, Image.fromarray(grey))


def write_compare(path: Path, target: Mask, shadow: Mask, frame: WorkingFrame) -> None:
    """Write target, shadow and their difference side by side, on the padded frame.

    In the difference grey is what both have, orange is spill, and blue is missing.
    """
    base = np.empty((*target.shape, 3), dtype=np.uint8)
    base[:] = PAPER
    base[frame.window] = FRAME
    panels = [_ink(base, target, INK), _ink(base, shadow, INK)]
    difference = _ink(base, target & shadow, SHARED)
    difference = _ink(difference, shadow & ~target, SPILL)
    panels.append(_ink(difference, target & ~shadow, MISSING))
    rows, columns = _crop_window(target | shadow, frame)
    panels = [panel[rows, columns] for panel in panels]
    sides = panels[0].shape[:2]
    scale = min(1.0, PANEL_PX / max(sides))
    height, width = (max(1, round(side * scale)) for side in sides)
    sheet = Image.new("RGB", (3 * width + 4 * GAP_PX, height + 2 * GAP_PX), PAPER)
    for i, panel in enumerate(panels):
        small = Image.fromarray(panel).resize((width, height), Image.Resampling.BOX)
        sheet.paste(small, (GAP_PX + i * (width + GAP_PX), GAP_PX))
    write_image(path, sheet)


def _crop_window(drawn: Mask, frame: WorkingFrame) -> tuple[slice, slice]:
    """Return the rows and columns of the frame with a narrow margin, extended to whatever is drawn."""

    def span(occupied: Mask, pad: int, length: int) -> slice:
        margin = min(pad, max(frame.width, frame.height) // 24)
        at = np.flatnonzero(occupied)
        first = min(pad, int(at[0])) if len(at) else pad
        last = max(pad + length, int(at[-1]) + 1) if len(at) else pad + length
        return slice(max(0, first - margin), min(len(occupied), last + margin))

    return (
        span(np.any(drawn, axis=1), frame.pad_y, frame.height),
        span(np.any(drawn, axis=0), frame.pad_x, frame.width),
    )


def _ink(panel: NDArray[np.uint8], where: Mask, colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    inked = panel.copy()
    inked[where] = colour
    return inked
