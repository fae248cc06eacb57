"""A start for several views: one view's filling template, its depth chosen so that the others are drawn.

A curve that is simple as one light sees it may take any depth along its length: it stays an unknot.
So the strands that fill one silhouette sweep to and fro along the rays, where they draw the others
and spill least. The depths are found a stretch at a time, each the best (Viterbi 1967) for what
all other stretches leave undrawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter1d, uniform_filter

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.sampling import sample_evenly
from knotfab.problem import TargetView
from knotfab.render.picture import grid_at
from knotfab.start.depth import lower
from knotfab.start.filling import fill, simple_curves, smooth_closed

__all__ = ["deep_curves"]


_LEVEL = 0.7  # tube radii between depths
_STEP = 2.0  # tube radii between samples: as far apart as two sweeps must be
_CELL = 0.4  # of the grids on which the others are drawn, in tube radii
_STRETCH, _PASSES = 10, 4  # samples that are changed together; times that each is looked at
_PRICE = 0.1  # of a level swept, against a disc newly drawn
_FAR = 0.03  # of a tube radius further outside a silhouette, against a disc spilled
_MARGIN = 0.5  # of the frame on each side


@dataclass
class _Other:
    """A view that the depths draw: grids (h, w) of what is wanted and drawn, and a disc's cells (k, 2).

    `at` (n, levels, 2): the cell where each sample at each depth is seen; `spill` (n, levels): the share
    of a disc there that is outside.
    """

    wanted: NDArray[np.bool_]
    drawn: Indices
    disc: Indices
    at: Indices
    spill: Array

    def draw(self, samples: Indices, levels: Sequence[tuple[int, int]], sign: int) -> None:
        """Draw, or with sign -1 take back, the sweeps of these samples."""
        for n, (one, end) in zip(samples.tolist(), levels, strict=True):
            cells = self.at[n, min(one, end) : max(one, end) + 1]
            each = (cells[:, None] + self.disc).reshape(-1, 2)
            np.add.at(self.drawn, (each[:, 0], each[:, 1]), sign)

    def gains(self, samples: Indices) -> Array:
        """(k, levels) the share of a disc that is wanted and not drawn yet."""
        wide = 2 * int(self.disc.max()) + 1
        new = uniform_filter((self.wanted & (self.drawn == 0)).astype(np.float64), wide)
        at = self.at[samples]
        return np.asarray(new[at[..., 0], at[..., 1]])


def _look_from(target: TargetView, points: Array, radius: float) -> _Other:
    """The view's grids, with all samples at all depths (n, levels, 3) looked up."""
    cell_mm = _CELL * radius * target.view.magnification
    wanted, camera = grid_at(target.view, target.mask, cell_mm, _MARGIN, more=4)
    seen = camera.project(points.reshape(-1, 3))
    reach = int(np.ceil(1 / _CELL))
    limit = np.array(wanted.shape) - reach - 1
    cells = np.clip(np.rint(seen[:, ::-1]).astype(np.int64), reach, limit)
    signed = distance_transform_edt(wanted) - distance_transform_edt(~wanted)
    depth = _CELL * signed[cells[:, 0], cells[:, 1]]  # inside the silhouette, in tube radii
    outside = np.clip(0.5 * (1.0 - depth), 0.0, 1.0) + _FAR * np.maximum(-depth, 0.0)
    grid = np.argwhere(np.ones((2 * reach + 1, 2 * reach + 1))) - reach
    disc = grid[(grid**2).sum(1) <= (1 / _CELL) ** 2]
    shape = points.shape[:2]
    return _Other(
        wanted,
        np.zeros(wanted.shape, np.int64),
        disc,
        cells.reshape(*shape, 2),
        outside.reshape(shape),
    )


