"""Rows of small pieces, which are text to whoever looks at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.topology import Box

__all__ = ["Row", "find_rows"]

LEAST = 3  # pieces in a row
TALLEST = 1 / 16  # a share of the frame's longer side: larger letters are drawings of letters
APART = 1.2  # heights between neighbours: the space between words
ALIKE = 2.5  # the larger height over the smaller
MOST = 2000  # small pieces: with more the picture is noise
FILLED = 0.88  # a share of its box that a window fills and few letters do
OVERLAP = 0.5  # a share of the smaller height that two neighbours have in common
SAME = 0.7  # IoU of two pieces, box laid on box, from which on they are one shape
REPEATED = 0.8  # a row with this share of pieces of one shape is a pattern, such as stars or beads
SHAPE_PX = 12  # px to a side when shapes are compared


@dataclass(frozen=True)
class Row:
    """The box about a row, how many pieces it has, and whether these are letters, and not windows.

    `repeated` says that most have one shape, as stars and beads do: as small as letters, and no text.
    """

    box: Box
    pieces: int
    text: bool = True
    repeated: bool = False


def find_rows(boxes: Sequence[Box], longer_px: float, picture: Mask | None = None) -> list[Row]:
    """Find the rows of three or more small pieces that stand side by side.

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
        Row(_around(row), len(row), _is_text(row, picture), _is_repeated(row, picture))
        for row in rows
        if len(row) >= LEAST
    ]


def _is_text(row: Sequence[Box], picture: Mask | None) -> bool:
    if picture is None:
        return True
    shares = [float(picture[top:bottom, left:right].mean()) for left, top, right, bottom in row]
    full = sum(max(share, 1.0 - share) >= FILLED for share in shares)
    return full < 0.7 * len(row)  # a row with this share of such pieces is of windows


def _is_repeated(row: Sequence[Box], picture: Mask | None) -> bool:
    """Tell whether most pieces have the shape of the middle one."""
    if picture is None:
        return False
    shapes = [_sample(box, picture) for box in row]
    like = shapes[len(shapes) // 2]
    same = sum((one & like).sum() >= SAME * max((one | like).sum(), 1) for one in shapes)
    return bool(same >= REPEATED * len(shapes))


def _sample(box: Box, picture: Mask) -> Mask:
    """Sample a box on a square grid."""
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


def _around(boxes: Sequence[Box]) -> Box:
    lefts, tops, rights, bottoms = zip(*boxes, strict=True)
    return min(lefts), min(tops), max(rights), max(bottoms)
