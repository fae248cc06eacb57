"""Find the places of centre lines that face each other, and neighbours along the same strand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.sampling import cut_edges

__all__ = ["Samples", "StrandPairs", "sample_curves", "strand_pairs"]


MOST_SAMPLES = 200_000  # the limit on absurdly long curves
MOST_MOVES = (
    20_000_000  # moves of pairs, all steps together; 11 m of a thin tube take 4 million, in 4 s
)
MOST_PAIRS = 20_000_000
STEPS = tuple((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b)


@dataclass(frozen=True)
class Samples:
    """Points along closed polygons, in order; all arrays have one entry a sample (n)."""

    point: Array  # (n, 3)
    knot: Ints
    edge: Ints  # counted over all polygons
    arc: Array  # length along its knot
    ahead: Ints
    behind: Ints
    lengths: Array  # (knots,)
    step: float  # no piece between two samples is longer


@dataclass(frozen=True)
class StrandPairs:
    """Pairs i < j of samples that are near in space and are not neighbours along one strand.

    `facing`: pairs of two knots, or of two strands of one: from there the distance falls to a minimum
    above zero, not to zero. `far`: pairs of two knots, or at least `apart` along their knot.
    """

    i: Ints
    j: Ints
    facing: Mask
    far: Mask


def sample_curves(polygons: Sequence[Array], step: float) -> Samples:
    """Return samples at most `step` apart on the edges of closed polygons, and all their vertices."""
    total = sum(float(np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum()) for p in polygons)
    step = max(step, total / MOST_SAMPLES)
    point, knot, edge, arc, ahead, behind, lengths = [], [], [], [], [], [], []
    offset = edges = 0
    for k, polygon in enumerate(polygons):
        span = np.roll(polygon, -1, axis=0) - polygon
        length = np.linalg.norm(span, axis=1)
        which, part, _ = cut_edges(polygon, np.roll(polygon, -1, axis=0), step)
        point.append(polygon[which] + part[:, None] * span[which])
        arc.append((np.cumsum(length) - length)[which] + part * length[which])
        index = np.arange(len(which))
        ahead.append(np.roll(index, -1) + offset)
        behind.append(np.roll(index, 1) + offset)
        knot.append(np.full(len(which), k))
        edge.append(which + edges)
        lengths.append(float(length.sum()))
        offset += len(which)
        edges += len(polygon)
    return Samples(
        point=np.concatenate(point),
        knot=np.concatenate(knot),
        edge=np.concatenate(edge),
        arc=np.concatenate(arc),
        ahead=np.concatenate(ahead),
        behind=np.concatenate(behind),
        lengths=np.array(lengths),
        step=step,
    )


def strand_pairs(samples: Samples, reach: float, apart: float) -> StrandPairs:
    """Return pairs of samples up to `reach` from each other that face each other or are `apart`.

    Whether two places of a knot face each other is found by descent: both are moved along the
    curve, sample by sample, as long as that lowers their distance. Neighbours meet; what does not
    meet is two strands. So a bend is no gap, whatever its length and radius, and strands are
    two however soon the curve comes back.

    Raises:
        ValueError: there are more than 20 million pairs within `reach`, or strands run side by side
            for so long that the descent would not end soon.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(samples.point)
    if tree.count_neighbors(tree, reach) > 2 * MOST_PAIRS:
        raise ValueError("the centre lines are so crowded that strands cannot be told apart")
    pairs = tree.query_pairs(reach, output_type="ndarray").astype(np.int64)
    i, j = pairs.min(axis=1), pairs.max(axis=1)
    other = samples.knot[i] != samples.knot[j]
    along = np.abs(samples.arc[i] - samples.arc[j])
    along = np.minimum(along, samples.lengths[samples.knot[i]] - along)
    far = other | (along >= apart)
    facing = other.copy()
    same = np.flatnonzero(~other)
    facing[same] = ~_meet(samples, i[same], j[same])
    keep = facing | far
    return StrandPairs(i[keep], j[keep], facing[keep], far[keep])


def _meet(samples: Samples, i: Ints, j: Ints) -> Mask:
    """Tell whether the descent from each pair of one knot ends where both are the same place."""
    count = np.int64(len(samples.point))
    start, where = np.unique(i * count + j, return_inverse=True)
    now = start.copy()
    active = np.arange(len(now))
    moves = 0
    for _ in range(10_000):
        if not len(active):
            break
        moves += len(active)
        if moves > MOST_MOVES:
            raise ValueError("strands run side by side for too long to be told apart")
        # pairs that have come to the same place go on as one
        unique, back = np.unique(now[active], return_inverse=True)
        moved = _lower(samples, unique // count, unique % count, count)[back]
        changed = moved != now[active]
        now[active] = moved
        active = active[changed]
    one, other = now // count, now % count
    near = (one == other) | (samples.ahead[one] == other) | (samples.behind[one] == other)
    result: Mask = near[where]
    return result


def _lower(samples: Samples, i: Ints, j: Ints, count: np.int64) -> Ints:
    """Return the pair, among each pair's eight neighbours and itself, with the least distance."""
    to_i = {-1: samples.behind[i], 0: i, 1: samples.ahead[i]}
    to_j = {-1: samples.behind[j], 0: j, 1: samples.ahead[j]}
    best, at = _square(samples, i, j) * (1 - 1e-12), i * count + j
    for a, b in STEPS:
        square = _square(samples, to_i[a], to_j[b])
        less = square < best
        best = np.where(less, square, best)
        at = np.where(less, to_i[a] * count + to_j[b], at)
    return at


def _square(samples: Samples, i: Ints, j: Ints) -> Array:
    d = samples.point[i] - samples.point[j]
    square: Array = np.einsum("ij,ij->i", d, d)
    return square
