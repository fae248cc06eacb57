"""The greys of a picture as shares of black, for shadows that give tones by the spacing of strands."""

from __future__ import annotations

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array
from knotfab.base.errors import InputError
from knotfab.picture import raster
from knotfab.picture.read import Target

__all__ = ["read_darkness"]


def read_darkness(target: Target, invert: bool = False) -> Array:
    """Read (H, W) 0 where the picture is white, to 1 where it is black; what is transparent is white.

    Luma of ITU-R BT.601 as the file has it, from its first percentile (black) to its last (white).

    Raises:
        InputError: it is all one grey.
    """
    what = f"picture {target.shown}"
    image, _ = raster.decode(target.png_bytes, what)
    if target.crop_px is not None:
        left, top, width, height = target.crop_px
        image = image.crop((left, top, left + width, top + height))
    if image.mode.startswith("I"):
        grey = np.asarray(image, dtype=np.float64) / 257.0
    else:
        rgba = image.convert("RGBA")
        white = Image.new("RGBA", rgba.size, "white")
        rgb = np.asarray(Image.alpha_composite(white, rgba).convert("RGB"), dtype=np.float64)
        grey = rgb @ [0.299, 0.587, 0.114]
    if invert:
        grey = 255.0 - grey
    # percentiles of the pixels that are taken for black and for white
    black, white_at = np.percentile(grey, (1.0, 99.0))
    if white_at - black < 1.0:
        raise InputError(what, "it is all one grey, so there are no tones in it", "Use another.")
    return np.asarray(np.clip((white_at - grey) / (white_at - black), 0.0, 1.0))
