"""Measure whether someone who sees the piece from the side could name its picture."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from knotfab_formats.verdict import FOREIGN_SIGNS, Named
from knotfab_validators.arrays import Array, Mask, compiled

SIDE, MARGIN = 40, 5  # side of the compared pictures in px, and the margin around the box within it
TRIES = 260  # steps of a fit
# each character's mean fit to the 23 others, which takes a second to work out; a test does
GAINS = (
    0.55652,
    0.59056,
    0.49825,
    0.40792,
    0.50402,
    0.53421,
    0.54273,
    0.35363,
    0.39948,
    0.58484,
    0.47096,
    0.44685,
    0.53735,
    0.37870,
    0.39194,
    0.37755,
    0.39507,
    0.41549,
    0.38968,
    0.35179,
    0.56053,
    0.31649,
    0.54285,
    0.37619,
)
SAME = 0.85  # a character that fits the picture itself this well is not foreign


def name_piece(seen: Sequence[Mask], target: Mask) -> Named | None:
    """Measure how much better the picture fits the silhouettes than foreign pictures do.

    Each picture is moved, turned, stretched and sheared over each silhouette until their IoU is largest; what
    it gains over shapes that it does not show, the foreign signs on average, is taken off. `z` counts the
    standard deviations of the signs by which the picture then stands out from their mean, in the silhouette
    where that is largest; `first` says whether no sign fits better there. Around 1 nothing is read; from 3
    on it is plain. None where there is nothing to see.

    Args:
        seen: silhouettes (h, w) of the piece from some sides. target: (H, W), the picture's silhouette.
    """
    own = shrink_to_box(target)
    looks = [look for look in map(shrink_to_box, seen) if look is not None]
    if own is None or not looks:
        return None
    signs, gains = read_foreign(), np.array(GAINS)
    gain = np.array([fit_picture(own, sign) for sign in signs])
    foreign = gain < SAME
    usual = float(gain[foreign].mean()) if foreign.any() else 0.0
    found = []
    for look in looks:
        fits = np.array([fit_picture(sign, look) for sign in signs]) - gains
        fit = fit_picture(own, look) - usual
        others = fits[foreign] if foreign.any() else fits
        found.append((float((fit - others.mean()) / others.std()), bool(fit > others.max())))
    return Named(*max(found))


@cache
def read_foreign() -> Array:
    """Read the foreign characters (n, SIDE, SIDE)."""
    from PIL import Image

    with Image.open(FOREIGN_SIGNS) as image:
        column = np.asarray(image.convert("L")) > 127
    boxes = [shrink_to_box(s) for s in np.split(column, len(column) // column.shape[1])]
    return np.array([box for box in boxes if box is not None])


def shrink_to_box(mask: Mask) -> Array | None:
    """Return the cover of each pixel of a mask's bounding box, (SIDE, SIDE); None if empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    box = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.float64)
    inner = SIDE - 2 * MARGIN
    for _ in range(2):  # integrate along each axis and sample at the pixels' borders
        area = np.vstack([np.zeros(box.shape[1]), np.cumsum(box, axis=0)])
        at = np.linspace(0, len(box), inner + 1)
        low = np.minimum(at.astype(int), len(box) - 1)
        share = (at - low)[:, None]
        border = (1 - share) * area[low] + share * area[low + 1]
        box = (np.diff(border, axis=0) * inner / len(box)).T
    return np.pad(box, MARGIN)


@compiled
def fit_picture(
    picture: Array, look: Array, tries: int = TRIES, seed: int = 0x9E3779B97F4A7C15
) -> float:
    """Return the largest IoU of two pictures (n, n) under a nearly identical affine map."""
    map_ = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    best, scale, shift = _overlap(picture, look, map_), 1.0, len(picture) / 20.0
    state = np.uint64(seed)
    moved = map_.copy()
    for _ in range(tries):
        for i in range(6):
            # the sum of four uniform numbers is nearly normal
            total = 0.0
            for _ in range(4):
                state ^= state << np.uint64(13)
                state ^= state >> np.uint64(7)
                state ^= state << np.uint64(17)
                total += np.float64(state >> np.uint64(11)) / 9007199254740992.0
            moved[i] = map_[i] + scale * (shift if i % 3 == 2 else 0.12) * (total - 2.0) * 1.7320508
        if abs(moved[0] * moved[4] - moved[1] * moved[3]) < 0.35:
            continue
        value = _overlap(picture, look, moved)
        if value > best:
            best, scale = value, min(1.5, 1.6 * scale)
            map_[:] = moved
        else:
            scale = max(0.03, 0.96 * scale)
    return best


@compiled
def _overlap(picture: Array, look: Array, map_: Array) -> float:
    n = len(picture)
    middle, both, either = (n - 1) / 2, 0.0, 0.0
    for j in range(n):
        for i in range(n):
            x = map_[0] * (i - middle) + map_[1] * (j - middle) + map_[2] + middle
            y = map_[3] * (i - middle) + map_[4] * (j - middle) + map_[5] + middle
            value, u, v = 0.0, int(np.floor(x)), int(np.floor(y))
            if 0 <= u < n - 1 and 0 <= v < n - 1:
                s, t = x - u, y - v
                value = (look[v, u] * (1 - s) + look[v, u + 1] * s) * (1 - t)
                value += (look[v + 1, u] * (1 - s) + look[v + 1, u + 1] * s) * t
            both += min(picture[j, i], value)
            either += max(picture[j, i], value)
    return both / either
