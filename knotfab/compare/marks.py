"""The four marks in a photograph: dots in a light and a dark ring, at whatever tilt they are seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from knotfab.base.arrays import Array, Mask
from knotfab.compare.rectify import from_top_left
from knotfab.mount.marks import MARK_RADII_MM

__all__ = ["find_marks"]

_LOOKED_PX = 2000  # longer side at which they are looked for
# windows about which the light is averaged, as shares of that side
_WINDOWS = 1 / 12, 1 / 30, 1 / 75
_DARKER = 0.85  # times that average
_LEAST_PX = 9  # across a mark
_LARGEST = 0.25  # a share of the photograph's longer side
_DOT, _LIGHT, _RING = MARK_RADII_MM
# shares of the disc within the dark ring's outline: not in the ring, and in the dot. Blur, and a threshold
# that is not half-way, move both
_HOLE, _MIDDLE = (_LIGHT / _RING) ** 2, (_DOT / _RING) ** 2
_OFF = 0.4  # these shares may be off by this share, either way
_APART = 0.08  # a share of a mark's size, between the middles of its dot and of its ring
_LIKE_AN_ELLIPSE = 0.06
_FLATTEST = 0.3  # shorter over longer side, as it is seen


@dataclass(frozen=True)
class _Found:
    """A mark's middle, (2,) px, and the square root of its area."""

    middle: Array
    size: float


def find_marks(grey: Array) -> Array | None:
    """Find (4, 2) px of the marks' middles, clockwise from the top left; None where there are not just four.

    What is darker than the light about it is taken apart into pieces; a mark is a piece with one hole, and
    another piece in the middle of that, whose areas are in the proportions of the drawing. A circle becomes
    an ellipse in perspective, and these proportions stay.

    Args:
        grey: (H, W) brightness.
    """
    step = max(1, round(max(grey.shape) / _LOOKED_PX))
    small = ndimage.gaussian_filter(grey, 0.5 * step)[::step, ::step]
    found: list[_Found] = []
    for window in _WINDOWS:
        around = ndimage.uniform_filter(small, max(3, round(window * max(small.shape))))
        for mark in _rings(small < _DARKER * around):
            if all(np.linalg.norm(mark.middle - m.middle) > 0.5 * m.size for m in found):
                found.append(mark)
    if len(found) != 4:
        return None
    return from_top_left((np.stack([mark.middle for mark in found]) + 0.5) * step - 0.5)


def _rings(dark: Mask) -> list[_Found]:
    """Return the marks among the dark pieces."""
    # grains of noise would join separate pieces, and make holes of their own
    labels, _ = ndimage.label(ndimage.median_filter(dark, 3))
    found = []
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        high, wide = (s.stop - s.start for s in place)
        if min(high, wide) < _LEAST_PX or max(high, wide) > _LARGEST * max(dark.shape):
            continue
        piece = labels[place] == number
        filled = ndimage.binary_fill_holes(piece)
        area = int(filled.sum())
        hole = area - int(piece.sum())
        if not _is_about(hole / area, _HOLE):
            continue
        inside, count = ndimage.label((labels[place] != 0) & filled & ~piece)
        if not count:
            continue
        sizes = np.bincount(inside.ravel())[1:]
        dot = inside == 1 + int(sizes.argmax())
        if not _is_about(int(sizes.max()) / area, _MIDDLE) or sizes.sum() > 1.3 * sizes.max():
            continue
        size = float(np.sqrt(area))
        middle, core = (np.array(ndimage.center_of_mass(mask)) for mask in (filled, dot))
        if np.linalg.norm(middle - core) > _APART * size or not _is_ellipse(filled):
            continue
        corner = np.array([place[1].start, place[0].start])
        found.append(_Found(0.5 * (middle + core)[::-1] + corner, size))
    return found


def _is_about(share: float, wanted: float) -> bool:
    return abs(share - wanted) <= _OFF * wanted


def _is_ellipse(region: Mask) -> bool:
    """Tell whether it is as large as the ellipse of its second moments, and not too flat."""
    points = np.argwhere(region)
    spread = np.cov(points.T) + np.eye(2) / 12
    low, high = np.linalg.eigvalsh(spread)
    area = 4 * np.pi * np.sqrt(low * high)
    return bool(abs(area / len(points) - 1) < _LIKE_AN_ELLIPSE and low > _FLATTEST**2 * high)
