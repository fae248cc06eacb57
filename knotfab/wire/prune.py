"""Corners taken out of a wire that keeps to its limits without them."""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Array, Indices, Mask
from knotfab.wire.adjust import ROUNDING, adjust, judge
from knotfab.wire.arcs import round_corners
from knotfab.wire.residual import (
    FitLimits,
    Strand,
    measure_distances,
    measure_gaps,
    weigh_depth,
)

__all__ = ["prune"]


_APART = 6  # corners from one that is taken out to the next: what comes of it is told apart
_NEAR = (2, 3, 6, 12)  # pieces to either side of a bad one whose old corners come back, in each try
_ADJUSTED = 2  # tries in which the others are moved first: later ones only bring more back
_STEPS = 5
_MOST_SLACK = 0.1  # a wire farther off than that is for another fit to mend
_HIGHEST = 8.0  # tolerances that a corner may stand out by


def prune(strands: list[Strand], light: Array | None, limits: FitLimits, rounds: int) -> int:
    """Take out corners as long as the limits are kept as well without them; how many it were.

    In each round the flattest that are far enough apart go together, and the others are moved to take
    their place. Where that fails the old corners come back, and those are not asked again. What misses
    a limit already, by a little, may go on to miss it by as much.
    """
    barred = [np.zeros(len(s.corners), dtype=bool) for s in strands]
    count = sum(len(s.corners) for s in strands)
    slack = judge(strands, light, limits)[0]
    if slack > _MOST_SLACK:
        return 0
    for _ in range(rounds):
        before = [(s.corners, s.index) for s in strands]
        gone = [_choose(s, b, light, limits) for s, b in zip(strands, barred, strict=True)]
        if not any(g.any() for g in gone):
            break
        asked = [g.copy() for g in gone]
        for strand, g in zip(strands, gone, strict=True):
            strand.corners, strand.index = strand.corners[~g], strand.index[~g]
        for number, reach in enumerate(_NEAR):
            if number < _ADJUSTED:
                adjust(strands, light, limits, _STEPS)
            bad = _find_bad(strands, light, limits, slack)
            if not any(b.any() for b in bad):
                break
            for k, strand in enumerate(strands):
                gone[k] = _bring_back(strand, *before[k], gone[k], bad[k], reach)
        else:
            for k, strand in enumerate(strands):
                strand.corners, strand.index = before[k]
                gone[k] = np.zeros_like(gone[k])
        if not any(g.any() for g in gone):
            break  # the flattest are asked first
        barred = [(b | a)[~g] for b, a, g in zip(barred, asked, gone, strict=True)]
    return count - sum(len(s.corners) for s in strands)


def _choose(strand: Strand, barred: Mask, light: Array | None, limits: FitLimits) -> Mask:
    """Corners (m,) to take out together: those that stand out least from their neighbours' chord."""
    corners, m = strand.corners, len(strand.corners)
    chosen, free = np.zeros(m, dtype=bool), ~barred
    if m < 2 * _APART:
        return chosen
    first, last = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    chord = last - first
    size = np.maximum((chord * chord).sum(axis=1), 1e-18)
    share = np.clip(((corners - first) * chord).sum(axis=1) / size, 0.0, 1.0)
    foot = first + share[:, None] * chord
    height = np.linalg.norm(
        weigh_depth(corners - foot, corners, light, limits.depth_factor), axis=1
    )
    for j in np.argsort(height):
        if free[j] and height[j] <= _HIGHEST * limits.tolerance_mm:
            chosen[j] = True
            free[(j + np.arange(1 - _APART, _APART)) % m] = False
    return chosen


def _find_bad(
    strands: list[Strand], light: Array | None, limits: FitLimits, slack: float
) -> list[Mask]:
    """(m,) for each strand: whether its bend or straight j misses a limit by more than `slack`."""
    late = slack + ROUNDING
    wires = [round_corners(s.corners, limits.bend_radius_mm) for s in strands]
    gaps = measure_gaps(wires, limits)
    found = []
    for strand, wire, gap in zip(strands, wires, gaps, strict=True):
        sites, size = measure_distances(strand, wire, light, limits)
        bad = wire.straight < limits.min_straight_mm - late
        bad |= np.rad2deg(wire.turn) > limits.max_bend_deg + slack
        bad |= gap < limits.wire_diameter_mm - late
        bad[sites.piece[size > 1.0 + slack]] = True
        found.append(bad)
    return found


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
