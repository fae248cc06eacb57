"""Fit straights and bends of one radius to a closed centre line: few bends within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from knotfab.apps.wire.arcs import Wire, WireSites, round_corners
from knotfab.apps.wire.residual import (
    DEPTH_FACTOR,
    FitLimits,
    GridLikeness,
    Strand,
    compute_residual,
    measure_distances,
    measure_gaps,
    measure_strays,
    weigh_depth,
)
from knotfab.base.arrays import Array, Indices, Mask
from knotfab.geometry.polylines import sample_evenly

_STEP_MM = 0.6  # spacing of the points sampled on the curve
_LONGEST = 150  # most points that a first chord may span
_CHORDS = 2.0  # tolerances by which a first chord may be off; corners are moved outwards later
_ROUNDS = 14
_PRUNINGS = 12  # most rounds of removing corners
_MERGED_DEG = 110.0  # largest turn of a corner that replaces two


def _first_corners(points: Array, scaled: Array, tolerance: float) -> Indices:
    """Return indices of curve points whose polygon stays within a tolerance of the curve.

    Greedy minimum-link approximation (Imai & Iri 1988): the longest valid chords are chained from each of
    the first points, and the chain with the fewest is returned.
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
        alive = alive[holds]  # where a chord failed, longer ones are not tried
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
    curves: list[Array], limits: FitLimits, pictures: Sequence[GridLikeness] = ()
) -> list[Wire]:
    """Fit wires of few straights and bends to closed curves.

    Corners start on the curve (greedy chords). Damped Gauss-Newton steps, iteratively reweighted, move them
    to shrink the largest distances, keep straights as long as the bender needs, and push strands apart.
    Corners are added where a distance stays too large, and removed where a straight is too short. The best
    round is returned. It need not meet every limit, so measure it.

    Args:
        curves: (n, 3) each, mm.
        pictures: the pictures whose likeness is maximised, within the tolerance.
    """
    strands = []
    for curve in curves:
        points = sample_evenly(curve, _STEP_MM, at_most=True)
        scaled = points
        if limits.light is not None:  # flattened along its axis, so that depth counts less
            axis = limits.light / np.linalg.norm(limits.light)
            scaled = points - (1.0 - 1.0 / DEPTH_FACTOR) * (points @ axis)[:, None] * axis
        index = _first_corners(points, scaled, _CHORDS * limits.tolerance_mm)
        if len(index) < 3:
            index = np.arange(3) * (len(points) // 3)
        tolerance = np.full(len(points), limits.tolerance_mm)
        strands.append(Strand(points, scaled, points[index].copy(), index, tolerance))
    best, since = measure_fault(strands, limits), 0
    kept = [(s.corners, s.index) for s in strands]
    for number in range(_ROUNDS):
        adjust(strands, limits, 15 if number == 0 else 8)
        fault, since = measure_fault(strands, limits), since + 1
        if number == 0 or fault < best:
            best, since = fault, 0
            kept = [(s.corners, s.index) for s in strands]
        for strand in strands:
            _match_corners(strand, limits)
        revised = [_revise(s, limits, number % 2 == 1) for s in strands]
        if not any(revised) or since >= 5 or limits.work.over:  # rounds without a better one
            break
    for strand, (corners, index) in zip(strands, kept, strict=True):
        strand.corners, strand.index = corners, index
        _match_corners(strand, limits)
    prune(strands, limits, _PRUNINGS)
    if pictures:
        prune(strands, limits, _PRUNINGS, pictures)
    pruned, worst = [s.corners for s in strands], measure_worst(strands, limits)
    # move towards the pictures as far as the limits allow
    adjust(strands, limits, 20, pictures)
    level = [s.corners for s in strands]
    for share in (1.0, 0.7, 0.4, 0.2, 0.0):
        for strand, corners, aim in zip(strands, pruned, level, strict=True):
            strand.corners = corners + share * (aim - corners)
        if (measure_worst(strands, limits) <= worst).all():
            break
    return [round_corners(s.corners, limits.bend_radius_mm) for s in strands]


def _revise(strand: Strand, limits: FitLimits, merging: bool) -> bool:
    """Add corners where the wire is too far off and, if `merging`, merge those with too short a straight.

    Returns whether anything changed.
    """
    wire = round_corners(strand.corners, limits.bend_radius_mm)
    sites, size = measure_distances(strand, wire, limits.light)
    m, n = len(strand.corners), len(strand.points)
    turn = np.rad2deg(wire.turn)
    needed = 2.0 * limits.min_straight_mm
    add: dict[int, float] = {}  # straight: share at which a corner is added
    split: set[int] = set()
    far = np.zeros(m)
    np.maximum.at(far, sites.piece, size)
    # of neighbours that are off only the worst: its corner may mend the others too
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
            elif turn[j] > 70.0:  # degrees: a sharper bend becomes two
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
    strand.corners, strand.index = _order_corners(np.array(corners), np.array(index), n)
    return True


# removing corners

_APART = 6  # corners between two removed at once, so that their effects do not mix
_NEAR = (2, 3, 6, 12)  # pieces to either side of a bad one whose old corners return, by try
_ADJUSTED = 2  # first tries before which the other corners are moved
_STEPS = 5
_HIGHEST = 8.0  # tolerances by which a removed corner may stand out from its neighbours' chord


def prune(
    strands: list[Strand], limits: FitLimits, rounds: int, pictures: Sequence[GridLikeness] = ()
) -> int:
    """Remove corners as long as no limit gets worse. Returns how many were removed.

    Each round removes the flattest corners that are far enough apart, and moves the others to make up for
    it, towards `pictures` if given. Where that fails the old corners return for good. Wires that miss a
    limit by more than a little are left alone.
    """
    barred = [np.zeros(len(s.corners), dtype=bool) for s in strands]
    count = sum(len(s.corners) for s in strands)
    worst = measure_worst(strands, limits)
    if (worst > 0.1).any():
        return 0
    for _ in range(rounds):
        before = [(s.corners, s.index) for s in strands]
        gone = [_choose_flattest(s, b, limits) for s, b in zip(strands, barred, strict=True)]
        if not any(g.any() for g in gone) or limits.work.over:
            break
        asked = [g.copy() for g in gone]
        for strand, g in zip(strands, gone, strict=True):
            strand.corners, strand.index = strand.corners[~g], strand.index[~g]
        for number in range(len(_NEAR) + 1):
            if number < _ADJUSTED:
                adjust(strands, limits, _STEPS, pictures)
            misses = measure_misses(strands, limits)
            bad = [np.asarray((m > worst).any(axis=1)) for m in misses]
            if not any(b.any() for b in bad):
                break
            for k, strand in enumerate(strands):
                if number < len(_NEAR):
                    gone[k] = _bring_back(strand, *before[k], gone[k], bad[k], _NEAR[number])
                else:  # give up: all of them return
                    strand.corners, strand.index = before[k]
                    gone[k] = np.zeros_like(gone[k])
        barred = [(b | a)[~g] for b, a, g in zip(barred, asked, gone, strict=True)]
    return count - sum(len(s.corners) for s in strands)


def _choose_flattest(strand: Strand, barred: Mask, limits: FitLimits) -> Mask:
    """Choose corners (m,) to remove together: those that stand out least from their neighbours' chord."""
    corners, m = strand.corners, len(strand.corners)
    chosen, free = np.zeros(m, dtype=bool), ~barred
    if m < 2 * _APART:
        return chosen
    first, last = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    chord = last - first
    size = np.maximum((chord * chord).sum(axis=1), 1e-18)
    share = np.clip(((corners - first) * chord).sum(axis=1) / size, 0.0, 1.0)
    foot = first + share[:, None] * chord
    height = np.linalg.norm(weigh_depth(corners - foot, corners, limits.light), axis=1)
    for j in np.argsort(height):
        if free[j] and height[j] <= _HIGHEST * limits.tolerance_mm:
            chosen[j] = True
            free[(j + np.arange(1 - _APART, _APART)) % m] = False
    return chosen


def _bring_back(
    strand: Strand, corners: Array, index: Indices, gone: Mask, bad: Mask, reach: int
) -> Mask:
    """Put the old corners back around all bad pieces. Returns which old ones (m,) are still gone."""
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


# moving corners, and measuring how far the limits are missed

Fault = tuple[float, float, float]  # see `measure_fault`
ROUNDING = 0.01  # mm or degrees by which a limit may be missed without fault


def adjust(
    strands: list[Strand], limits: FitLimits, steps: int, pictures: Sequence[GridLikeness] = ()
) -> None:
    """Move the corners of all strands by Levenberg-Marquardt steps, until the work of the limits is used up.

    They move towards the curves or, with `pictures`, to where the wires draw these within tolerance.
    """
    weights = [np.ones(len(s.points)) for s in strands]
    damping = 1e-2
    for number in range(steps):
        corners = [s.corners for s in strands]
        if number % 3 == 0 and not pictures:
            _reweight(strands, weights, limits)
        residual, jacobian = compute_residual(strands, corners, weights, limits, True, pictures)
        assert jacobian is not None
        normal, slope = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
        size, cost = normal.diagonal().mean(), float(residual @ residual)
        for _ in range(6):
            if limits.work.over:
                return
            limits.work.points -= sum(len(s.points) for s in strands)
            step = spsolve(normal + damping * size * sparse.eye(len(slope), format="csc"), -slope)
            tried, begun = [], 0
            for strand in strands:
                move = step[begun : begun + 3 * len(strand.corners)].reshape(-1, 3)
                begun += 3 * len(strand.corners)
                tried.append(strand.corners + move)
            after, _ = compute_residual(strands, tried, weights, limits, False, pictures)
            if np.isfinite(after).all() and float(after @ after) < cost:
                for strand, moved in zip(strands, tried, strict=True):
                    strand.corners = moved
                damping = max(damping / 5.0, 1e-6)
                break
            damping *= 5.0


def _reweight(strands: list[Strand], weights: list[Array], limits: FitLimits) -> None:
    """Raise the weights where distances are large, to minimise the largest one (Lawson 1961)."""
    for number, strand in enumerate(strands):
        wire = round_corners(strand.corners, limits.bend_radius_mm)
        _, size = measure_distances(strand, wire, limits.light)
        weight = weights[number] * np.sqrt(0.05 + np.minimum(size, 3.0))
        weights[number] = np.clip(weight / weight.mean(), 0.05, 20.0)


def measure_misses(strands: list[Strand], limits: FitLimits) -> list[Array]:
    """Measure by how much each piece of each strand misses each limit, (m, 4); negative where it is kept.

    The columns: distance beyond the tolerance (as a share of it), length that the straight lacks (mm),
    excess angle of the bend (degrees), overlap with another strand (mm).
    """
    wires = [round_corners(s.corners, limits.bend_radius_mm) for s in strands]
    found = []
    for strand, wire, gap in zip(strands, wires, measure_gaps(wires, limits), strict=True):
        sites, size = measure_distances(strand, wire, limits.light)
        far = np.full(len(wire.corners), -1.0)
        np.maximum.at(far, sites.piece, size - 1.0)
        sites, offset, _ = measure_strays(strand, wire, limits)
        np.maximum.at(far, sites.piece, np.linalg.norm(offset, axis=1) - 1.0)
        short = limits.min_straight_mm - wire.straight
        sharp = np.rad2deg(wire.turn) - limits.max_bend_deg
        found.append(np.column_stack([far, short, sharp, limits.wire_diameter_mm - gap]))
    return found


def measure_worst(strands: list[Strand], limits: FitLimits) -> Array:
    """Return by how much each limit is missed at worst, (4,) as in `measure_misses`; 0 where it is kept."""
    return np.asarray(np.vstack(measure_misses(strands, limits)).max(axis=0).clip(0.0))


def measure_fault(strands: list[Strand], limits: FitLimits) -> Fault:
    """Rank a fit, lower is better: by all limits missed, then by those of the bender, then by its bends."""
    excess, *rest = measure_worst(strands, limits)
    late = max(rest) if max(rest) > ROUNDING else 0.0
    bends = sum(len(s.corners) for s in strands)
    return round(float(late + excess), 2), round(float(late), 2), float(bends)


def _match_corners(strand: Strand, limits: FitLimits) -> None:
    """Assign to each corner the curve point nearest to the middle of its bend."""
    wire = round_corners(strand.corners, limits.bend_radius_mm)
    m, n = len(strand.corners), len(strand.points)
    middle = wire.at(WireSites(np.arange(m), np.ones(m, dtype=bool), np.full(m, 0.5)))
    left, right = np.roll(strand.index, 1), np.roll(strand.index, -1)
    found = np.empty(m, dtype=np.int64)
    for j in range(m):
        span = int((right[j] - left[j]) % n)
        window = (left[j] + 1 + np.arange(max(span - 1, 1))) % n
        gap = strand.points[window] - middle[j]
        found[j] = window[int((gap * gap).sum(axis=1).argmin())]
    # points that are not in order are not taken
    if (np.diff((found - found[0]) % n) > 0).all():
        strand.corners, strand.index = _order_corners(strand.corners, found, n)


def _order_corners(corners: Array, index: Indices, n: int) -> tuple[Array, Indices]:
    """Rotate the corners to start at the curve's first point, and make their curve points distinct."""
    rising = (index - index[0]) % n
    for k in range(1, len(rising)):
        rising[k] = max(rising[k], rising[k - 1] + 1)
    for k in range(len(rising) - 1, 0, -1):
        rising[k] = min(rising[k], n - len(rising) + k)
    named = (rising + index[0]) % n
    shift = int(named.argmin())
    return np.roll(corners, -shift, axis=0), np.roll(named, -shift)
