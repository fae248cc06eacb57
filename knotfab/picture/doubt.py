"""Whether a picture may just as well be meant otherwise, and the option that reads it so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Mask
from knotfab.picture.ground import find_ends, is_of_one_colour
from knotfab.picture.ink import find_ink, split_channels, take_border, takes_alpha
from knotfab.picture.raster import own_box, shrink
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

UNSURE = "what is meant is unsure"
_SIDE = 320  # px of the longer side at which readings are compared
_SHARED = 0.5  # IoU below which two readings show different things
_LIKELY = 0.5  # score of another reading, as a share of that of the reading taken, that counts
_PLAIN = 0.9  # share of a border that has one colour, from which it is the background
_SHEET = 0.15  # share of the picture that a sheet covers at least
_DRAWN = 0.01  # share of a sheet that a drawing on it covers at least
# levels, summed over the channels, by which paper is lighter than what is drawn on it
_LIGHTER = 300
_SQUARE = 0.9  # share of its hull, or of its rectangle if it is not so light, that a sheet covers
_LEAST_INK, _MOST_INK = 0.04, 0.7  # ink of a likely reading, as a share of the frame


def tell_other_reading(image: Image.Image, mask: Mask) -> tuple[str, ...]:
    """Return a note with the option for the likeliest other reading, if neither is sure.

    The one taken is sure if the drawing lies on a ground of one colour and is not itself a sheet.

    Args:
        image: as decoded, upright. mask: the silhouette taken of all of it.
    """
    every = 1 if image.mode.startswith(("I", "F")) else -(-max(image.size) // _SIDE)
    small = shrink(image, every) if every > 1 else image
    mask = np.asarray(Image.fromarray(mask).resize(small.size, Image.Resampling.NEAREST))
    if not mask.any():
        return ()
    is_sheet, box = _find_sheet(mask, np.asarray(small.convert("RGB"), dtype=np.int64))
    if box is not None:
        crop = ",".join(str(every * side) for side in box)
        return (f"it may be a sheet that something is drawn on: --crop {crop} reads that alone",)
    if not is_sheet and _has_plain_ground(small):
        return ()
    likely = _LIKELY * _rate(mask)
    best, shared = None, 0.0
    for ink, other in _read_otherwise(small):
        alike = mask_iou(mask, other)
        if alike < _SHARED and (score := _rate(other)) >= likely:
            best, shared, likely = ink, alike, score
    if best is None:
        return ()
    return (f"{UNSURE}: --ink {best} reads it otherwise, and shares {shared:.0%} with this",)


def _read_otherwise(image: Image.Image) -> Iterator[tuple[str, Mask]]:
    for ink in ("dark", "light", "flood", "alpha"):
        try:
            yield ink, find_ink(image, Reading(ink=ink), "").mask
        except InputError:
            continue


def _has_plain_ground(image: Image.Image) -> bool:
    """Return whether a picture's ground is transparent, or its border of one colour."""
    colours, alpha = split_channels(image)
    if colours.dtype != np.uint8 or takes_alpha(colours, alpha, Reading()):
        return True
    return is_of_one_colour(take_border(colours), _PLAIN)


def _find_sheet(mask: Mask, rgb: NDArray[np.int64]) -> tuple[bool, Box | None]:
    """Return whether a silhouette may be a sheet that something is drawn on, and the box about that.

    A sheet is a rectangle, or any convex shape that is much lighter than what is drawn on it.
    """
    sheet = fill_holes(keep_largest(mask, 1), mask.size)
    drawn = sheet & ~mask
    if sheet.mean() < _SHEET or drawn.sum() < _DRAWN * sheet.sum():
        return False, None
    hull = shapely.convex_hull(shapely.MultiPoint(find_ends(sheet)))
    lighter = (np.median(rgb[mask], axis=0) - rgb[drawn].mean(axis=0)).sum() >= _LIGHTER
    like = sheet.sum() / (hull.area if lighter else hull.minimum_rotated_rectangle.area)
    if like < _SQUARE:
        return False, None
    left, top, width, height = box = own_box(drawn)
    corners = sheet[top : top + height : height - 1, left : left + width : width - 1]
    return True, box if corners.all() else None  # none in a round sheet that its picture fills


def _rate(mask: Mask) -> float:
    """Rate from 0 to 1 how much a mask looks like one silhouette: compact, in few parts, off the edge."""
    share = float(mask.mean())
    edge = float(np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).mean())
    parts = len(pieces_of(mask)[1]) + len(holes_of(mask)[1])
    likely = min(share / _LEAST_INK, 1.0) * min((1.0 - share) / (1.0 - _MOST_INK), 1.0)
    return (
        opened_share(mask)
        * likely
        * (1.0 - 0.8 * edge)
        / (1.0 + 0.2 * float(np.log2(max(parts, 1))))
    )
