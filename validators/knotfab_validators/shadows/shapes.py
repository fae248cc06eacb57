"""Measure how well each piece and hole of a picture is drawn by itself, whatever lies beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.distance import depth_in
from knotfab_validators.shadows.topology import (
    Change,
    crop_to_ink,
    find_widest,
    label_regions,
    shift_change,
)

__all__ = ["Shape", "find_misshapen"]

Feature = Literal["piece", "hole"]
AROUND = 8.0  # reaches: how far from a piece the shadow is still its own
RADIUS = 4.0  # reaches


@dataclass(frozen=True)
class Shape(Change):
    """A piece or a hole of the picture that is there and drawn out of shape.

    `of` says which of the two it is, `likeness` how much of it is drawn as it is, from 0 to 1.
    """

    of: Feature
    likeness: float


def find_misshapen(
    shadow: Mask, target: Mask, reach_px: float, least: float, lost: Sequence[Change] = ()
) -> list[Shape]:
    """Find the pieces and holes that are less alike in picture and shadow than `least`, the worst first.

    The likeness is the IoU of a piece with what the shadow has nearest to it, no farther than `AROUND`
    reaches, where an outline that is off by no more than a reach is right. A piece no wider than the tube's
    radius is a stroke, which the tube covers: its outline may be off by as much more as the tube stands out
    to either side. Holes no wider than that are not looked at: nobody sees such slits and pinholes.

    Args:
        shadow, target: (H, W), on one grid.
        reach_px: how far an outline may be off without saying anything, a quarter of the tube's radius.
        least: from 0 to 1.
        lost: what is counted as lost already.
    """
    cropped = crop_to_ink(shadow, target, AROUND * reach_px)
    if cropped is None:
        return []
    seen, wanted, corner = cropped
    gone = {(c.kind, c.box) for c in lost}
    compared = (
        *_compare("piece", seen, wanted, reach_px),
        *_compare("hole", ~seen, ~wanted, reach_px),
    )
    found = [shift_change(shape, *corner) for shape in compared if shape.likeness < least]
    there = (shape for shape in found if (shape.of, shape.box) not in gone)
    return sorted(there, key=lambda shape: shape.likeness)


def _compare(of: Feature, has: Mask, wants: Mask, reach: float) -> Iterator[Shape]:
    """Yield the likeness of every piece of `wants`, or of every hole that is wide enough."""
    from scipy.ndimage import distance_transform_edt

    labels, found = label_regions(of, wants, reach)
    if not found:
        return
    away, (i, j) = distance_transform_edt(~wants, return_indices=True)
    nearest, missing = labels[i, j], depth_in(~has)
    margin = int(np.ceil(AROUND * reach)) + 1
    for number, box in found:
        left, top, right, bottom = box
        rows = slice(max(top - margin, 0), bottom + margin)
        window = rows, slice(max(left - margin, 0), right + margin)
        own = labels[window] == number
        (u, v), width = find_widest(own)
        slack = reach
        if width <= RADIUS * reach:
            if of == "hole":
                continue
            slack += RADIUS * reach - width / 2
        around = (nearest[window] == number) & (away[window] <= AROUND * reach)
        drawn = has[window] & around
        off = (drawn & (away[window] > slack)) | (own & (missing[window] > slack))
        where = u + window[1].start, v + window[0].start
        likeness = 1 - float(off.sum()) / float((drawn | own).sum())
        yield Shape("shape", where, width, box, of, likeness)