def _find_levels(gain: Array, first: int, last: int | None) -> list[int]:
    """Levels of the nodes about len(gain) samples, from `first` to `last`, that draw most.

    `gain` (n, levels): what each sample draws at each level that it sweeps over.
    """
    levels = np.arange(gain.shape[1])
    one, end = np.minimum.outer(levels, levels), np.maximum.outer(levels, levels) + 1
    price = _PRICE * (end - one)
    score = np.full(len(levels), -np.inf)
    score[first] = 0.0
    came = []
    for row in gain:
        total = np.concatenate([[0.0], np.cumsum(row)])
        each = score[:, None] + total[end] - total[one] - price
        came.append(each.argmax(0))
        score = each.max(0)
    node = int(score.argmax()) if last is None else last
    path = [node]
    for back in reversed(came):
        node = int(back[node])
        path.append(node)
    return path[::-1]


def _sweeps_of(nodes: list[int], samples: Indices) -> list[tuple[int, int]]:
    return [(nodes[n], nodes[(n + 1) % len(nodes)]) for n in samples.tolist()]


def _find_depths(others: list[_Other]) -> list[int]:
    """The level at each node of a closed curve: node n comes before sample n."""
    spill = np.sum([o.spill for o in others], axis=0)
    count = len(spill)
    begin = int(spill[[-1, 0]].sum(0).argmin())
    nodes = _find_levels(-spill, begin, begin)[:-1]
    every = np.arange(count)
    for other in others:
        other.draw(every, _sweeps_of(nodes, every), 1)
    stretch = min(_STRETCH, count - 1)
    for turn in range(_PASSES):
        for start in range(turn * stretch // _PASSES, count, stretch):
            samples = (start + np.arange(stretch)) % count
            for other in others:
                other.draw(samples, _sweeps_of(nodes, samples), -1)
            gain = np.sum([o.gains(samples) for o in others], axis=0) - spill[samples]
            last = (start + stretch) % count
            found = _find_levels(gain, nodes[samples[0]], nodes[last])
            for n, level in zip(samples.tolist(), found, strict=False):
                nodes[n] = level
            for other in others:
                other.draw(samples, _sweeps_of(nodes, samples), 1)
    return nodes


def deep_curves(
    views: Sequence[TargetView],
    facing: int,
    radius: float,
    step: float,
    reach: float,
) -> list[Array] | None:
    """Closed polylines (n, 3), mm, simple as the light of view `facing` sees them; else None.

    Args:
        views: two or more.
        radius: tube radius, mm.
        step: between vertices, mm.
        reach: the largest depth before and behind the middle, mm.
    """
    right, up, towards = views[facing].axes
    light = views[facing].view.light_distance_mm
    rest = [target for n, target in enumerate(views) if n != facing]
    half = int(reach / (_LEVEL * radius))
    depths = _LEVEL * radius * np.arange(-half, half + 1)

    def placed(flat: Array, depth: Array) -> Array:
        """Where the rays through points (..., 2) of the middle plane stand at a depth."""
        near = 1.0 - depth / light
        plane = flat[..., :1] * right + flat[..., 1:] * up
        return np.asarray(near[..., None] * plane + depth[..., None] * towards)

    curves, flats = [], []
    for curve in fill(views[facing].left or views[facing].polygon, radius, 1).curves:
        fine = sample_evenly(curve, 0.25 * radius)
        every = round(_STEP / 0.25)
        count = max(4, len(fine) // every)
        at = np.arange(count) * len(fine) / count
        middle = fine[np.rint(at + 0.5 * len(fine) / count).astype(int) % len(fine)]
        where = np.repeat(middle[:, None], len(depths), axis=1)
        points = placed(where, np.broadcast_to(depths, where.shape[:2]))
        nodes = _find_depths([_look_from(target, points, radius) for target in rest])
        nearest = np.rint(np.arange(len(fine)) * count / len(fine)).astype(int) % count
        # at each node its own level, and the sweeps between them as steep as the samples allow
        deep = gaussian_filter1d(depths[nodes][nearest], 2.0, mode="wrap")
        solid = smooth_closed(sample_evenly(placed(fine, deep), 0.25 * radius), 1.0)
        solid = sample_evenly(solid, step)
        curves.append(solid)
        along = solid @ np.stack([right, up, towards]).T
        flats.append(lower(along, light))
    return curves if curves and simple_curves(flats) else None
