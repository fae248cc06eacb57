"""Regions of a coloured picture that its main colour encloses, and pictures that a view mirrors or bends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from knotfab_formats.verdict import Bending
from knotfab_validators.arrays import Array, Mask

if TYPE_CHECKING:
    from knotfab_formats.views import View

LEVELS = 8  # levels of a channel in one bin: 32 bins
ALIKE = 12  # the largest distance, bins, of a colour from the one that its cluster is named after
SIDE = 256 // LEVELS
SEAM = 6  # px: the least length of a seam between two colours
SHARP = 48.0  # the least difference of two colours within 2 px of their border, levels


def common_colours(pixels: NDArray[np.uint8]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the colours that name a picture's clusters, in bins of 8 levels, and the size of each cluster.

    Colours are taken in order of frequency (the darker first of equals). Each absorbs all colours within
    12 bins that are still free; a cluster counts if it holds at least half a per cent of the pixels.

    Args:
        pixels: (n, 3).

    Returns:
        The colours (k, 3), and (k,) how many pixels are nearest to each (the first of equals).
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
        if counts[alike].sum() * 200 >= len(pixels):  # a cluster holds at least 1/200 of the pixels
            first.append(bins[k])
    named = np.array(first or [bins[order[0]]])
    return named, np.bincount(_nearest_named(bins, named), counts, len(named))


def middle_of_bin(place: NDArray[Any]) -> NDArray[np.float64]:
    """Return the colour (3,) in the middle of a bin; the first and last bins stand for 0 and 255."""
    middle = np.asarray(place, dtype=np.float64) * LEVELS + LEVELS / 2
    middle[place == 0], middle[place == SIDE - 1] = 0.0, 255.0
    return middle


def enclosed_by_largest(pixels: NDArray[np.uint8], opaque: Mask) -> Mask:
    """Mark regions of other colours that the largest cluster encloses, thick and sharply bordered.

    Args:
        pixels: (H, W, 3). opaque: (H, W), where the picture is.
    """
    from scipy import ndimage

    named, sizes = common_colours(pixels[opaque])
    found = np.zeros_like(opaque)
    if len(named) == 1:
        return found
    largest = opaque.copy()
    nearest = _nearest_named((pixels[opaque] // LEVELS).astype(np.int64), named)
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
    """Mark pixels that have the largest colour only because two others blend to it at their border.

    Such a seam is nowhere 3 px thick and, unless it lies alone, at least 6 px long. No other colour makes
    up more than four fifths of the pixels around it.

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
    """Mark pixels that cannot be reached from the frame, side by side, across the barrier."""
    from scipy import ndimage

    labels, _ = ndimage.label(np.pad(~barrier, 1, constant_values=True))
    return np.asarray(labels != labels[0, 0])[1:-1, 1:-1]


def _nearest_named(bins: NDArray[Any], named: NDArray[Any]) -> NDArray[Any]:
    """Return, for each of `bins` (n, 3), the index of the nearest in `named` (k, 3)."""
    best = np.full(len(bins), np.iinfo(np.int64).max)
    chosen = np.zeros(len(bins), dtype=np.int64)
    for k, colour in enumerate(named):
        away = np.square(bins - colour).sum(axis=1)
        closer = away < best
        best[closer], chosen[closer] = away[closer], k
    return chosen


# A silhouette mirrored and bent as its view in the scene says (docs/conventions.md).


# The outermost rows and columns of control points lie one step outside the frame.
ROWS, COLUMNS = 15, 11
UNIT = 1e-4  # a share of the picture's height


@dataclass(frozen=True)
class Bend:
    """A view's change of its picture: mirrored first, then displaced pixel by pixel.

    `points` (2, ROWS, COLUMNS) are the coefficients of a cubic B-spline of displacements, right and down,
    in shares of the picture's height. None: the picture is mirrored only.
    """

    mirrored: bool
    points: Array | None


@dataclass(frozen=True)
class Bent:
    """A bent silhouette (H, W), and how far its pixels moved, in shares of the height (`rms`, `most`).

    `stretch` is the largest factor by which a length changes anywhere in the frame; infinite where the
    picture folds.
    """

    mask: Mask
    rms: float
    most: float
    stretch: float
    mirrored: bool

    @property
    def figures(self) -> Bending:
        """Return the figures for the report."""
        return Bending(
            rms=self.rms, most=self.most, stretch=self.stretch, mirrored=self.mirrored or None
        )


def bend_of(view: View) -> Bend | None:
    """Read a view's change of its picture; None where the picture stays as it is."""
    if not view.bend_points:
        return Bend(True, None) if view.mirrored else None
    pairs = [[pair.split(",") for pair in row.split(" ")] for row in view.bend_points]
    points = np.moveaxis(np.array(pairs, dtype=np.float64), -1, 0)
    return Bend(bool(view.mirrored), UNIT * points)


def bend_silhouette(mask: Mask, bend: Bend) -> Bent:
    """Mirror and bend the silhouette as its view asks."""
    height, width = mask.shape
    if bend.mirrored:
        mask = np.fliplr(mask)
    if bend.points is None:
        return Bent(mask, 0.0, 0.0, 1.0, bend.mirrored)
    # control points that lie on the frame's edges or inside it
    down = 1 + (np.arange(height) + 0.5) / height * (ROWS - 3)
    right = 1 + (np.arange(width) + 0.5) / width * (COLUMNS - 3)
    at = np.stack(np.meshgrid(down, right, indexing="ij"))
    dx, dy = (
        height * ndimage.map_coordinates(axis, at, order=3, prefilter=False) for axis in bend.points
    )
    y, x = np.mgrid[:height, :width]
    inside = ndimage.map_coordinates(mask.astype(np.float64), [y + dy, x + dx], order=1)
    bent = inside >= 0.5
    moved = np.hypot(dx, dy)[bent] / height if bent.any() else np.zeros(1)
    rms, most = float(np.sqrt(np.mean(moved**2))), float(moved.max())
    return Bent(bent, rms, most, _largest_stretch(dx, dy), bend.mirrored)


def _largest_stretch(dx: Array, dy: Array) -> float:
    """Return the largest factor of stretch or shrinking; infinite where the picture folds."""
    (xy, xx), (yy, yx) = np.gradient(dx), np.gradient(dy)
    jacobian = np.stack([1 + xx, xy, yx, 1 + yy], axis=-1).reshape(-1, 2, 2)
    if np.linalg.det(jacobian).min() <= 0:
        return float("inf")
    # singular values of 2 x 2: the sum of squares is that of all entries, their product the determinant
    squares, product = (jacobian**2).sum((1, 2)), np.linalg.det(jacobian)
    longest = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4 * product**2, 0))))
    return float(max(longest.max(), (longest / product).max()))
