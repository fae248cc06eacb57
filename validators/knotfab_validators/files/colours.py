"""Parts of a picture that another colour encloses: holes in the silhouette of a coloured drawing."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Mask

__all__ = ["common_colours", "enclosed_by_largest", "middle_of_bin", "not_reached"]

LEVELS = 8  # levels of a channel in one bin: 32 bins
ALIKE = 12  # bins between a colour and the first of its cluster, at most
SIDE = 256 // LEVELS
SEAM = 6  # px of a line where two colours meet, at least
SHARP = 48.0  # levels between two colours within 2 px of where they meet


def common_colours(pixels: NDArray[np.uint8]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the colours that a picture's clusters are named after, in bins of 8 levels, and their pixels.

    Colours are taken by how common they are (the darker first of equals), each with all that are
    within 12 bins and not taken yet; those with at least half a per cent count.

    Args:
        pixels: (n, 3).

    Returns:
        (k, 3) whole numbers, and (k,) how many pixels are nearest to each (the first of equals).
    """
    code = np.zeros(len(pixels), dtype=np.int64)
    for channel in pixels.T:
        code = code * SIDE + channel // LEVELS
    tally = np.bincount(code, minlength=SIDE**3).reshape(SIDE, SIDE, SIDE)
    bins, counts = np.argwhere(tally), tally[tally > 0]
    order = np.argsort(-counts, kind="stable")
    first: list[NDArray[Any]] = []
    taken = np.zeros(len(bins), dtype=bool)
    for k in order:
        if taken[k]:
            continue
        alike = ~taken & (np.square(bins - bins[k]).sum(axis=1) <= ALIKE**2)
        taken |= alike
        if counts[alike].sum() * 200 >= len(pixels):  # a cluster has at least one pixel in so many
            first.append(bins[k])
    named = np.array(first or [bins[order[0]]])
    return named, np.bincount(_nearest(bins, named), counts, len(named))


def middle_of_bin(place: NDArray[Any]) -> NDArray[np.float64]:
    """Return (3,) the colour in the middle of a bin; the first and last bins stand for 0 and 255."""
    middle = np.asarray(place, dtype=np.float64) * LEVELS + LEVELS / 2
    middle[place == 0], middle[place == SIDE - 1] = 0.0, 255.0
    return middle


def enclosed_by_largest(pixels: NDArray[np.uint8], opaque: Mask) -> Mask:
    """Find where the largest cluster of colours encloses parts of others, thick and sharply parted from it.

    Args:
        pixels: (H, W, 3). opaque: (H, W), where the picture is.
    """
    from scipy import ndimage

    named, sizes = common_colours(pixels[opaque])
    found = np.zeros_like(opaque)
    if len(named) == 1:
        return found
    largest = opaque.copy()
    nearest = _nearest((pixels[opaque] // LEVELS).astype(np.int64), named)
    commonest = int(np.argmax(sizes))
    largest[opaque] = nearest == commonest
    if len(named) > 2:
        kinds = np.full(opaque.shape, commonest)
        kinds[opaque] = nearest
        largest ^= _between_others(largest, np.where(largest | ~opaque, -1, kinds))
    others = not_reached(largest) & opaque & ~largest
    parts, _ = ndimage.label(others, np.ones((3, 3)))
    core = ndimage.binary_erosion(others, np.ones((3, 3)))
    reach = np.ones((5, 5))
    for part, box in enumerate(ndimage.find_objects(parts), start=1):
        around = tuple(slice(max(0, s.start - 2), s.stop + 2) for s in box)
        here = parts[around] == part
        if not core[around][here].any():
            continue
        inner = here & ndimage.binary_dilation(largest[around], reach)
        outer = largest[around] & ndimage.binary_dilation(here, reach)
        colours = pixels[around].astype(np.float64)
        if np.linalg.norm(colours[inner].mean(axis=0) - colours[outer].mean(axis=0)) >= SHARP:
            found[around] |= here
    return found


def _between_others(largest: Mask, others: NDArray[Any]) -> Mask:
    """Find pixels of the largest colour only because two others mix to it where they meet.

    It is nowhere 3 px thick, has 6 px unless it lies by itself, and no other colour makes up more than four
    fifths of the pixels around it.

    Args:
        largest: (H, W). others: (H, W) the cluster of all other pixels, -1 where there is none.
    """
    from scipy import ndimage

    around = np.ones((3, 3), dtype=bool)
    thick = ndimage.binary_dilation(ndimage.binary_erosion(largest, around), around) & largest
    reached = ndimage.binary_dilation(thick, around)
    parts, _ = ndimage.label(largest & ~thick, around)
    found = np.zeros_like(largest)
    for part, (rows, columns) in enumerate(ndimage.find_objects(parts), start=1):
        window = (
            slice(max(0, rows.start - 1), rows.stop + 1),
            slice(max(0, columns.start - 1), columns.stop + 1),
        )
        here = parts[window] == part
        if here.sum() < SEAM and (here & reached[window]).any():
            continue
        beside = others[window][ndimage.binary_dilation(here, around)]
        _, tally = np.unique(beside[beside >= 0], return_counts=True)
        if len(tally) and tally.max() <= 0.8 * tally.sum():
            found[window] |= here
    return found


def not_reached(barrier: Mask) -> Mask:
    """Mark what the frame does not reach, from pixel to pixel along sides, without crossing the barrier."""
    from scipy import ndimage

    labels, _ = ndimage.label(np.pad(~barrier, 1, constant_values=True))
    return np.asarray(labels != labels[0, 0])[1:-1, 1:-1]


def _nearest(bins: NDArray[Any], named: NDArray[Any]) -> NDArray[Any]:
    """Return (n,) the place in `named` (k, 3) that each of `bins` (n, 3) is nearest to."""
    best = np.full(len(bins), np.iinfo(np.int64).max)
    chosen = np.zeros(len(bins), dtype=np.int64)
    for k, colour in enumerate(named):
        away = np.square(bins - colour).sum(axis=1)
        closer = away < best
        best[closer], chosen[closer] = away[closer], k
    return chosen
