"""Fit straights and bends of one radius to a closed centre line: few bends within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.sampling import sample_evenly
from knotfab.wire.adjust import ROUNDING, adjust, in_order, judge, measure_worst, settle
from knotfab.wire.arcs import Wire, WireSites, round_corners
from knotfab.wire.likeness import GridLikeness
from knotfab.wire.prune import prune
from knotfab.wire.residual import DEPTH_FACTOR, FitLimits, Strand, measure_distances

__all__ = ["FitLimits", "fit_wires"]


_STEP_MM = 0.6  # between the points of the curve that are fitted
_LONGEST = 150  # points that one straight may stand for at first
_CHORDS = 2.0  # tolerances that a chord may be off at first: corners will be moved outwards
_ROUNDS = 14
_PRUNINGS = 12  # rounds at most of taking corners out
_MERGED_DEG = 110.0  # the most that one corner in place of two may turn


def _first_corners(points: Array, scaled: Array, tolerance: float) -> Indices:
    """Return corners (indices) of a polygon on the curve whose chords stay within a tolerance.

    The longest chord from each point is taken in turn, from each of the first points as a start,
    and the shortest chain kept: the greedy form of minimum-link approximation (Imai & Iri 1988).
    """
    n = len(points)
    reach = np.ones(n, dtype=np.int64)
    alive = np.arange(n)
    for span in range(2, min(_LONGEST, n // 3)):
        chord = scaled[(alive + span) % n] - scaled[alive]
        size = np.maximum((chord * chord).sum(axis=1), 1e-18)
        worst = np.zeros(len(alive))
        for k in range(1, span):
            offset = scaled[(alive + k) % n] - scaled[alive]
            share = np.clip((offset * chord).sum(axis=1) / size, 0.0, 1.0)
            gap = offset - share[:, None] * chord
            worst = np.maximum(worst, (gap * gap).sum(axis=1))
        holds = worst <= tolerance**2
        reach[alive[holds]] = span
        alive = alive[holds]  # a chord that failed is not asked for longer ones
        if not len(alive):
            break
    best: list[int] = []
    for start in range(int(reach[0]) + 1):
        chain = [start]
        while chain[-1] + reach[chain[-1] % n] < start + n:
            chain.append(int(chain[-1] + reach[chain[-1] % n]))
        if not best or len(chain) < len(best):
            best = chain
    return np.sort(np.array(best) % n)


def fit_wires(
    curves: list[Array],
    light: Array | None,
    limits: FitLimits,
    pictures: Sequence[GridLikeness] = (),
) -> list[Wire]:
    """Return wires of straights and bends that follow closed curves, with few bends.

    Corners start on the curve (greedy chords), and are moved by damped Gauss-Newton steps so that the
    largest weighted distances shrink (iteratively reweighted), straights keep the length that the bender
    needs, and wires that would run into each other are pushed apart. Corners are added where a distance is
    still too large and taken out where a straight is too short. The best of all rounds is kept, which
    need not meet every limit: measure what comes back.

    Args:
        curves: (n, 3) each, mm. light: (3,) the point light of the one view; None, with several views:
            no direction is special.
        pictures: what the wires are to draw, within the tolerance.
    """
    strands = []
    for curve in curves:
        points = sample_evenly(curve, _STEP_MM, at_most=True)
        scaled = _flatten_depth(points, light)
        index = _first_corners(points, scaled, _CHORDS * limits.tolerance_mm)
        if len(index) < 3:
            index = np.arange(3) * (len(points) // 3)
        tolerance = np.full(len(points), limits.tolerance_mm)
        strands.append(Strand(points, scaled, points[index].copy(), index, tolerance))
    best, since = judge(strands, light, limits), 0
    kept = [(s.corners, s.index) for s in strands]
    for number in range(_ROUNDS):
        adjust(strands, light, limits, 15 if number == 0 else 8)
        fault, since = judge(strands, light, limits), since + 1
        if number == 0 or fault < best:
            best, since = fault, 0
            kept = [(s.corners, s.index) for s in strands]
        for strand in strands:
            settle(strand, limits)
        revised = [_revise(s, light, limits, number % 2 == 1) for s in strands]
        if not any(revised) or since >= 5 or limits.work.over:  # rounds without a better one
            break
    for strand, (corners, index) in zip(strands, kept, strict=True):
        strand.corners, strand.index = corners, index
        settle(strand, limits)
    prune(strands, light, limits, _PRUNINGS)
    if pictures:
        prune(strands, light, limits, _PRUNINGS, pictures)
    pruned, worst = [s.corners for s in strands], measure_worst(strands, light, limits)
    # once the limits are met, go towards the picture as far as they allow
    adjust(strands, light, limits, 20, pictures)
    level = [s.corners for s in strands]
    for share in (1.0, 0.7, 0.4, 0.2, 0.0):
        for strand, corners, aim in zip(strands, pruned, level, strict=True):
            strand.corners = corners + share * (aim - corners)
        if (measure_worst(strands, light, limits) <= worst).all():
            break
    return [round_corners(s.corners, limits.bend_radius_mm) for s in strands]


def _flatten_depth(points: Array, light: Array | None) -> Array:
    """Return the curve flattened along the light's axis, so that plain distances weigh depth less."""
    if light is None:
        return points
    axis = light / np.linalg.norm(light)
    return np.asarray(points - (1.0 - 1.0 / DEPTH_FACTOR) * (points @ axis)[:, None] * axis)


