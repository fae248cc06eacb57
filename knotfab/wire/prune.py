"""Corners taken out of a wire that keeps to its limits without them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.wire.adjust import adjust, measure_misses, measure_worst
from knotfab.wire.likeness import GridLikeness
from knotfab.wire.residual import FitLimits, Strand, weigh_depth

__all__ = ["prune"]


_APART = 6  # corners from one that is taken out to the next: what comes of it is told apart
_NEAR = (2, 3, 6, 12)  # pieces to either side of a bad one whose old corners come back, in each try
_ADJUSTED = 2  # tries in which the others are moved first: later ones only bring more back
_STEPS = 5
_HIGHEST = 8.0  # tolerances that a corner may stand out by


def prune(
    strands: list[Strand],
    light: Array | None,
    limits: FitLimits,
    rounds: int,
    pictures: Sequence[GridLikeness] = (),
) -> int:
    """Take out corners as long as the limits are kept as well without them; how many it were.

    In each round the flattest that are far enough apart go together, and the others are moved to take
    their place. Where that fails the old corners come back, and those are not asked again. A limit
    that is missed already, by a little, may go on to be missed by as much, and only that one. With
    `pictures` the others are moved to where the wires draw these.
    """
    barred = [np.zeros(len(s.corners), dtype=bool) for s in strands]
    count = sum(len(s.corners) for s in strands)
    worst = measure_worst(strands, light, limits)
    if (worst > 0.1).any():  # a wire that misses a limit by more is for another fit to mend
        return 0
    for _ in range(rounds):
        before = [(s.corners, s.index) for s in strands]
        gone = [_choose(s, b, light, limits) for s, b in zip(strands, barred, strict=True)]
        if not any(g.any() for g in gone) or limits.work.over:
            break
        asked = [g.copy() for g in gone]
        for strand, g in zip(strands, gone, strict=True):
            strand.corners, strand.index = strand.corners[~g], strand.index[~g]
        for number in range(len(_NEAR) + 1):
            if number < _ADJUSTED:
                adjust(strands, light, limits, _STEPS, pictures)
            misses = measure_misses(strands, light, limits)
            bad = [np.asarray((m > worst).any(axis=1)) for m in misses]
            if not any(b.any() for b in bad):
                break
            for k, strand in enumerate(strands):
                if number < len(_NEAR):
                    gone[k] = _bring_back(strand, *before[k], gone[k], bad[k], _NEAR[number])
                else:  # all of them back
                    strand.corners, strand.index = before[k]
                    gone[k] = np.zeros_like(gone[k])
        barred = [(b | a)[~g] for b, a, g in zip(barred, asked, gone, strict=True)]
    return count - sum(len(s.corners) for s in strands)


def _choose(strand: Strand, barred: Mask, light: Array | None, limits: FitLimits) -> Mask:
    """Choose corners (m,) to take out together: those that stand out least from their neighbours' chord."""
    corners, m = strand.corners, len(strand.corners)
    chosen, free = np.zeros(m, dtype=bool), ~barred
    if m < 2 * _APART:
        return chosen
    first, last = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    chord = last - first
    size = np.maximum((chord * chord).sum(axis=1), 1e-18)
    share = np.clip(((corners - first) * chord).sum(axis=1) / size, 0.0, 1.0)
    foot = first + share[:, None] * chord
    height = np.linalg.norm(weigh_depth(corners - foot, corners, light), axis=1)
    for j in np.argsort(height):
        if free[j] and height[j] <= _HIGHEST * limits.tolerance_mm:
            chosen[j] = True
            free[(j + np.arange(1 - _APART, _APART)) % m] = False
    return chosen


def _bring_back(
    strand: Strand, corners: Array, index: Indices, gone: Mask, bad: Mask, reach: int
) -> Mask:
    """Put the old corners back about all bad pieces; those (m,) of the old ones that are still gone."""
    m = len(corners)
    kept = np.flatnonzero(~gone)
    near = np.zeros(m, dtype=bool)
    for j in kept[bad]:
        near[(j + np.arange(-reach, reach + 2)) % m] = True
    mixed = corners.copy()
    mixed[kept] = strand.corners
    mixed[near] = corners[near]
    left = gone & ~near
    strand.corners, strand.index = mixed[~left], index[~left]
    return np.asarray(left)
