"""Measure how well each piece and hole of a picture is drawn, and find specks of light and rows of text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.outlines import depth_in
from knotfab_validators.shadows.topology import (
    Box,
    Change,
    close_slits,
    crop_to_ink,
    find_widest,
    label_regions,
    move_change,
)

Feature = Literal["piece", "hole"]
AROUND = 8.0  # reaches: how far from a piece the shadow may still belong to it
RADIUS = 4.0  # the tube's radius in reaches


@dataclass(frozen=True)
class Shape(Change):
    """A piece or a hole of the picture that is there, but drawn out of shape.

    `of` tells which of the two it is; `likeness` is its IoU, from 0 to 1.
    """

    of: Feature
    likeness: float


def find_misshapen(
    shadow: Mask, target: Mask, reach_px: float, least: float, lost: Sequence[Change] = ()
) -> list[Shape]:
    """Find the pieces and holes whose likeness in picture and shadow is below `least`, worst first.

    The likeness is the IoU of a piece with the nearest part of the shadow, no farther than `AROUND`
    reaches; an outline off by at most a reach counts as right. A piece no wider than the tube's
    radius is a stroke that the tube covers, so its outline may be off by as much more as the tube
    stands out. Holes no wider than that are slits and pinholes that nobody sees, and are ignored.

    Args:
        shadow, target: (H, W), on one grid.
        reach_px: harmless error of an outline, a quarter of the tube's radius.
        least: from 0 to 1.
        lost: what is counted as lost already.
    """
    cropped = crop_to_ink(shadow, target, AROUND * reach_px)
    if cropped is None:
        return []
    seen, wanted, corner = cropped
    gone = {(c.kind, c.box) for c in lost}
    compared = (
        *_compare("piece", seen, wanted, reach_px),
        *_compare("hole", ~seen, ~wanted, reach_px),
    )
    found = [move_change(shape, *corner) for shape in compared if shape.likeness < least]
    there = (shape for shape in found if (shape.of, shape.box) not in gone)
    return sorted(there, key=lambda shape: shape.likeness)


def _compare(of: Feature, has: Mask, wants: Mask, reach: float) -> Iterator[Shape]:
    """Yield the likeness of every piece of `wants`, or of every hole that is wide enough."""
    from scipy.ndimage import distance_transform_edt

    labels, found = label_regions(of, wants, reach)
    if not found:
        return
    away, (i, j) = distance_transform_edt(~wants, return_indices=True)
    nearest, missing = labels[i, j], depth_in(~has)
    margin = int(np.ceil(AROUND * reach)) + 1
    for number, box in found:
        left, top, right, bottom = box
        rows = slice(max(top - margin, 0), bottom + margin)
        window = rows, slice(max(left - margin, 0), right + margin)
        own = labels[window] == number
        (u, v), width = find_widest(own)
        slack = reach
        if width <= RADIUS * reach:
            if of == "hole":
                continue
            slack += RADIUS * reach - width / 2
        around = (nearest[window] == number) & (away[window] <= AROUND * reach)
        drawn = has[window] & around
        off = (drawn & (away[window] > slack)) | (own & (missing[window] > slack))
        where = u + window[1].start, v + window[0].start
        likeness = 1 - float(off.sum()) / float((drawn | own).sum())
        yield Shape("shape", where, width, box, of, likeness)


# Visible specks and slits of light in a shadow, under the lamp that the scene has.

SEEN = 0.15  # share of the wall's full light that makes a speck visible at its brightest
LEAST_MM2 = 0.25  # the smallest speck: half a millimetre square


@dataclass(frozen=True)
class Specks:
    """The number of specks, their total area and the largest, mm² on the wall, and its place (u, v)."""

    count: int = 0
    area_mm2: float = 0.0
    largest_mm2: float = 0.0
    at: tuple[float, float] = (0.0, 0.0)


def find_specks(
    shadow: Mask, target: Mask, slit_px: float, reach_px: float, blur_px: float, pixel_mm: float
) -> Specks:
    """Find the specks of light that a person sees where the picture is dark.

    A speck is light that closing the shadow by `slit_px` covers, deeper than `reach_px` inside the
    picture: a pinhole or a slit, but neither a tip that is cut off nor an outline that is off. The
    lamp's penumbra blurs it; its remaining peak brightness decides whether it is seen.

    Args:
        shadow, target: (H, W), on one grid.
        blur_px: the width of the lamp's penumbra. pixel_mm: on the wall.
    """
    from scipy.ndimage import center_of_mass, gaussian_filter, label, maximum

    cropped = crop_to_ink(shadow, target, 2 * slit_px)
    if cropped is None:
        return Specks()
    seen, wanted, (left, top) = cropped
    light = close_slits(seen, slit_px) & ~seen & (depth_in(wanted) > reach_px)
    labels, count = label(light, np.ones((3, 3)))
    if not count:
        return Specks()
    # standard deviation of a disc that blurs over `blur_px`
    soft = gaussian_filter(light.astype(np.float32), blur_px / 4, truncate=3.0)
    number = np.arange(1, count + 1)
    areas = np.bincount(labels.ravel())[1:] * pixel_mm**2
    bright = np.asarray(maximum(soft, labels, number))
    kept = number[(areas >= LEAST_MM2) & (bright >= SEEN)]
    if not len(kept):
        return Specks()
    largest = int(kept[areas[kept - 1].argmax()])
    v, u = center_of_mass(labels == largest)
    own = areas[kept - 1]
    return Specks(len(kept), float(own.sum()), float(own.max()), (float(u) + left, float(v) + top))


# Rows of small pieces, which a person reads as text.

LEAST = 3  # pieces in a row
TALLEST = 1 / 16  # share of the frame's longer side: larger letters count as drawings
APART = 1.2  # heights between neighbours: the space between words
ALIKE = 2.5  # the larger height over the smaller one
MOST = 2000  # small pieces: a picture with more is noise
FILLED = 0.88  # share of its box that a window fills, but few letters do
OVERLAP = 0.5  # share of the smaller height that two neighbours must have in common
SAME = 0.7  # IoU of two pieces, box over box, from which they have the same shape
REPEATED = 0.8  # share of pieces of one shape that makes a row a pattern, such as stars or beads
SHAPE_PX = 12  # px to a side when shapes are compared


@dataclass(frozen=True)
class Row:
    """The bounding box of a row, its number of pieces, and whether these are letters rather than windows.

    `repeated` says that most have one shape, as stars and beads do, which are small like letters but no text.
    """

    box: Box
    pieces: int
    text: bool = True
    repeated: bool = False


def find_rows(boxes: Sequence[Box], longer_px: float, picture: Mask | None = None) -> list[Row]:
    """Find the rows of at least three small pieces side by side.

    Args:
        boxes: boxes of the pieces of a picture. longer_px: the longer side of its frame.
        picture: (H, W); where most pieces of a row fill their boxes, as windows do, it is no text.
    """
    small = sorted(b for b in boxes if b[3] - b[1] <= TALLEST * longer_px)
    if len(small) > MOST:
        return []
    rows: list[list[Box]] = []
    for box in small:
        beside = [row for row in rows if any(_neighbours(other, box) for other in row[-4:])]
        joined = [b for row in beside for b in row] + [box]
        rows = [row for row in rows if row not in beside] + [sorted(joined)]
    return [
        Row(_bound(row), len(row), _is_text(row, picture), _is_repeated(row, picture))
        for row in rows
        if len(row) >= LEAST
    ]


def _is_text(row: Sequence[Box], picture: Mask | None) -> bool:
    if picture is None:
        return True
    shares = [float(picture[top:bottom, left:right].mean()) for left, top, right, bottom in row]
    full = sum(max(share, 1.0 - share) >= FILLED for share in shares)
    return full < 0.7 * len(row)  # with this share of box-filling pieces, a row consists of windows


def _is_repeated(row: Sequence[Box], picture: Mask | None) -> bool:
    """Return whether most pieces have the shape of the middle one."""
    if picture is None:
        return False
    shapes = [_sample(box, picture) for box in row]
    like = shapes[len(shapes) // 2]
    same = sum((one & like).sum() >= SAME * max((one | like).sum(), 1) for one in shapes)
    return bool(same >= REPEATED * len(shapes))


def _sample(box: Box, picture: Mask) -> Mask:
    """Resample a box of the picture to a square grid."""
    left, top, right, bottom = box
    part = (np.arange(SHAPE_PX) + 0.5) / SHAPE_PX
    rows, columns = (low + part * (high - low) for low, high in ((top, bottom), (left, right)))
    return np.asarray(picture[np.ix_(rows.astype(int), columns.astype(int))])


def _neighbours(left: Box, right: Box) -> bool:
    one, other = left[3] - left[1], right[3] - right[1]
    low, high = min(one, other), max(one, other)
    shared = min(left[3], right[3]) - max(left[1], right[1])
    alike = high <= ALIKE * low and shared >= OVERLAP * low
    return alike and right[0] - left[2] <= APART * high


def _bound(boxes: Sequence[Box]) -> Box:
    lefts, tops, rights, bottoms = zip(*boxes, strict=True)
    return min(lefts), min(tops), max(rights), max(bottoms)
