"""A silhouette with its thin strokes widened, as a scene's `thicken_mm` asks for it (docs/silhouette.md)."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Mask

__all__ = ["widen_strokes"]


def widen_strokes(mask: Mask, width_px: float) -> Mask:
    """Return the mask with a disc of this width about each point of the middle lines of its thin strokes.

    A stroke is what no such disc inside the mask covers, where it goes further from what they cover than
    half the width. On its middle line no neighbour lies 0.7 px further in.
    """
    from scipy import ndimage

    half = width_px / 2
    depth: Array = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    depth[~mask] = 0.0
    covered = _within(depth >= half, half)
    strokes, found = ndimage.label(mask & ~covered, np.ones((3, 3)))
    beyond = ~_within(covered, half)
    middle = np.zeros_like(mask)
    for number, box in enumerate(ndimage.find_objects(strokes, found), start=1):
        stroke = strokes[box] == number
        if not (stroke & beyond[box]).any():
            continue
        wide = tuple(slice(max(0, s.start - 1), s.stop + 1) for s in box)
        further = ndimage.grey_dilation(depth[wide], size=(3, 3))
        line = (strokes[wide] == number) & (depth[wide] > further - 0.7)  # px
        middle[wide] |= line
    return np.asarray(mask | _within(middle, half))


def _within(mask: Mask, reach: float) -> Mask:
    """Return pixels whose middle is at most so far from one of the mask."""
    from scipy import ndimage

    if not mask.any():
        return mask
    return np.asarray(ndimage.distance_transform_edt(~mask) <= reach)
