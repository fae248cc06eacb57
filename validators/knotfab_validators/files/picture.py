"""Read the silhouette, greys and colours of a picture file, in its own pixels."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError
from scipy import ndimage

from knotfab_formats.disk import write_whole
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.files.colours import (
    common_colours,
    enclosed_by_largest,
    middle_of_bin,
    not_reached,
)

if TYPE_CHECKING:
    from knotfab_formats.views import Reading

FOUR = ndimage.generate_binary_structure(2, 1)  # pixels that share a side are joined
EIGHT = ndimage.generate_binary_structure(2, 2)  # pixels that touch at a corner are joined too

ROWS_AT_ONCE = 2**20  # pixels processed at a time
STRAY = 0.01  # the largest share of clear pixels that counts as an accident
CRISP = 128  # alpha from which a pixel counts as there, where alpha does not decide the silhouette
ENDS = 0.01  # the share of pixels clipped to black, and to white
BRIGHTNESS = np.array(
    [299, 587, 114]
)  # weights of red, green and blue in thousandths, ITU-R BT.601


class PictureError(ValueError):
    """A picture cannot be read; the message says which one and why."""


def _plain() -> Reading:
    from knotfab_formats.views import Reading

    return Reading()


def read_silhouette(path: str | PathLike[str], reading: Reading | None = None) -> Mask:
    """Read the silhouette (H, W) of a picture file, in the pixels of the picture, or of its crop.

    If the picture has transparency, these are the opaque pixels (alpha at least the threshold, of 255)
    without parts of other colours that the largest colour encloses. Otherwise they are the pixels whose
    colour differs from the border's (the median of the outermost pixels) by more than the threshold's share
    of the largest such difference. Differences are Euclidean in the file's own RGB or grey values. `reading`
    may ask for other ink, all but the ink, a part of the picture, its largest pieces, and no specks.

    Raises:
        PictureError: the file is missing, not a picture, damaged, or smaller than its crop.
    """
    reading = reading or _plain()
    with _opened(Path(path), reading) as image:
        mask = _select_ink(image, reading)
    if reading.invert:
        mask = ~mask
    if reading.speck_px:
        mask = _without_small(mask, reading.speck_px, EIGHT)
        mask = ~_without_small(~mask, reading.speck_px, FOUR, frame_counts=True)
    if reading.keep_largest:
        mask = _keep_largest(mask, reading.keep_largest)
    return mask


def read_colours(path: Path, size: tuple[int, int], drawn: tuple[int, int]) -> NDArray[np.uint8]:
    """Read a picture as sRGB (H, W, 3), over white if transparent, resampled to `size` (width, height).

    Args:
        drawn: width and height of the masks that it was taken apart into; it must be as large.

    Raises:
        PictureError: as `read_silhouette`, or it has another size.
    """
    with _opened(path, _plain()) as image:
        if image.size != drawn:
            raise PictureError(f"{path}: its size is {image.size}, that of the masks is {drawn}")
        rgba = image.convert("RGBA")
        whole = Image.new("RGBA", rgba.size, (255, 255, 255, 255))
        whole.alpha_composite(rgba)
        return np.asarray(whole.convert("RGB").resize(size, Image.Resampling.BOX))


@contextmanager
def _opened(picture: Path, reading: Reading) -> Iterator[Image.Image]:
    """Open a picture file, upright and cropped as `reading` says; all its errors are PictureErrors."""
    if picture.exists() and not picture.is_file():  # a pipe or a device may never end
        raise PictureError(f"{picture}: is not a plain file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of odd metadata; the pixels decide
            with Image.open(picture) as opened:
                opened.load()
                ImageOps.exif_transpose(opened, in_place=True)
                yield _cut(opened, reading, picture)
    except PictureError:
        raise
    except FileNotFoundError as error:
        raise PictureError(f"{picture}: there is no such file") from error
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise PictureError(f"{picture}: not a picture this reader knows ({error})") from error
    except (OSError, SyntaxError, ValueError) as error:
        raise PictureError(f"{picture}: damaged or unreadable ({error})") from error


def _cut(image: Image.Image, reading: Reading, picture: Path) -> Image.Image:
    if not reading.crop_px:
        return image
    left, top, width, height = reading.crop_px
    if left + width > image.width or top + height > image.height:
        raise PictureError(f"{picture}: crop_px reaches beyond the picture")
    return image.crop((left, top, left + width, top + height))


def _select_ink(image: Image.Image, reading: Reading) -> Mask:
    alpha: NDArray[np.uint8] | None = None
    if "A" in image.getbands() or "transparency" in image.info:
        alpha = np.asarray(image.convert("RGBA"))[..., 3]
        if (alpha == 255).all():
            alpha = None
        if image.mode not in ("I", "F") and not image.mode.startswith("I;"):
            image = image.convert("RGBA").convert("RGB")
    if image.mode in ("I", "F") or image.mode.startswith("I;"):
        values = np.asarray(image)[..., None]  # 16-bit grey keeps its depth
    elif image.mode in ("1", "L"):
        values = np.asarray(image.convert("L"))[..., None]
    else:
        values = np.asarray(image.convert("RGB"))
    stray: Mask | None = None
    if alpha is not None and reading.ink == "auto" and _is_stray(values, alpha, reading):
        stray, alpha = alpha < 255 * reading.threshold, None
    if alpha is not None and reading.ink in ("auto", "alpha"):
        opaque = alpha >= 255 * reading.threshold
        if reading.ink == "alpha" or values.dtype != np.uint8 or not opaque.any():
            return np.asarray(opaque)
        rgb = np.broadcast_to(values, (*opaque.shape, 3))
        return np.asarray(opaque & ~enclosed_by_largest(rgb, opaque))
    there = np.ones(values.shape[:2], dtype=bool) if alpha is None else alpha >= CRISP
    share = reading.threshold**2
    if reading.ink in ("auto", "alpha"):
        border = _border_colours(values)
        return _mark_far(values, [np.median(border.astype(np.float64), axis=0)], share, stray)
    if reading.ink == "flood":
        if values.dtype != np.uint8:
            values = (values >> 8).astype(np.uint8)
        rgb = np.broadcast_to(values, (*values.shape[:2], 3))
        colours = [middle_of_bin(bin) for bin in common_colours(_border_colours(rgb))[0]]
        return there & not_reached(_mark_far(rgb, colours, share))
    if reading.ink in ("dark", "light"):
        return _by_brightness(values, there, reading)
    code = int(reading.ink.removeprefix("#"), 16)
    colour = np.array([code >> 16, code >> 8 & 255, code & 255], dtype=np.float64)
    if values.shape[2] == 1:
        values = np.repeat(values / (1 if values.dtype == np.uint8 else 257), 3, axis=2)
    away = np.concatenate([_squares(values[rows], colour) for rows in _row_blocks(values)])
    largest = away[there].max()
    return np.asarray(there & ((away < share * largest) | (largest == 0)))


def _is_stray(values: NDArray[Any], alpha: NDArray[np.uint8], reading: Reading) -> bool:
    """Return whether at most a hundredth of the pixels is clear, and the others show a shape anyway."""
    clear = alpha < 255 * reading.threshold
    if not clear.any():
        return True
    if clear.sum() > STRAY * clear.size:
        return False
    seen = values[~clear].astype(np.int64)
    return bool((seen.max(axis=0) - seen.min(axis=0)).max() > 8)


def _border_colours(values: NDArray[Any]) -> NDArray[Any]:
    """Return the distinct pixel values along the frame, (n, channels)."""
    return np.concatenate([values[0], values[-1], values[1:-1, 0], values[1:-1, -1]])


def _mark_far(
    values: NDArray[Any], colours: list[Array], share: float, never: Mask | None = None
) -> Mask:
    """Mark pixels whose squared distance from the nearest of `colours` exceeds a share of the largest one."""
    rows = [
        np.min([_squares(values[block], colour) for colour in colours], axis=0)
        for block in _row_blocks(values)
    ]
    away = np.concatenate(rows)
    if never is not None:
        away[never] = 0
    return np.asarray(away > share * float(away.max()))


def _by_brightness(values: NDArray[Any], there: Mask, reading: Reading) -> Mask:
    """Mark the darker (or lighter) pixels; clear ones are never marked."""
    if values.shape[2] == 1:
        bright, most = values[..., 0].astype(np.int64), 255 if values.dtype == np.uint8 else 65535
    else:
        bright = values.astype(np.int64) @ BRIGHTNESS
        most = 255 * int(BRIGHTNESS.sum())
    dark = reading.ink == "dark"
    bright[~there] = most if dark else 0
    low, high = int(bright.min()), int(bright.max())
    if dark:
        return np.asarray(bright < low + reading.threshold * (high - low))
    return np.asarray(bright > high - reading.threshold * (high - low))


def _without_small(mask: Mask, least: int, joined: Mask, frame_counts: bool = False) -> Mask:
    """Remove components of fewer than `least` pixels; those at the frame stay if `frame_counts`."""
    parts, count = ndimage.label(np.pad(mask, 1, constant_values=frame_counts), joined)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    stays = sizes >= least
    stays[0] = False
    if frame_counts:
        stays[parts[0, 0]] = True
    return np.asarray(stays[parts])[1:-1, 1:-1]


def _keep_largest(mask: Mask, count: int) -> Mask:
    """Keep the `count` largest components; among equals, those that come first row by row."""
    parts, found = ndimage.label(mask, EIGHT)
    sizes = np.bincount(parts.ravel(), minlength=found + 1)[1:]
    by_size = sorted(range(1, found + 1), key=lambda part: (-sizes[part - 1], part))
    return np.isin(parts, by_size[:count])


def _row_blocks(values: NDArray[Any]) -> list[slice]:
    """Split the rows into blocks, to bound the memory: a picture may have 8000 x 8000 pixels."""
    step = max(1, ROWS_AT_ONCE // values.shape[1])
    return [slice(i, i + step) for i in range(0, len(values), step)]


def _squares(values: NDArray[Any], colour: Array) -> NDArray[np.floating[Any]]:
    # single precision is exact for 8 bits: four times a sum of squares stays below 2**24
    kind = np.float32 if values.dtype == np.uint8 else np.float64
    total = np.zeros(values.shape[:2], dtype=kind)
    for channel, middle in enumerate(colour.astype(kind)):
        difference = values[..., channel] - middle
        total += difference * difference
    return total


# Thin strokes are widened as a scene's `thicken_mm` asks (docs/silhouette.md).


def widen_strokes(mask: Mask, width_px: float) -> Mask:
    """Draw a disc of diameter `width_px` at each point of the middle lines of the mask's thin strokes.

    A stroke is what no such disc inside the mask covers, where it goes further from what they cover than
    half the width. On its middle line no neighbour lies 0.7 px further in.
    """
    from scipy import ndimage

    half = width_px / 2
    depth: Array = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    depth[~mask] = 0.0
    covered = _mark_within(depth >= half, half)
    strokes, found = ndimage.label(mask & ~covered, np.ones((3, 3)))
    beyond = ~_mark_within(covered, half)
    middle = np.zeros_like(mask)
    for number, box in enumerate(ndimage.find_objects(strokes, found), start=1):
        stroke = strokes[box] == number
        if not (stroke & beyond[box]).any():
            continue
        wide = tuple(slice(max(0, s.start - 1), s.stop + 1) for s in box)
        further = ndimage.grey_dilation(depth[wide], size=(3, 3))
        line = (strokes[wide] == number) & (depth[wide] > further - 0.7)  # px
        middle[wide] |= line
    return np.asarray(mask | _mark_within(middle, half))


def _mark_within(mask: Mask, reach: float) -> Mask:
    """Mark pixels whose centre is at most `reach` from one of the mask."""
    from scipy import ndimage

    if not mask.any():
        return mask
    return np.asarray(ndimage.distance_transform_edt(~mask) <= reach)


def write_image(path: Path, image: Image.Image) -> None:
    """Write a PNG whole or not at all."""
    content = io.BytesIO()
    image.save(content, "PNG")
    write_whole(path, content.getvalue())
