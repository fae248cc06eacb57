"""The silhouette of a picture file, and its mask on the grid on which shadows are compared."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

__all__ = [
    "LONGER_SIDE",
    "PictureError",
    "WorkingFrame",
    "padded_mask",
    "read_silhouette",
    "working_frame",
]

LONGER_SIDE = 1024
"""Pixels on the longer side of the frame at which shadow and picture are compared."""

ROWS_AT_ONCE = 2**20  # pixels in a block of rows
Mask = NDArray[np.bool_]


class PictureError(ValueError):
    """The picture cannot be read; the message says which one and why."""


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


def read_silhouette(path: str | PathLike[str], *, invert: bool = False) -> Mask:
    """The silhouette (H, W) of a picture file, in the picture's own pixels.

    Opaque pixels (alpha at least half) where the picture has transparency; otherwise the pixels
    whose colour differs from the border's (the median of the outermost pixels) by more than half
    of the largest such difference. `invert` swaps inside and outside. Differences are Euclidean
    in the file's own RGB or grey values.

    Raises:
        PictureError: the file is missing, is no picture, or is damaged.
    """
    picture = Path(path)
    if picture.exists() and not picture.is_file():  # a pipe or a device may never end
        raise PictureError(f"{picture}: is not a plain file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of odd metadata; the pixels decide
            with Image.open(picture) as opened:
                opened.load()
                ImageOps.exif_transpose(opened, in_place=True)
                mask = _mask(opened)
    except FileNotFoundError as error:
        raise PictureError(f"{picture}: there is no such file") from error
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise PictureError(f"{picture}: not a picture this reader knows ({error})") from error
    except (OSError, SyntaxError, ValueError) as error:
        raise PictureError(f"{picture}: damaged or unreadable ({error})") from error
    return ~mask if invert else mask


def _mask(image: Image.Image) -> Mask:
    if "A" in image.getbands() or "transparency" in image.info:
        alpha = np.asarray(image.convert("RGBA"))[..., 3]
        if (alpha < 255).any():
            return alpha >= 128
        image = image.convert("RGBA").convert("RGB")
    if image.mode in ("I", "F") or image.mode.startswith("I;"):
        values = np.asarray(image)[..., None]  # 16-bit grey keeps its depth
    elif image.mode in ("1", "L"):
        values = np.asarray(image.convert("L"))[..., None]
    else:
        values = np.asarray(image.convert("RGB"))
    border = np.concatenate([values[0], values[-1], values[1:-1, 0], values[1:-1, -1]])
    colour = np.median(border.astype(np.float64), axis=0)
    # squares, a few rows at a time: they are exact, and a picture may have 8000 x 8000 pixels
    step = max(1, ROWS_AT_ONCE // values.shape[1])
    blocks = [slice(i, i + step) for i in range(0, len(values), step)]
    largest = max(float(_squares(values[rows], colour).max()) for rows in blocks)
    if largest == 0:
        return np.zeros(values.shape[:2], dtype=bool)
    return np.concatenate([4 * _squares(values[rows], colour) > largest for rows in blocks])


def _squares(values: NDArray[Any], colour: NDArray[np.float64]) -> NDArray[np.floating[Any]]:
    # single precision is exact for 8 bits: four times a sum of squares stays below 2**24
    kind = np.float32 if values.dtype == np.uint8 else np.float64
    total = np.zeros(values.shape[:2], dtype=kind)
    for channel, middle in enumerate(colour.astype(kind)):
        difference = values[..., channel] - middle
        total += difference * difference
    return total
