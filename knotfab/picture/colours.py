"""Colours of a picture: clusters of opaque pixels, and enclosed parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Array, Mask
from knotfab.picture.silhouette import holes_of, pieces_of

Colours = NDArray[np.uint8]  # (H, W, 3)

_SHIFT = 3  # colours are counted in bins of 8 levels a channel, 32 x 32 x 32 of them
_REACH = 12  # bins: colours within 96 levels of a cluster's first are of its kind
_LEAST_SHARE = 200  # a cluster has at least one pixel in 200
_SHORE = 2  # px to either side of where two colours meet
_WINDOW = 2 * _SHORE + 1
_SHARP = 48.0  # levels by which they differ across it


@dataclass(frozen=True)
class Clusters:
    """Clusters of colours, by their share of the pixels, the largest first.

    `colours`: (k, 3) uint8, the commonest of each; `shares`: (k,); `of_bin`: (32768,) the cluster of each
    bin of colours.
    """

    colours: Colours
    shares: Array
    of_bin: NDArray[np.uint8]

    def label(self, colours: Colours) -> NDArray[np.uint8]:
        """Return the cluster of each colour (..., 3), (...,)."""
        return np.asarray(self.of_bin[_bins(colours)])


def _bins(colours: Colours) -> NDArray[np.uint16]:
    found = (colours[..., 0] >> _SHIFT).astype(np.uint16)
    for channel in (1, 2):
        found <<= 5
        found |= colours[..., channel] >> _SHIFT
    return found


def cluster_colours(colours: Colours) -> Clusters:
    """Cluster colours by leaders (Hartigan, Clustering Algorithms, 1975, ch. 3), commonest first.

    The commonest colour takes all within 96 levels of it (Euclidean, in RGB), the commonest of the rest
    those near it, and so on. Leaders of less than half a per cent are dropped; each colour then belongs
    to the nearest of those that are left, so that two clusters meet at half of their contrast.

    Args:
        colours: (n, 3), n > 0.
    """
    counts = np.bincount(_bins(colours), minlength=1 << 15)
    grid = np.stack(np.unravel_index(np.arange(1 << 15), (32, 32, 32)), axis=1)
    left, leaders = counts.copy(), []
    while left.any():
        peak = int(left.argmax())
        near = ((grid - grid[peak]) ** 2).sum(1) <= _REACH**2
        if left[near].sum() * _LEAST_SHARE >= len(colours):
            leaders.append(peak)
        left[near] = 0
    first = grid[leaders or [int(counts.argmax())]]
    nearest = ((grid[:, None] - first) ** 2).sum(2).argmin(1)
    mass = np.bincount(nearest, counts, len(first))
    order = np.argsort(-mass, kind="stable")
    rank = np.argsort(order)  # there are at most 200 of them
    middles = (first[order] << _SHIFT) + (1 << (_SHIFT - 1))
    # flat colours reach the ends of the range: black is black
    ends = np.where(first[order] == 0, 0, np.where(first[order] == 31, 255, middles))
    return Clusters(
        ends.astype(np.uint8), mass[order] / len(colours), rank[nearest].astype(np.uint8)
    )


def enclosed_parts(colours: Colours, inside: Mask) -> tuple[Mask, Clusters | None]:
    """Return the parts of another colour that the largest cluster of colours encloses.

    A part counts where it is 3 px thick somewhere, and where the two colours meet sharply: a shade that
    fades into another does not count.

    Args:
        colours: (H, W, 3). inside: (H, W), the pixels that are opaque, at least one.

    Returns:
        The parts, (H, W), and the clusters, None if there is only one.
    """
    from scipy import ndimage

    found = cluster_colours(colours[inside])
    none = np.zeros(inside.shape, dtype=bool)
    if len(found.colours) == 1:
        return none, None
    kinds = found.label(colours)
    main = inside & (kinds == 0)
    if len(found.colours) > 2:
        main &= ~_mark_seams(main, inside, kinds)
    parts, areas = pieces_of((holes_of(main)[0] > 0) & inside)
    if not len(areas):
        return none, found
    kept = none
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        part = tuple(slice(max(0, s.start - _SHORE), s.stop + _SHORE) for s in box)
        here, there = parts[part] == number, main[part]
        thick = ndimage.binary_erosion(here, np.ones((3, 3)))
        if thick.any() and _part_sharply(colours[part], here, there):
            kept[part] |= here
    return kept, found


def _mark_seams(main: Mask, inside: Mask, kinds: NDArray[np.uint8]) -> Mask:
    """Mark pixels that only look like the main colour: seams where two other colours mix.

    A seam is nowhere 3 px thick, lies alone or has 6 px, and no other colour makes up more than
    four fifths of the pixels beside it.
    """
    from scipy import ndimage

    block = np.ones((3, 3))
    solid = ndimage.binary_opening(main, block)
    parts, areas = pieces_of(main & ~solid)
    touching = np.zeros(len(areas) + 1, dtype=bool)
    touching[parts[ndimage.binary_dilation(solid, block)]] = True
    seam = np.concatenate([[False], areas > 0])
    for number, box in enumerate(ndimage.find_objects(parts), start=1):
        near = tuple(slice(max(0, s.start - 1), s.stop + 1) for s in box)
        beside = ndimage.binary_dilation(parts[near] == number, block) & inside[near] & ~main[near]
        counts = np.bincount(kinds[near][beside])
        long = not touching[number] or areas[number - 1] >= 6  # px
        seam[number] = long and counts.max(initial=0) * 5 <= 4 * counts.sum() and counts.sum() > 0
    return np.asarray(seam[parts])


def _part_sharply(colours: Colours, part: Mask, main: Mask) -> bool:
    """Return whether the colours of two neighbouring regions change within two pixels of their border."""
    from scipy import ndimage

    rim = colours[part & ndimage.maximum_filter(main, _WINDOW)]
    shore = colours[main & ndimage.maximum_filter(part, _WINDOW)]
    return bool(np.linalg.norm(rim.mean(0) - shore.mean(0)) >= _SHARP)


# What kind of a picture its colours tell.


def is_photo(image: Image.Image) -> bool:
    """Return whether an opaque picture has as many colours as a photograph."""
    if image.has_transparency_data:
        return False
    small = image.convert("RGB")
    small.thumbnail((96, 96))
    # at four bits a channel
    return len(np.unique(np.asarray(small).reshape(-1, 3) >> 4, axis=0)) >= 100
