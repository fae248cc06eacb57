"""Thin strokes of a silhouette, widened to what a tube can draw."""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Mask

__all__ = ["thicken"]

_RIDGE = 0.7  # px: on a slope of the distance a neighbour is further in by 0.9 or more, on a ridge by less


def thicken(mask: Mask, width_px: float) -> Mask:
    """The silhouette with its strokes at least `width_px` wide, along their middle lines.

    What an opening by a disc of that width leaves out, and is longer than the disc is wide, is a stroke: a
    disc is added at every point of its middle line, which is where the distance to the background is
    largest across it (Blum's medial axis). What is thick already stays as it is.

    Args:
        mask: (H, W).
    """
    from scipy import ndimage

    radius = 0.5 * width_px
    # a pixel's middle is half a pixel inside its side
    inside = np.maximum(ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5, 0.0)
    core = inside >= radius
    opened = ndimage.distance_transform_edt(~core) <= radius if core.any() else core
    thin = mask & ~opened
    labels, count = ndimage.label(thin, np.ones((3, 3)))
    if count == 0:
        return mask
    reach = ndimage.distance_transform_edt(~opened) if opened.any() else np.full(mask.shape, np.inf)
    # corners that the disc rounds are no strokes: they end within its radius
    long = ndimage.maximum(reach, labels, np.arange(count + 1)) > radius
    strokes = np.asarray(long)[labels] & thin
    middle = strokes & (inside > ndimage.maximum_filter(inside, 3) - _RIDGE)
    away = ndimage.distance_transform_edt(~middle) if middle.any() else None
    return mask if away is None else mask | (away <= radius)
