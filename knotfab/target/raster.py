"""Pixel pictures: decode a file's bytes safely and take the silhouette by the contract's rule."""

from __future__ import annotations

import io
import warnings

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from knotfab.arrays import Mask
from knotfab.errors import InputError

__all__ = ["LARGEST_SIDE", "SMALLEST_SIDE", "SUFFIXES", "decode", "looks_like_raster", "silhouette"]

Levels = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.int32]

SMALLEST_SIDE = 16
LARGEST_SIDE = 8000

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
_ROWS = 512  # rows handled at once where colours are compared, to bound the memory


def looks_like_raster(data: bytes) -> bool:
    """Whether the first bytes are those of a pixel format that can be read."""
    return data.startswith(_BEGINNINGS) or (data[:4] == b"RIFF" and data[8:12] == b"WEBP")


def _check_size(what: str, width: int, height: int, smallest: int) -> None:
    if max(width, height) > LARGEST_SIDE:
        raise InputError(
            what,
            f"it is {width} x {height} pixels, more than {LARGEST_SIDE} on a side",
            f"Scale it down to at most {LARGEST_SIDE} pixels on the longer side.",
        )
    if min(width, height) < smallest:
        raise InputError(
            what,
            f"it is {width} x {height} pixels, less than {smallest} on a side",
            f"Use a picture of at least {smallest} x {smallest} pixels, better about 1000.",
        )


def decode(data: bytes, what: str, *, smallest: int = SMALLEST_SIDE) -> tuple[Image.Image, str]:
    """Decode a pixel picture, turned upright by its EXIF tag.

    Args:
        data: the file's bytes.
        what: how an error names the picture.
        smallest: fewest pixels allowed on a side.

    Returns:
        The first frame, in its own mode, and Pillow's name of the format.

    Raises:
        InputError: unknown format, damaged data, or a size outside 16 .. 8000 pixels on a side
            (checked before any pixel is decoded).
    """
    with warnings.catch_warnings():
        # Pillow warns of large pictures and odd metadata; sizes are checked here instead.
        warnings.simplefilter("ignore")
        try:
            image = Image.open(io.BytesIO(data), formats=_FORMATS)
        except Image.DecompressionBombError as error:
            raise InputError(
                what,
                f"it has more than {LARGEST_SIDE} pixels on a side",
                f"Scale it down to at most {LARGEST_SIDE} pixels on the longer side.",
            ) from error
        except Exception as error:  # Pillow's plug-ins raise many kinds on damaged headers
            raise InputError(
                what,
                f"it is not a picture that can be read (a damaged file, or not {_READABLE})",
                f"Save or export the picture as {_READABLE} and try again.",
            ) from error
        _check_size(what, *image.size, smallest)
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


def _split_channels(image: Image.Image) -> tuple[Levels, Mask | None]:
    """Colours (H, W) or (H, W, 3), and where it is opaque (None without any transparency)."""
    key = image.info.get("transparency")
    if image.mode.startswith("I"):  # 16-bit grey, kept at full precision
        grey = np.asarray(image)
        opaque = grey != key if isinstance(key, int) else None
        return grey, None if opaque is None or opaque.all() else opaque
    if image.mode in ("L", "1") and key is None:
        return np.asarray(image.convert("L")), None
    if key is not None or image.mode in ("LA", "La", "PA", "RGBA", "RGBa"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rgba = np.asarray(image.convert("RGBA"))
        if rgba[..., 3].min() == 255:
            return rgba[..., :3], None
        return rgba[..., :3], rgba[..., 3] >= 128
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB")), None


def _take_border(colours: Levels) -> Levels:
    """(n, channels) the outermost pixels, each once."""
    rows = [colours[0], colours[-1], colours[1:-1, 0], colours[1:-1, -1]]
    channels = 1 if colours.ndim == 2 else colours.shape[2]
    return np.concatenate([r.reshape(-1, channels) for r in rows])


def _differs_from_border(colours: Levels, what: str) -> Mask:
    """Pixels that differ from the border's median colour by more than half the largest difference.

    The difference of two colours is Euclidean, compared squared. Pixel values and half-integer
    medians are squared exactly, so levels on either side of the half fall where they belong.
    """
    middle = np.median(_take_border(colours), axis=0)
    height = colours.shape[0]
    squared = np.empty(colours.shape[:2], dtype=np.float32 if colours.ndim == 3 else np.float64)
    for top in range(0, height, _ROWS):
        # 8-bit values: doubled differences squared and summed stay below 2^24, exact in float32.
        part = colours[top : top + _ROWS].astype(squared.dtype)
        part = part.reshape(*part.shape[:2], -1) - middle.astype(squared.dtype)
        squared[top : top + _ROWS] = np.einsum("ijk,ijk->ij", part, part)
    largest = float(squared.max())
    if largest == 0.0:
        raise InputError(
            what,
            "it is all one colour, so there is no shape in it",
            "Use a picture whose shape differs from its background, or one with transparency.",
        )
    return np.asarray(squared > largest / 4.0)


def silhouette(image: Image.Image, what: str, *, invert: bool = False) -> Mask:
    """The silhouette of a decoded picture, by the contract's rule.

    Where the picture has transparency (any pixel less than opaque): its opaque pixels, alpha at
    least half. Otherwise: the pixels that differ from the border's colour (median of the outermost
    pixels, channel by channel) by more than half of the largest difference.

    Args:
        image: upright, as `decode` gives it.
        what: how an error names the picture.
        invert: swap shape and background.

    Returns:
        (H, W) bool, row 0 at the top, True where the shape is.

    Raises:
        InputError: no shape, nothing but specks, or a shape that fills the whole frame.
    """
    colours, opaque = _split_channels(image)
    if opaque is not None and not opaque.any():
        raise InputError(
            what,
            "it is transparent everywhere, so there is no shape in it",
            "Use a picture with opaque pixels where the shape is.",
        )
    mask = _differs_from_border(colours, what) if opaque is None else opaque
    if invert:
        mask = ~mask
    _check_shape(mask, what)
    return mask


def _check_shape(mask: Mask, what: str) -> None:
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
        from scipy import ndimage

        labels, _ = ndimage.label(mask, structure=np.ones((3, 3), dtype=bool))
        largest = int(np.bincount(labels.ravel())[1:].max())
    if largest < smallest:
        raise InputError(
            what,
            f"its largest piece covers {largest} of {mask.size} pixels, too little to be drawn",
            "Crop the picture closer to the shape, or use a larger shape.",
        )
