"""Drawings on paper that was photographed under uneven light: the light is taken out of the picture.

A global threshold cannot tell ink in the sun from paper in a shadow. The light on the paper is what is left
when a greyscale closing has filled the strokes, and then it is averaged over what is paper (the flat-field
correction of document scanners). The picture divided by it has paper of one brightness.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array, Mask

__all__ = ["even_out"]

_SIDE = 600  # px of the longer side on which light is estimated
# shares of that side, wider than strokes and narrower than shadows; each is tried
_CLOSED = (0.36, 0.22, 0.14)
_UNEVEN = 1.3  # the brightest light over the darkest, from which on it disturbs
_LEVELS = 24  # levels that a photographed border has at least; painted pictures have fewer
_PAPER, _INK = 0.8, 0.5  # shares of the light that paper reflects at least, and ink at most
# shares: pixels between paper and ink, at most, to the ink; ink, at least, to the picture
_BETWEEN, _LEAST = 0.4, 0.004
_CLEAR = 0.97  # the share of the border that is paper
# a step in the picture itself, over the light, and the share of an outline that has one
_EDGE, _EDGES = 0.3, 0.85


def even_out(image: Image.Image) -> Image.Image | None:
    """Return the picture under even light; None where it is no dark drawing on paper, or the light will do.

    It is one only if what is dark after the division has clear edges in the picture itself, little is
    neither dark nor light, and the border is paper of one hue.
    """
    rgb = np.asarray(image.convert("RGB"))
    every = -(-max(rgb.shape[:2]) // _SIDE)
    few = rgb[::every, ::every].astype(np.float64)
    border = np.concatenate([few[0], few[-1], few[1:-1, 0], few[1:-1, -1]])
    bright = border.mean(axis=1)
    shares = border[:, :2] / np.maximum(border.sum(axis=1, keepdims=True), 1.0)
    if np.percentile(bright, 98) < _UNEVEN * np.percentile(bright, 2):
        return None
    # the largest standard deviation of the shares of red and green along a paper's border
    if len(np.unique(bright.round())) < _LEVELS or shares.std(axis=0).max() > 0.04:
        return None
    grey = few.mean(axis=2)
    for closed in _CLOSED:
        light = _light(grey, closed)
        if light is not None and _is_drawing(grey, light):
            size = (rgb.shape[1], rgb.shape[0])
            full = Image.fromarray(light.astype(np.float32)).resize(size, Image.Resampling.BICUBIC)
            even = 255.0 * rgb / np.maximum(np.asarray(full), 1.0)[..., None]
            return Image.fromarray(np.clip(even, 0, 255).astype(np.uint8))
    return None


def _light(grey: Array, closed: float) -> Array | None:
    """Return the brightness (h, w) that paper has, or would have under the ink; None if there is no paper."""
    from scipy import ndimage

    coarse = max(1, max(grey.shape) // 150)
    small = ndimage.median_filter(grey, 3)[::coarse, ::coarse]
    side = max(3, round(closed * max(small.shape)))
    # the picture goes on beyond its edge, so that a dark corner is no stroke
    filled = ndimage.grey_closing(np.pad(small, side, mode="edge"), (side, side))
    paper = small > _PAPER * filled[side:-side, side:-side]
    # pixels beside ink are blurred with it
    paper &= ~ndimage.binary_dilation(~paper)
    if not paper.any():
        return None
    light = np.zeros_like(small)
    known = np.zeros(small.shape, dtype=bool)
    for spread in 2.0 ** np.arange(0, 8):  # wider where paper is farther
        weight = ndimage.gaussian_filter(paper.astype(float), spread)
        told = ~known & (weight > 0.05)
        light[told] = (ndimage.gaussian_filter(small * paper, spread) / np.maximum(weight, 1e-9))[
            told
        ]
        known |= told
    light[~known] = light[known].mean()
    rows, columns = (np.linspace(0, n - 1, m) for n, m in zip(small.shape, grey.shape, strict=True))
    at = np.meshgrid(rows, columns, indexing="ij")
    return np.asarray(ndimage.map_coordinates(ndimage.gaussian_filter(light, 0.7), at, order=1))


def _is_drawing(grey: Array, light: Array) -> bool:
    """Tell whether a picture divided by this light is dark ink on paper."""
    from scipy import ndimage

    if np.percentile(light, 98) < _UNEVEN * np.percentile(light, 2):
        return False
    share = ndimage.median_filter(grey, 3) / light
    ink: Mask = share < _INK
    between = (share >= _INK) & (share < _PAPER)
    rim = np.concatenate([share[0], share[-1], share[:, 0], share[:, -1]])
    if ink.mean() < _LEAST or between.mean() > _BETWEEN * ink.mean() + _LEAST:
        return False
    if (rim >= _PAPER).mean() < _CLEAR:
        return False
    outline = ink & ~ndimage.binary_erosion(ink)
    step = ndimage.maximum_filter(grey, 7) - ndimage.minimum_filter(grey, 7)
    return bool((step > _EDGE * light)[outline].mean() >= _EDGES)
