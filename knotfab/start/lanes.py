"""Keep strands that hide each other from the light apart along its rays, by lanes or by their order.

A curve that runs along strokes there and back hides itself. Each pass gets a lane, an integer number of half
separations, so that passes in one place differ by two or more. Lanes are assigned stretch by stretch, each
optimal (Viterbi 1967) given the others. Then depths are moved until the strands are far enough apart,
slopes included.

Where the two sides of a filled stroke hide each other, their depths are ordered already. If the order changed
along the stretch, one side would have to step aside past the other and bump the outline. So the order that
prevails along the stretch is made to hold on all of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.polylines import (
    arc_lengths,
    pair_nearby,
    polylines_of,
    sample_evenly,
    split_alike,
)

_LANES = 8  # lanes on either side of the middle
_STEP = 0.5  # distance between samples, each with a lane, in separations
_TURNED = 0.5  # straight distance over that along the curve, below which it turns at a stroke's end
_HIDDEN = (1.5, 1.0)  # price of a hidden sample in the same lane, and in the next one
_CHANGE, _ASIDE = 0.15, 0.02  # price of a change by one lane, and of each lane off the middle
_STRETCHES = (4, 8, 16, 6, 12, 5, 10, 4, 3)  # samples that are reassigned together, in each round
_ROOM = 1.03  # distance that strands are moved to, in separations
_ROUNDS = 60  # rounds of moving them apart
# width over which a move is spread along the strand, in separations: passes stay close all along, while
# sides meet now and then and keep their slopes
_PASSES, _SIDES = 0.3, 1.0


def assign_lanes(curves: tuple[Array, ...], separation: float) -> tuple[Array, ...]:
    """Return a smooth lane for each vertex of closed planar curves [(n, 2) mm], (n,) in half separations."""
    samples = [sample_evenly(curve, _STEP * separation) for curve in curves]
    near = _Neighbours(samples, separation)
    lanes: Array = np.full(near.count, np.nan)
    for turn, most in enumerate(_STRETCHES):
        for first, size in near.curves():
            stretch = min(most, size)
            shift = turn * stretch // len(_STRETCHES)
            for begin in range(0, size, stretch):
                block = first + (shift + begin + np.arange(min(stretch, size - begin))) % size
                before = first + (block[0] - first - 1) % size
                after = first + (block[-1] - first + 1) % size
                lanes[block] = _best_lanes(near.prices(block, lanes), lanes[before], lanes[after])
    found = []
    for (first, size), curve, sample in zip(near.curves(), curves, samples, strict=True):
        smooth = gaussian_filter1d(lanes[first : first + size], 1.0, mode="wrap")
        share = arc_lengths(sample)[:-1] / arc_lengths(sample)[-1]
        at = arc_lengths(curve)[:-1] / arc_lengths(curve)[-1]
        found.append(np.interp(at, share, smooth, period=1.0))
    return tuple(found)


class _Neighbours:
    """The samples of all curves, concatenated, and which of them hide each other."""

    def __init__(self, samples: list[Array], separation: float) -> None:
        self.sizes = [len(s) for s in samples]
        self.count = sum(self.sizes)
        pairs, along = _hiding(samples, separation)
        pairs = pairs[along >= 0.99 * separation]
        both = np.concatenate([pairs, pairs[:, ::-1]])
        both = both[np.argsort(both[:, 0], kind="stable")]
        self.of = np.searchsorted(both[:, 0], np.arange(self.count + 1))
        self.others = both[:, 1]

    def curves(self) -> Iterator[tuple[int, int]]:
        """Yield the index of each curve's first sample, and its number of samples."""
        first = 0
        for size in self.sizes:
            yield first, size
            first += size

    def prices(self, block: Indices, lanes: Array) -> Array:
        """Return the price of each sample of a stretch in each lane, given the other lanes, (k, lanes)."""
        levels = np.arange(-_LANES, _LANES + 1)
        prices = np.tile(_ASIDE * np.abs(levels), (len(block), 1))
        inside = set(block.tolist())
        for row, sample in enumerate(block.tolist()):
            others = self.others[self.of[sample] : self.of[sample + 1]]
            taken = lanes[[o for o in others.tolist() if o not in inside]]
            gap = np.abs(levels[:, None] - taken[np.isfinite(taken)])
            same, beside = gap < 0.5, np.abs(gap - 1) < 0.5
            prices[row] += _HIDDEN[0] * same.sum(1) + _HIDDEN[1] * beside.sum(1)
        return prices


def _best_lanes(prices: Array, before: float, after: float) -> Array:
    """Return the cheapest lanes of a stretch, in steps of at most one.

    `before` and `after` are the lanes next to it, nan if they are open.
    """
    levels = np.arange(prices.shape[1]) - _LANES
    score = np.zeros(len(levels))
    if np.isfinite(before):
        score = np.where(np.abs(levels - before) <= 1, _CHANGE * np.abs(levels - before), 1e3)
    came = []
    for price in prices:
        score = score + price
        came.append(score)
        up = np.concatenate([[np.inf], score[:-1]]) + _CHANGE
        down = np.concatenate([score[1:], [np.inf]]) + _CHANGE
        score = np.minimum(score, np.minimum(up, down))
    last = came[-1]
    if np.isfinite(after):
        far = np.abs(levels - after)
        last = last + np.where(far <= 1, _CHANGE * far, 1e3 * far)
    path = [int(last.argmin())]
    for score in reversed(came[:-1]):
        here = path[-1]
        nearby = range(max(0, here - 1), min(len(levels), here + 2))
        path.append(min(nearby, key=lambda k: score[k] + _CHANGE * abs(k - here)))
    return levels[path[::-1]].astype(np.float64)


