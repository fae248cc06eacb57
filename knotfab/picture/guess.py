"""Guess from the edge of an opaque picture how to read it: a thin frame, a border of two colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import InputError
from knotfab.picture.colours import cluster_colours
from knotfab.picture.ink import name_colour, split_channels, take_border, takes_alpha
from knotfab_formats.scene import Reading

__all__ = ["guess_reading"]

_ALIKE, _APART = 24.0, 96.0  # levels, Euclidean in RGB: within one colour, and between two
_THIN = 0.015  # the thickest frame, as a share of the shorter side
_SIDE = 0.75  # the share of each side of a frame's inside that has the colour of the paper
_MOST = 0.98  # the share of a frame that has its colour
# the least share of pixels that differ from the paper where a frame goes about a shape
_SHAPE = 1e-3
_MAJORITY = 0.6  # a colour with this share of the border is its background's
_FLAT = 0.9  # at most three colours make up this share of a painted border


def guess_reading(
    image: Image.Image, reading: Reading, what: str
) -> tuple[Reading, tuple[str, ...]]:
    """Guess how an opaque picture is read where nobody says what is ink, with sentences that tell of it.

    A frame of one colour, thinner than 1.5 % of the shorter side, is cropped off. Where the border is of two
    or three colours, none of which has most of it, what none of them reaches is drawn (`flood`).

    Raises:
        InputError: the picture has only the colours of its border, of which none is the background.
    """
    colours, alpha = split_channels(image)
    if reading.ink != "auto" or colours.dtype != np.uint8 or takes_alpha(colours, alpha, reading):
        return reading, ()
    rgb = np.stack([colours] * 3, axis=-1) if colours.ndim == 2 else colours
    notes: list[str] = []
    box = reading.crop_px or None
    if reading.crop_px is False and (thick := _frame_px(rgb)):
        box = (thick, thick, image.width - 2 * thick, image.height - 2 * thick)
        reading = reading.but(crop_px=box)
        notes.append(
            f"the frame about it, {thick} px of {name_colour(rgb[0, 0])}, is cropped off "
            f"(--crop 0,0,{image.width},{image.height} keeps it)"
        )
    if box is not None:
        rgb = rgb[box[1] : box[1] + box[3], box[0] : box[0] + box[2]]
    border = take_border(rgb)
    found = cluster_colours(border.astype(np.uint8, copy=False))
    if found.shares[0] >= _MAJORITY or found.shares[:3].sum() < _FLAT:
        return reading, tuple(notes)
    shares = zip(found.colours[:3], found.shares[:3], strict=False)
    named = " and ".join(f"{name_colour(c)} ({share:.0%})" for c, share in shares)
    others = np.logical_and.reduce([_away(rgb, c) > _APART for c in found.colours])
    if others.mean() >= 5 * _SHAPE:
        notes.append(f"its border is {named}, so what none of these reaches is drawn (--ink flood)")
        return reading.but(ink="flood"), tuple(notes)
    if _away(border, np.median(border, axis=0)).min() > _ALIKE:
        one, other = (name_colour(c) for c in found.colours[:2])
        raise InputError(
            what,
            f"its border is {named}, so none of these is its background",
            f'Say which is drawn: --ink "{one}" or --ink "{other}".',
        )
    return reading, tuple(notes)


def _away(colours: NDArray[np.uint8], colour: Array | NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return (...) how far colours (..., 3) are from one, in levels."""
    apart = colours.astype(np.float32) - np.asarray(colour, np.float32)
    return np.asarray(np.sqrt(np.einsum("...k,...k->...", apart, apart)))


def _frame_px(rgb: NDArray[np.uint8]) -> int:
    """Measure how thick a frame of one colour about a shape on paper of another is; 0 where there is none."""
    most = max(1, round(_THIN * min(rgb.shape[:2])))
    outer = np.median(take_border(rgb), axis=0)
    for depth in range(most + 1):
        inside = rgb[depth : len(rgb) - depth, depth : rgb.shape[1] - depth]
        sides = (inside[0], inside[-1], inside[:, 0], inside[:, -1])
        paper = np.median(take_border(inside), axis=0)
        framed: Mask = _away(take_border(inside), outer) <= _ALIKE
        if framed.mean() >= _MOST:
            continue
        if depth == 0:
            return 0
        further = np.median(take_border(inside[1:-1, 1:-1]), axis=0)
        even = all((_away(side, paper) <= _ALIKE).mean() >= _SIDE for side in sides)
        if even and _away(paper, outer) >= _APART and _away(paper, further) <= _ALIKE:
            return depth if (_away(inside, paper) > _APART).mean() >= _SHAPE else 0
    return 0
