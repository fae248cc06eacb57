"""Pixel pictures: decode a file's bytes safely and take the silhouette by the contract's rule."""

from __future__ import annotations

import io
import warnings

import numpy as np
from PIL import Image, ImageOps

from knotfab.arrays import Mask
from knotfab.errors import InputError
from knotfab.scene.model import Box, Reading
from knotfab.target.ink import find_ink
from knotfab.target.masks import drop_specks, keep_largest, pieces_of

__all__ = [
    "LARGEST_SIDE",
    "MARGIN",
    "SMALLEST_SIDE",
    "SUFFIXES",
    "check_shape",
    "count_frames",
    "decode",
    "looks_like_raster",
    "own_box",
    "shrink",
    "shrink_factor",
    "silhouette",
]

SMALLEST_SIDE = 16
LARGEST_SIDE = 8000
_GLANCE = 1280  # px of a longer side that tell what a tube makes of a picture; a verdict takes 1024
_LEAST = 200  # px of a shorter side that are left at a glance
MARGIN = 0.06  # clear space about a drawing in parts of the frame's longer side

# What Pillow calls each format that is read, and the suffixes its files carry, the usual one first.
SUFFIXES: dict[str, tuple[str, ...]] = {
    "PNG": (".png", ".apng"),
    "JPEG": (".jpg", ".jpeg", ".jpe", ".jfif"),
    "MPO": (".jpg", ".jpeg", ".mpo"),
    "WEBP": (".webp",),
    "BMP": (".bmp", ".dib"),
    "GIF": (".gif",),
}
_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF")
_READABLE = "PNG, JPEG, WebP, BMP, GIF or SVG"
_BEGINNINGS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"GIF87a", b"GIF89a", b"BM")


def looks_like_raster(data: bytes) -> bool:
    """Whether the first bytes are those of a pixel format that can be read."""
    return data.startswith(_BEGINNINGS) or (data[:4] == b"RIFF" and data[8:12] == b"WEBP")


def _check_size(
    what: str, width: int, height: int, smallest: int, largest: int = LARGEST_SIDE
) -> None:
    if max(width, height) > largest:
        raise InputError(
            what,
            f"it is {width} x {height} pixels, more than {largest} on a side",
            f"Scale it down to at most {largest} pixels on the longer side.",
        )
    if min(width, height) < smallest:
        raise InputError(
            what,
            f"it is {width} x {height} pixels, less than {smallest} on a side",
            f"Use a picture of at least {smallest} x {smallest} pixels, better about 1000.",
        )


def decode(
    data: bytes, what: str, *, smallest: int = SMALLEST_SIDE, largest: int = LARGEST_SIDE
) -> tuple[Image.Image, str]:
    """Decode a pixel picture, turned upright by its EXIF tag.

    Args:
        data: the file's bytes.
        what: how an error names the picture.
        smallest, largest: pixels allowed on a side.

    Returns:
        The first frame, in its own mode, and Pillow's name of the format.

    Raises:
        InputError: unknown format, damaged data, or a size outside what is allowed (checked before any
            pixel is decoded).
    """
    with warnings.catch_warnings():
        # Pillow warns of large pictures and odd metadata; sizes are checked here instead.
        warnings.simplefilter("ignore")
        try:
            image = Image.open(io.BytesIO(data), formats=_FORMATS)
        except Image.DecompressionBombError as error:
            raise InputError(
                what,
                f"it has more than {largest} pixels on a side",
                f"Scale it down to at most {largest} pixels on the longer side.",
            ) from error
        except Exception as error:  # Pillow's plug-ins raise many kinds on damaged headers
            raise InputError(
                what,
                f"it is not a picture that can be read (a damaged file, or not {_READABLE})",
                f"Save or export the picture as {_READABLE} and try again.",
            ) from error
        _check_size(what, *image.size, smallest, largest)
        kind = str(image.format)
        try:
            image.load()
            upright = ImageOps.exif_transpose(image)
        except Exception as error:
            raise InputError(
                what,
                f"the {kind} data is damaged or cut short",
                "Copy or export the file again.",
            ) from error
    return upright, kind