def _hiding(samples: list[Array], separation: float) -> tuple[Indices, Array]:
    """Find pairs of samples closer than the separation, (k, 2), and their distances along the curve, (k,).

    Neighbours along a curve are left out unless it turns back there. Between curves the distance is infinite.
    """
    points = np.concatenate(samples)
    pairs, along = pair_nearby(samples, separation)
    i, j = pairs[:, 0], pairs[:, 1]
    turned = np.hypot(*(points[i] - points[j]).T) < _TURNED * along
    # within 2.5 separations along the curve a strand is its own neighbour
    found = (along > 2.5 * separation) | turned
    return np.asarray(pairs[found]), along[found]


def part_passes(
    curves: tuple[Array, ...],
    depths: tuple[Array, ...],
    lanes: tuple[Array, ...],
    separation: float,
    light_distance: float,
) -> tuple[Array, ...]:
    """Move depths, in the order of the lanes, until strands that hide each other are a separation apart.

    Args:
        curves: closed planar polylines [(n, 2) mm], evenly sampled. depths: [(n,) mm] towards the light.
        lanes: from `assign_lanes`.
    """
    plane, lane, depth = (np.concatenate(each) for each in (curves, lanes, depths))
    pairs, along = _hiding(list(curves), separation)
    # a strand that turns back does so in a half circle, as wide as the separation, along the rays
    turn = np.minimum(along / separation, 1.0)
    apart = _ROOM * separation * np.sqrt(turn * (2.0 - turn))
    one, other = pairs[:, 0], pairs[:, 1]
    swap = lane[one] < lane[other]
    above, below = np.where(swap, other, one), np.where(swap, one, other)
    moved = _move_apart(
        curves, plane, depth, above, below, apart, light_distance, _PASSES * separation
    )
    return tuple(split_alike(moved, curves))


def part_sides(
    samples: tuple[Array, ...],
    depths: Array,
    pairs: tuple[Indices, Indices],
    separation: float,
    light_distance: float,
) -> Array:
    """Return the moves (N,), mm along the rays, that part strands that hide each other.

    Args:
        samples: closed planar polylines [(n, 2) mm], evenly sampled, N points in all.
        depths: (N,) mm towards the light. pairs: indices of samples that hide each other.
    """
    one, other = pairs
    if not len(one):
        return np.zeros_like(depths)
    # take each pair in both orders, since the order of indices changes where a curve begins
    a, b = np.concatenate([one, other]), np.concatenate([other, one])
    stretch = number_stretches(a, b, [len(s) for s in samples])
    swap = np.bincount(stretch, depths[a] - depths[b])[stretch[: len(one)]] < 0
    above, below = np.where(swap, other, one), np.where(swap, one, other)
    apart = np.full(len(one), _ROOM * separation)
    moved = _move_apart(
        samples,
        np.concatenate(samples),
        depths,
        above,
        below,
        apart,
        light_distance,
        _SIDES * separation,
    )
    return moved - depths


def number_stretches(one: Indices, other: Indices, sizes: list[int]) -> Indices:
    """Return for each ordered pair of samples the number of the stretch that it belongs to, (m,)."""
    count = sum(sizes)
    ends = np.cumsum(sizes)
    after = np.arange(1, count + 1)
    after[ends - 1] = ends - sizes
    before = np.argsort(after)

    def key(a: Indices, b: Indices) -> Indices:
        return np.asarray(a * count + b)

    order = np.argsort(key(one, other))
    keys = key(one, other)[order]
    met = []
    for a, b in (
        (after[one], other),
        (one, after[other]),
        (after[one], after[other]),
        (after[one], before[other]),
    ):
        at = np.minimum(np.searchsorted(keys, key(a, b)), len(keys) - 1)
        found = np.flatnonzero(keys[at] == key(a, b))
        met.append(np.stack([found, order[at[found]]]))
    i, j = np.concatenate(met, axis=1)
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(keys), len(keys)))
    return np.asarray(connected_components(graph, directed=False)[1])


def _move_apart(
    curves: tuple[Array, ...],
    plane: Array,
    depth: Array,
    above: Indices,
    below: Indices,
    apart: Array,
    light_distance: float,
    along_mm: float,
) -> Array:
    """Move depths (N,) until each point of `above` is `apart` from that of `below`, or rounds run out.

    Args:
        plane: (N, 2) points of all curves, in the order of `depth`.
        along_mm: standard deviation of the Gaussian that spreads a move along the curve.
    """
    depth = depth.copy()
    bounds = polylines_of(curves).bounds
    steps = [arc_lengths(c)[-1] / len(c) for c in curves]
    least = 0.01 * apart.max(initial=0.0)
    for _ in range(_ROUNDS):
        near = 1.0 - depth / light_distance
        seen = plane * near[:, None]
        across = ((seen[above] - seen[below]) ** 2).sum(1)
        wanted = np.sqrt(np.maximum(apart**2 - across, 0.0))
        short = np.maximum(wanted - (depth[above] - depth[below]), 0.0)
        if short.max(initial=0.0) < least:
            break
        up, down = np.zeros_like(depth), np.zeros_like(depth)
        np.maximum.at(up, above, 0.5 * short)
        np.maximum.at(down, below, 0.5 * short)
        for a, b, step in zip(bounds[:-1], bounds[1:], steps, strict=True):
            depth[a:b] += gaussian_filter1d((up - down)[a:b], along_mm / step, mode="wrap")
    return depth