def _revise(strand: Strand, light: Array | None, limits: FitLimits, merging: bool) -> bool:
    """Add corners where the wire is too far off, take out those between which nothing fits."""
    wire = round_corners(strand.corners, limits.bend_radius_mm)
    sites, size = measure_distances(strand, wire, light)
    m, n = len(strand.corners), len(strand.points)
    turn = np.rad2deg(wire.turn)
    needed = 2.0 * limits.min_straight_mm
    add: dict[int, float] = {}  # straight: share at which a corner is added
    split: set[int] = set()
    far = np.zeros(m)
    np.maximum.at(far, sites.piece, size)
    # one of several neighbours that are off: the others may then come right without a corner
    peak = (far > 1.0) & (far >= np.roll(far, 1)) & (far >= np.roll(far, -1))
    for j in (int(k) for k in np.flatnonzero(peak)):
        for is_bend in (False, True):
            own = np.flatnonzero((sites.piece == j) & (sites.bend == is_bend))
            if not len(own) or size[own].max() <= 1.0:
                continue
            worst = own[size[own].argmax()]
            if not is_bend:
                if wire.straight[j] >= needed:
                    add[j] = float(np.clip(sites.share[worst], 0.2, 0.8))
            elif turn[j] > 70.0:  # a bend that misses the curve and turns farther becomes two
                split.add(j)
            else:
                side = j if wire.straight[j] >= wire.straight[j - 1] else (j - 1) % m
                if wire.straight[side] >= needed:
                    add.setdefault(side, 0.5)
    split |= {int(j) for j in np.flatnonzero(turn > limits.max_bend_deg)}
    merge: set[int] = set()
    if merging:
        for j in (
            int(k) for k in np.flatnonzero(wire.straight < limits.min_straight_mm - ROUNDING)
        ):
            both = turn[j] + turn[(j + 1) % m]
            free = not ({j - 1, j, j + 1} & merge) and j + 1 < m and m - len(merge) > 4
            if free and both < _MERGED_DEG and not ({j, j + 1} & split):
                merge.add(j)
    if not (add or split or merge):
        return False
    corners: list[Array] = []
    index: list[int] = []
    for j in range(m):
        following, here = (j + 1) % m, int(strand.index[j])
        span = int((strand.index[following] - here) % n)
        if j - 1 in merge:
            continue
        if j in merge:
            share = turn[following] / max(float(turn[j] + turn[following]), 1e-9)
            corners.append((1 - share) * strand.corners[j] + share * strand.corners[following])
            index.append(here + round(share * span))
            continue
        before = int((here - strand.index[j - 1]) % n)
        if j in split and before > 2 and span > 2:
            corners += [wire.entry[j], wire.exit[j]]
            index += [here - min(before // 3, 3), here + min(span // 3, 3)]
        else:
            corners.append(strand.corners[j])
            index.append(here)
        if j in add and span > 6:
            at = WireSites(np.array([j]), np.array([False]), np.array([add[j]]))
            corners.append(wire.at(at)[0])
            index.append(here + round(add[j] * span))
    strand.corners, strand.index = in_order(np.array(corners), np.array(index), n)
    return True
