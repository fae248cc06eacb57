"""The silhouette of a picture file, in its own pixels."""

from __future__ import annotations

import warnings
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from knotfab_validators.arrays import Array, Mask

__all__ = ["PictureError", "read_silhouette"]

ROWS_AT_ONCE = 2**20  # pixels in a block of rows


class PictureError(ValueError):
    """The picture cannot be read; the message says which one and why."""


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
                mask = _select_ink(opened)
    except FileNotFoundError as error:
        raise PictureError(f"{picture}: there is no such file") from error
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise PictureError(f"{picture}: not a picture this reader knows ({error})") from error
    except (OSError, SyntaxError, ValueError) as error:
        raise PictureError(f"{picture}: damaged or unreadable ({error})") from error
    return ~mask if invert else mask


def _select_ink(image: Image.Image) -> Mask:
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


def _squares(values: NDArray[Any], colour: Array) -> NDArray[np.floating[Any]]:
    # single precision is exact for 8 bits: four times a sum of squares stays below 2**24
    kind = np.float32 if values.dtype == np.uint8 else np.float64
    total = np.zeros(values.shape[:2], dtype=kind)
    for channel, middle in enumerate(colour.astype(kind)):
        difference = values[..., channel] - middle
        total += difference * difference
    return total
