"""Thin strokes of a silhouette, widened until a tube can draw them."""

from __future__ import annotations

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.picture.masks import outline_px, pieces_of

__all__ = ["draw_discs", "is_thin", "run_together", "thicken"]

_MOST = 0.5  # the share of a line drawing's middle lines that are thinner than the tube
_SOLID = 0.2  # the largest share of its area that is twice as thick


def _inside(mask: Mask) -> Array:
    """Return (H, W) distance of each pixel's middle from the background, px."""
    from scipy import ndimage

    # a pixel's middle is half a pixel inside its side
    found: Array = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    return np.maximum(found, 0.0)


def draw_discs(middles: Mask, radius: float) -> Mask:
    """Draw discs of a radius (px) about these pixels."""
    from scipy import ndimage

    if not middles.any():
        return middles
    return np.asarray(ndimage.distance_transform_edt(~middles) <= radius)


def _opened(inside: Array, radius: float) -> Mask:
    """Draw the discs of a radius that lie in a mask."""
    return draw_discs(inside >= radius, radius)


def _ridge(mask: Mask, inside: Array) -> Mask:
    """Return the middle lines: pixels of which no neighbour is further in."""
    from scipy import ndimage

    # px: on a slope of the distance a neighbour is further in by 0.9 or more, on a ridge by less
    return np.asarray(mask & (inside > ndimage.maximum_filter(inside, 3) - 0.7))


def is_thin(mask: Mask, width_px: float) -> bool:
    """Tell whether a silhouette is a drawing of lines thinner than this.

    Most of its middle lines are, by their length, and hardly any of its area is twice as thick.
    """
    # a thick picture is told at once: where a fifth at most is solid, the area is bounded by the edge
    if 2.0 * mask.sum() > 2.0 / (1.0 - _SOLID) * width_px * outline_px(mask):
        return False
    inside = _inside(mask)
    thin = inside[_ridge(mask, inside)] < 0.5 * width_px
    if thin.mean() <= _MOST:
        return False
    return bool((mask & _opened(inside, width_px)).sum() / mask.sum() < _SOLID)


def run_together(mask: Mask, widened: Mask, width_px: float) -> float:
    """Measure the share of widened strokes where they ran together: thicker than one, where none was."""
    radius = 0.75 * width_px
    blobs = _opened(_inside(widened), radius) & ~_opened(_inside(mask), radius)
    return float(blobs.sum() / widened.sum())


def thicken(mask: Mask, width_px: float) -> Mask:
    """Return the silhouette with its strokes at least `width_px` wide, along their middle lines.

    What an opening by a disc of that width leaves out, and is longer than the disc is wide, is a stroke: a
    disc is added at every point of its middle line, which is where the distance to the background is
    largest across it (Blum's medial axis). What is thick already stays as it is.

    Args:
        mask: (H, W).
    """
    from scipy import ndimage

    radius = 0.5 * width_px
    inside = _inside(mask)
    opened = _opened(inside, radius)
    thin = mask & ~opened
    labels, areas = pieces_of(thin)
    if not len(areas):
        return mask
    reach = ndimage.distance_transform_edt(~opened) if opened.any() else np.full(mask.shape, np.inf)
    # corners that the disc rounds are no strokes: they end within its radius
    long = ndimage.maximum(reach, labels, np.arange(len(areas) + 1)) > radius
    strokes = np.asarray(long)[labels] & thin
    middle = strokes & _ridge(mask, inside)
    return mask | draw_discs(middle, radius)
