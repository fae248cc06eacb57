"""Whether a picture may just as well be meant the other way round, and the option that reads it so."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Mask
from knotfab.picture.ground import find_ends, is_of_one_colour
from knotfab.picture.ink import split_channels, take_border, takes_alpha
from knotfab.picture.raster import shrink, silhouette
from knotfab.picture.silhouette import (
    fill_holes,
    holes_of,
    keep_largest,
    mask_iou,
    opened_share,
    pieces_of,
)
from knotfab_formats.errors import InputError
from knotfab_formats.views import Box, Reading

OPTIONS = {
    "ink": "--ink",
    "threshold": "--threshold",
    "crop_px": "--crop",
    "speck_px": "--specks",
    "smooth_px": "--smooth",
    "keep_largest": "--keep-largest",
    "subject_px": "--subject",
}
_SIDE = 320  # px of the longer side at which readings are compared
_SHARED = 0.5  # IoU below which two readings show different things
_LIKELY = 0.5  # score of another reading, as a share of that of the reading taken, that counts
_PLAIN = 0.9  # share of a border that has one colour, from which it is the background
_SHEET = 0.15  # share of the picture that a sheet covers at least
_DRAWN = 0.01  # share of a sheet that a drawing on it covers at least
_MARGIN = 8  # px about what is drawn on a sheet
_SQUARE = 0.88  # share of its smallest rectangle that a sheet with round corners covers
_CONVEX = 0.95  # share of its hull that a sheet covers
_DIFFERS = 150  # levels, summed over the channels, by which a drawing differs from its paper
# levels, summed over the channels, by which paper is lighter than what is drawn on it
_LIGHTER = 300
# drawn share assumed for lines, of which a usual tube draws nothing and a thin one all
_LINES = 0.6
_LEAST_INK, _MOST_INK = 0.04, 0.7  # ink of a likely reading, as a share of the frame


@dataclass(frozen=True)
class Doubt:
    """Another reading of a picture that is about as likely as the one taken, with the view's keys for it.

    `iou` compares the two silhouettes.
    """

    keys: Mapping[str, Any]
    iou: float

    @property
    def sentence(self) -> str:
        """Say what is unsure, and which option gives the other reading."""
        return (
            f"what is meant is unsure: another reading, which shares {self.iou:.0%} with the one taken, may "
            f"be meant; {write_options(self.keys)} takes it"
        )


def is_guessed(notes: Sequence[str]) -> bool:
    """Return whether a picture's notes say that its ground or border merely suggested how to read it."""
    told = " ".join(notes)
    return any(word in told for word in ("--ink flood", "darkest spot", "a sheet of paper"))


def write_options(keys: Mapping[str, Any]) -> str:
    """Write keys of a view as options of `knotfab build`, quoted for a shell; "" if none has one."""
    words = []
    for key, value in keys.items():
        if key in OPTIONS and value is not None:
            plain = f"{value:g}" if isinstance(value, float) else str(value)
            words += [OPTIONS[key], plain.strip("()").replace(" ", "")]
    return shlex.join(words)


