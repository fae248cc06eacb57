"""Fit straights and bends of one radius to a closed centre line: few bends within a tolerance."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from knotfab.arrays import Array, Indices
from knotfab.geometry.sampling import sample_evenly
from knotfab.wire.arcs import Wire, WireSites, round_corners
from knotfab.wire.residual import FitLimits, Strand, compute_residual, measure_distances

__all__ = ["FitLimits", "fit_wires"]


_STEP_MM = 0.6  # between the points of the curve that are fitted
_LONGEST = 150  # points that one straight may stand for at first
_ROUNDS = 14
_PATIENCE = 5  # rounds without a better one
_NEAR_LIMIT = 0.93  # share of the tolerance
_ROUNDING = 0.01  # mm or degrees: what is no fault
_SPLIT_DEG = 70.0  # a bend that misses the curve and turns farther becomes two
_MERGED_DEG = 110.0  # the most that one corner in place of two may turn


def _first_corners(points: Array, scaled: Array, tolerance: float) -> Indices:
    """Corners (indices) of a polygon on the curve whose chords stay within a tolerance.

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


def fit_wires(curves: list[Array], light: Array | None, limits: FitLimits) -> list[Wire]:
    """Wires of straights and bends that follow closed curves, with few bends.

    Corners start on the curve (greedy chords of twice the tolerance, as the corners will be moved
    outwards), and are moved by damped Gauss-Newton steps so that the largest weighted distances
    shrink (iteratively reweighted), straights keep the length that the bender needs, and wires that
    would run into each other are pushed apart. Corners are added where a distance is still too
    large and taken out where a straight is too short. The best of all rounds is kept, which need
    not meet every limit: measure what comes back.

    Args:
        curves: (n, 3) each, mm. light: (3,) the point light of the one view; None, with several views:
            no direction is special.
    """
    strands = []
    for curve in curves:
        points = sample_evenly(curve, _STEP_MM, at_most=True)
        scaled = _flatten_depth(points, light, limits.depth_factor)
        index = _first_corners(points, scaled, 2.0 * limits.tolerance_mm)
        if len(index) < 3:
            index = np.arange(3) * (len(points) // 3)
        tolerance = np.full(len(points), limits.tolerance_mm)
        strands.append(Strand(points, scaled, points[index].copy(), index, tolerance))
    best, since = _judge(strands, light, limits), 0
    kept = [(s.corners, s.index) for s in strands]
    for number in range(_ROUNDS):
        _adjust(strands, light, limits, 15 if number == 0 else 8)
        fault, since = _judge(strands, light, limits), since + 1
        if number == 0 or fault < best:
            best, since = fault, 0
            kept = [(s.corners, s.index) for s in strands]
        for strand in strands:
            _settle(strand, limits)
        revised = [_revise(s, light, limits, number % 2 == 1) for s in strands]
        if not any(revised) or since >= _PATIENCE:
            break
    for strand, (corners, index) in zip(strands, kept, strict=True):
        strand.corners, strand.index = corners, index
    # with the limits met, the mean is worth more to the shadow than the largest distance: go as far
    # that way as the limits allow
    _adjust(strands, light, limits, 8, level=True)
    level = [s.corners for s in strands]
    for share in (1.0, 0.7, 0.4, 0.2, 0.0):
        for strand, (corners, _), aim in zip(strands, kept, level, strict=True):
            strand.corners = corners + share * (aim - corners)
        if _judge(strands, light, limits)[0] <= best[0]:
            break
    return [round_corners(s.corners, limits.bend_radius_mm) for s in strands]


def _flatten_depth(points: Array, light: Array | None, factor: float) -> Array:
    """The curve flattened along the light's axis, so that plain distances weigh depth less."""
    if light is None:
        return points
    axis = light / np.linalg.norm(light)
    return np.asarray(points - (1.0 - 1.0 / factor) * (points @ axis)[:, None] * axis)


def _adjust(
    strands: list[Strand],
    light: Array | None,
    limits: FitLimits,
    steps: int,
    level: bool = False,
) -> None:
    """Move the corners of all strands by Levenberg-Marquardt steps; numbers of corners stay.

    `level`: squares are summed as they are, but for those near the tolerance.
    """
    weights = [np.ones(len(s.points)) for s in strands]
    damping = 1e-2
    for number in range(steps):
        corners = [s.corners for s in strands]
        if number % 3 == 0:
            _reweight(strands, weights, light, limits, level)
        residual, jacobian = compute_residual(strands, corners, weights, light, limits, True)
        assert jacobian is not None
        normal, slope = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
        size, cost = normal.diagonal().mean(), float(residual @ residual)
        for _ in range(6):
            step = spsolve(normal + damping * size * sparse.eye(len(slope), format="csc"), -slope)
            tried, begun = [], 0
            for strand in strands:
                move = step[begun : begun + 3 * len(strand.corners)].reshape(-1, 3)
                begun += 3 * len(strand.corners)
                tried.append(strand.corners + move)
            after, _ = compute_residual(strands, tried, weights, light, limits, False)
            if np.isfinite(after).all() and float(after @ after) < cost:
                for strand, moved in zip(strands, tried, strict=True):
                    strand.corners = moved
                damping = max(damping / 5.0, 1e-6)
                break
            damping *= 5.0


def _reweight(
    strands: list[Strand],
    weights: list[Array],
    light: Array | None,
    limits: FitLimits,
    level: bool,
) -> None:
    """More weight where the distance is large: towards the smallest maximum (Lawson 1961)."""
    for number, strand in enumerate(strands):
        wire = round_corners(strand.corners, limits.bend_radius_mm)
        _, size = measure_distances(strand, wire, light, limits)
        if level:
            weights[number] = weights[number] * np.where(size > _NEAR_LIMIT, 4.0, 1.0)
            continue
        weight = weights[number] * np.sqrt(0.05 + np.minimum(size, 3.0))
        weights[number] = np.clip(weight / weight.mean(), 0.05, 20.0)


def _judge(
    strands: list[Strand], light: Array | None, limits: FitLimits
) -> tuple[float, float, float]:
    """How far the limits are missed: in all, by straights (mm) and bends (deg); number of bends."""
    excess, missing, bends = 0.0, 0.0, 0
    for strand in strands:
        wire = round_corners(strand.corners, limits.bend_radius_mm)
        _, size = measure_distances(strand, wire, light, limits)
        excess = max(excess, float(size.max()) - 1.0)
        missing = max(
            missing,
            limits.min_straight_mm - float(wire.straight.min()),
            float(np.rad2deg(wire.turn.max())) - limits.max_bend_deg,
        )
        bends += len(strand.corners)
    late = missing if missing > _ROUNDING else 0.0
    return round(late + max(excess, 0.0), 2), round(late, 2), float(bends)


def _settle(strand: Strand, limits: FitLimits) -> None:
    """Name anew the point of the curve that each corner stands for: the nearest to its bend."""
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
    # where a bend was found before the one it follows, the old names stay
    if (np.diff((found - found[0]) % n) > 0).all():
        strand.corners, strand.index = _in_order(strand.corners, found, n)


def _revise(strand: Strand, light: Array | None, limits: FitLimits, merging: bool) -> bool:
    """Add corners where the wire is too far off, take out those between which nothing fits."""
    wire = round_corners(strand.corners, limits.bend_radius_mm)
    sites, size = measure_distances(strand, wire, light, limits)
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
            elif turn[j] > _SPLIT_DEG:
                split.add(j)
            else:
                side = j if wire.straight[j] >= wire.straight[j - 1] else (j - 1) % m
                if wire.straight[side] >= needed:
                    add.setdefault(side, 0.5)
    split |= {int(j) for j in np.flatnonzero(turn > limits.max_bend_deg)}
    merge: set[int] = set()
    if merging:
        for j in (
            int(k) for k in np.flatnonzero(wire.straight < limits.min_straight_mm - _ROUNDING)
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
    strand.corners, strand.index = _in_order(np.array(corners), np.array(index), n)
    return True


def _in_order(corners: Array, index: Indices, n: int) -> tuple[Array, Indices]:
    """Corners in the wire's order from the curve's first point on, each with a point of its own."""
    rising = (index - index[0]) % n
    for k in range(1, len(rising)):
        rising[k] = max(rising[k], rising[k - 1] + 1)
    for k in range(len(rising) - 1, 0, -1):
        rising[k] = min(rising[k], n - len(rising) + k)
    named = (rising + index[0]) % n
    shift = int(named.argmin())
    return np.roll(corners, -shift, axis=0), np.roll(named, -shift)