def shrink_factor(image: Image.Image) -> int:
    """How many px across may become one where a picture is only glanced at."""
    deep = image.mode.startswith(("I", "F"))  # which Pillow does not reduce
    return 1 if deep else min(-(-max(image.size) // _GLANCE), max(1, min(image.size) // _LEAST))


def shrink(image: Image.Image, factor: int) -> Image.Image:
    """The means of squares of px."""
    if image.mode not in ("L", "LA", "RGB", "RGBA"):
        image = image.convert("RGBA" if image.has_transparency_data else "RGB")
    return image.reduce(factor)


def count_frames(data: bytes) -> int:
    """Frames of a pixel picture that `decode` can read; 1 where it does not move."""
    with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
        return int(getattr(image, "n_frames", 1))


def silhouette(
    image: Image.Image, what: str, reading: Reading, shrunk: int = 1
) -> tuple[Mask, str, Box | None]:
    """The silhouette of a decoded picture, by the rules of docs/silhouette.md.

    Cropped first; then the ink, inverted where that is asked for, its largest pieces, without specks.

    Args:
        image: upright, as `decode` gives it.
        what: how an error names the picture.
        shrunk: so many px of the picture, across, are one of `image`; `reading` is in px of the picture.

    Returns:
        (H, W) bool of the cropped picture, row 0 at the top, True where the shape is; the rule in words;
        and the crop in px (left, top, width, height), None where there is none.

    Raises:
        InputError: no shape, nothing but specks, or a shape that fills the whole frame.
    """
    box = None if reading.crop_px == "none" else reading.crop_px
    if box == "auto":
        whole, *_ = silhouette(image, what, reading.model_copy(update={"crop_px": "none"}))
        box = own_box(whole)
    if box is not None:
        image = _crop(image, box, what)
    mask, rule = find_ink(image, reading, what)
    if reading.invert:
        mask, rule = ~mask, f"all but {rule}"
    if reading.speck_px:
        mask = drop_specks(mask, round(reading.speck_px / shrunk**2))
        rule += f"; without specks of less than {reading.speck_px} px"
    if reading.keep_largest:
        mask = keep_largest(mask, reading.keep_largest)
        count = reading.keep_largest
        rule += (
            "; of that the largest piece" if count == 1 else f"; of that the {count} largest pieces"
        )
    if box is not None:
        rule += "; in the picture from ({}, {}), {} x {} px".format(*box)
    check_shape(mask, what)
    return mask, rule, box


def own_box(mask: Mask) -> Box:
    """The box of a silhouette with a margin about it, as far as the picture reaches."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    height, width = mask.shape
    longer = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    margin = max(2, round(longer * MARGIN / (1 - 2 * MARGIN)), (SMALLEST_SIDE - longer + 1) // 2)
    left, top = max(0, int(columns[0]) - margin), max(0, int(rows[0]) - margin)
    right = min(width, int(columns[-1]) + 1 + margin)
    bottom = min(height, int(rows[-1]) + 1 + margin)
    return left, top, right - left, bottom - top


def _crop(image: Image.Image, box: Box, what: str) -> Image.Image:
    left, top, width, height = box
    if left + width > image.width or top + height > image.height:
        raise InputError(
            what,
            f"a crop of {width} x {height} px from ({left}, {top}) reaches beyond its "
            f"{image.width} x {image.height} px",
            "Give left, top, width and height in px of the picture, or --crop auto.",
        )
    _check_size(f"{what}, cropped,", width, height, SMALLEST_SIDE)
    return image.crop((left, top, left + width, top + height))


def check_shape(mask: Mask, what: str) -> None:
    """Reject what no tube can draw: a full frame, an empty one, nothing but specks."""
    area = int(np.count_nonzero(mask))
    if area == mask.size:
        raise InputError(
            what,
            "the shape fills the whole frame, so there is no outline",
            "Leave some background around the shape, or turn it with --invert if the shape is "
            "what was taken for background.",
        )
    smallest = max(2.0, 1e-4 * mask.size)
    largest = area
    if smallest <= area < mask.size // 50:  # more cannot be made of specks alone in a real picture
        largest = int(pieces_of(mask)[1].max())
    if largest < smallest:
        raise InputError(
            what,
            f"its largest piece covers {largest} of {mask.size} pixels, too little to be drawn",
            "Crop the picture closer to the shape, or use a larger shape.",
        )