def find_doubt(
    image: Image.Image,
    mask: Mask,
    crop: Box | None,
    reading: Reading,
    notes: Sequence[str],
    size: tuple[int, int],
) -> Doubt | None:
    """Find the likeliest other reading, if it shows something else than the one taken and neither is sure.

    The reading taken is sure if somebody said how to read the picture, or if the drawing lies on a plain
    ground and is not itself a sheet.

    Args:
        image: as decoded, upright, perhaps shrunk. mask: the silhouette taken, at any size, of the picture's
            part `crop`. reading: what was asked for. notes: those of the reading taken. size: the picture's
            width and height.
    """
    plain = Reading()
    said = any(getattr(reading, key) != getattr(plain, key) for key in (*OPTIONS, "invert"))
    if said or reading.cut_out:
        return None
    if crop is not None:  # a frame was left out
        mask = _uncrop(mask, crop, (image.height, image.width))
    guessed = is_guessed(notes)
    every = 1 if image.mode.startswith(("I", "F")) else -(-max(image.size) // _SIDE)
    small = shrink(image, every) if every > 1 else image
    mask = np.asarray(Image.fromarray(mask).resize(small.size, Image.Resampling.NEAREST))
    if not mask.any():
        return None
    is_sheet, box = _find_sheet(mask, np.asarray(small.convert("RGB"), dtype=np.int64))
    if not (guessed or is_sheet or not _has_plain_border(small)):
        return None
    found = []
    for keys in _other_ways(small, box):
        try:
            (other, *_), crop = silhouette(small, "", reading.but(**keys))
        except InputError:
            continue
        if crop is not None:
            other = _uncrop(other, crop, mask.shape)
            keys = {"crop_px": _enlarge(crop, -(-size[0] // small.width), size)}
        shared = mask_iou(mask, other)
        if shared < _SHARED:
            found.append((rate_mask(other) * (2.0 if crop else 1.0), shared, keys))
    if not found:
        return None
    score, shared, keys = max(found, key=lambda one: one[0])
    return Doubt(keys, shared) if score >= _LIKELY * rate_mask(mask) else None


def _other_ways(image: Image.Image, box: Box | None) -> Iterator[dict[str, Any]]:
    """Yield keys of other readings."""
    if box:
        yield {"crop_px": box}
    inks = ["dark", "light", "flood"]
    yield from (
        {"ink": ink} for ink in [*inks, *(["alpha"] if image.has_transparency_data else [])]
    )


def _has_plain_border(image: Image.Image) -> bool:
    """Return whether a picture's ground is transparent, or its border of one colour."""
    colours, alpha = split_channels(image)
    if colours.dtype != np.uint8 or takes_alpha(colours, alpha, Reading()):
        return True
    return is_of_one_colour(take_border(colours), _PLAIN)


def _find_sheet(mask: Mask, rgb: NDArray[np.int64]) -> tuple[bool, Box | None]:
    """Return whether a silhouette may be a sheet that something is drawn on, and the box around that.

    A sheet is a rectangle, or any convex shape that is much lighter than what is drawn on it.
    """
    from scipy.ndimage import binary_erosion

    sheet = fill_holes(keep_largest(mask, 1), mask.size)
    inside = np.asarray(binary_erosion(sheet, np.ones((3, 3)), iterations=2))
    if sheet.mean() < _SHEET or not (inside & mask).any():
        return False, None
    paper = np.median(rgb[inside & mask], axis=0)
    left_out = inside & (np.abs(rgb - paper).sum(axis=2) > _DIFFERS)
    if left_out.sum() < _DRAWN * sheet.sum():
        return False, None
    hull = shapely.convex_hull(shapely.MultiPoint(find_ends(sheet)))
    lighter = (paper - rgb[left_out].mean(axis=0)).sum() >= _LIGHTER
    like = sheet.sum() / (hull.area if lighter else hull.minimum_rotated_rectangle.area)
    if like < (_CONVEX if lighter else _SQUARE):
        return False, None
    rows, columns = left_out.any(1).nonzero()[0], left_out.any(0).nonzero()[0]
    for margin in range(_MARGIN, 0, -1):  # which may not reach beyond the sheet
        x, y = (int(along[0]) - margin for along in (columns, rows))
        right, bottom = (int(along[-1]) + margin for along in (columns, rows))
        corners = [(v, u) for u in (x, right) for v in (y, bottom)]
        beyond = min(x, y) < 0 or right >= mask.shape[1] or bottom >= mask.shape[0]
        if not beyond and all(sheet[at] for at in corners):
            return True, (x, y, right + 1 - x, bottom + 1 - y)
    return True, None


def _uncrop(mask: Mask, crop: Box, shape: tuple[int, ...]) -> Mask:
    """Put a cropped mask back in its place in the whole picture."""
    left, top, width, height = crop
    whole = np.zeros(shape, dtype=bool)
    whole[top : top + height, left : left + width] = mask
    return whole


def _enlarge(box: Box, every: int, size: tuple[int, int]) -> Box:
    """Convert a box of the picture reduced by `every` to px of the whole one."""
    left, top = box[0] * every, box[1] * every
    return left, top, min(box[2] * every, size[0] - left), min(box[3] * every, size[1] - top)


def rate_mask(mask: Mask, lines: bool = False) -> float:
    """Rate from 0 to 1 how much a mask looks like one silhouette: compact, in few parts, off the edge."""
    share = float(mask.mean())
    edge = float(np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).mean())
    parts = len(pieces_of(mask)[1]) + len(holes_of(mask)[1])
    likely = min(share / _LEAST_INK, 1.0) * min((1.0 - share) / (1.0 - _MOST_INK), 1.0)
    kept = _LINES if lines else opened_share(mask)
    return kept * likely * (1.0 - 0.8 * edge) / (1.0 + 0.2 * float(np.log2(max(parts, 1))))
