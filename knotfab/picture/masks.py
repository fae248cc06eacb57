"""Silhouette masks as sets of pixels: their pieces (8-connected), holes (4-connected) and outlines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Mask
from knotfab.picture.silhouette import resample_mask

__all__ = [
    "count_dust",
    "drop_specks",
    "fill_holes",
    "holes_of",
    "keep_largest",
    "mask_iou",
    "outline_px",
    "pieces_of",
    "sample_mask",
    "smooth",
]

_MANY, _HARDLY = 6, 0.015  # the fewest specks of dust, and their largest share of the ink
_HALF = 0.5 - 1e-5  # coverage is summed in single precision


def mask_iou(one: Mask, other: Mask) -> float:
    """Return intersection over union of two masks (H, W) of one grid; 1 where both are empty."""
    union = int((one | other).sum())
    return float((one & other).sum() / union) if union else 1.0


def outline_px(mask: Mask) -> int:
    """Count the sides of pixels along the outline of a mask, the frame's included."""
    edged = np.pad(mask, 1)
    return int((edged[1:] ^ edged[:-1]).sum() + (edged[:, 1:] ^ edged[:, :-1]).sum())


def sample_mask(mask: Mask, width: int, height: int) -> Mask:
    """Give (height, width) the mask (H, W) at another resolution: where it covers half of a pixel or more."""
    return resample_mask(mask, width, height) >= _HALF


def pieces_of(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return (H, W) each piece's number, from 1, and (n,) its pixels; two that touch at a corner are one."""
    from scipy import ndimage

    labels, _ = ndimage.label(mask, np.ones((3, 3)))
    return labels, np.bincount(labels.ravel())[1:]


def holes_of(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number holes, from 1, (H, W), and count their pixels (n,): background that the frame does not reach."""
    from scipy import ndimage

    around, count = ndimage.label(np.pad(~mask, 1, constant_values=True))
    number = np.arange(count + 1)
    number[1:] -= 1  # the background outside comes first, from the corner
    labels = number[around[1:-1, 1:-1]].astype(np.int32)
    return labels, np.bincount(labels.ravel(), minlength=count)[1:]


def keep_largest(mask: Mask, count: int) -> Mask:
    """Return the `count` largest pieces; of equals those that come first, row by row."""
    labels, areas = pieces_of(mask)
    kept = np.zeros(len(areas) + 1, dtype=bool)
    kept[1 + np.argsort(-areas, kind="stable")[:count]] = True
    return np.asarray(kept[labels])


def drop_specks(mask: Mask, least_px: int) -> Mask:
    """Remove pieces of fewer pixels, and fill holes of fewer."""
    labels, areas = pieces_of(mask)
    return fill_holes(np.concatenate([[False], areas >= least_px])[labels], least_px)


def fill_holes(mask: Mask, least_px: float) -> Mask:
    """Fill holes of fewer pixels."""
    labels, areas = holes_of(mask)
    return np.asarray(mask | np.concatenate([[False], areas < least_px])[labels])


def count_dust(mask: Mask, least_px: float) -> int:
    """Count the pieces and holes of fewer pixels, where they are dust; 0 where they may be meant.

    Dust is many, hardly any of the ink, and scattered: what is written, or dotted, stands closer.
    """
    from scipy import ndimage
    from scipy.spatial import KDTree

    at, sides = [], []
    for labels, areas in (pieces_of(mask), holes_of(mask)):
        few = np.flatnonzero(areas < least_px) + 1
        at += ndimage.center_of_mass(labels > 0, labels, few)
        sides += np.sqrt(areas[few - 1]).tolist()
    if len(at) < _MANY or np.square(sides).sum() > _HARDLY * mask.sum():
        return 0
    apart = KDTree(at).query(at, 2)[0][:, 1]
    # the distance between specks of dust over their size, at least
    return len(at) if np.median(apart) > 2.5 * np.median(sides) else 0


def smooth(mask: Mask, sigma_px: float) -> Mask:
    """Return the mask blurred by a Gaussian, at half; what lies at the frame goes on beyond it."""
    from scipy import ndimage

    blurred = ndimage.gaussian_filter(mask.astype(np.float32), sigma_px, mode="nearest")
    return np.asarray(blurred > 0.5)
