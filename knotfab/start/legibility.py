"""How well the picture can be read in the piece from beside the lamp, by two measures.

`legibility`, the IoU of stretched silhouettes, is fast and has little noise. `Onlooker` says how far the
picture stands out from foreign ones, and chooses among the best few. It is not `told` of the report, which
sees the holder too, from twelve sides, and counts IoU; over 40 views the two correlate by .92, in ranks
(benchmarks/read_aside.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.base.compiled import compiled
from knotfab_formats.verdict import FOREIGN_SIGNS

_GRID = 128  # cells on a side of stretched silhouettes, which give an IoU to 0.02
# cells on a side of a picture's box where pictures are fitted, and of the margin around it
_INNER, _MARGIN = 12, 2
_FINER = 8  # how many times finer silhouettes are drawn before they are fitted
# a map's first change of slope and of place (cells), and how it shrinks from round to round
_SLOPE, _SHIFT, _SHRINKS, _ROUNDS = 0.12, 0.8, 0.6, 4
_LEAST_AREA = 0.35  # a map may shrink areas to this share at most
_SAME = 0.85  # a sign that fits the picture itself this well is not foreign


def stretch_mask(mask: Mask) -> Mask:
    """Crop a mask to its bounding box and stretch it to the grid of `legibility`."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    at = (np.arange(_GRID) + 0.5) / _GRID
    v = rows[0] + (at * (rows[-1] + 1 - rows[0])).astype(int)
    u = columns[0] + (at * (columns[-1] + 1 - columns[0])).astype(int)
    return np.asarray(mask[np.ix_(v, u)])


@lru_cache
def turns_aside(angle_deg: float) -> list[Array]:
    """Return four rotations (3, 3) by this angle: to both sides, up and down."""
    a = np.deg2rad(angle_deg)
    c, s = np.cos(a), np.sin(a)
    sideways = [np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]]) for d in (s, -s)]
    return sideways + [np.array([[1, 0, 0], [0, c, -d], [0, d, c]]) for d in (s, -s)]


def about_middle(points: Array) -> Array:
    """Shift points (n, 3) so that the centre of their bounding box, about which a part turns, is at 0."""
    middle = [0.5 * (column.min() + column.max()) for column in points.T]
    return np.asarray(points - np.array(middle))


@dataclass(frozen=True)
class Onlooker:
    """Someone who sees a piece from the side and knows foreign signs as well as its picture.

    `pictures` (n, side, side) are covers of cells, its own picture last. `gains` (n,) are what each gains, on
    average, by being fitted to something that it does not show.
    """

    pictures: Array
    gains: Array

    def read(self, centred: Array, radius: float, light_distance: float, turn: Array) -> float:
        """Return by how many standard deviations the picture fits better than signs; 1 is illegible, 3 plain.

        Args:
            centred: (n, 3) mm in the view's axes, less than a radius apart, from `about_middle`.
            radius, light_distance: of the tube, and from the light to the part's middle, mm.
            turn: one of `turns_aside`.
        """
        return self._weigh(_see(centred, radius, light_distance, turn, _INNER * _FINER))

    def stand_out(self, stretched: Mask) -> float:
        """Do what `read` does, for a silhouette from `stretch_mask`."""
        return self._weigh(_resize(stretched))

    def _weigh(self, look: Mask) -> float:
        fits = _fit_all(self.pictures, _coarsen(look)) - self.gains
        return float((fits[-1] - fits[:-1].mean()) / fits[:-1].std())


def onlooker_for(target: Mask) -> Onlooker:
    """Return an onlooker who looks for a picture from `stretch_mask`."""
    signs, gains = _foreign()
    own = _coarsen(_resize(target))
    fits = _fit_all(signs, own)
    foreign = fits < _SAME
    if not foreign.any():
        foreign[:] = True
    own_gain = np.mean([_fit(own, sign) for sign in signs[foreign]])
    return Onlooker(
        np.concatenate([signs[foreign], own[None]]), np.append(gains[foreign], own_gain)
    )


@cache
def _foreign() -> tuple[Array, Array]:
    """Return the signs (n, side, side), and each one's mean fit to the others, (n,)."""
    from PIL import Image

    with Image.open(FOREIGN_SIGNS) as image:
        column = np.asarray(image.convert("L")) > 127
    drawn = np.split(column, len(column) // column.shape[1])
    signs = np.array([_coarsen(_resize(stretch_mask(one))) for one in drawn])
    fits = np.array([_fit_all(signs, one) for one in signs])  # (look, sign)
    return signs, (fits.sum(0) - fits.diagonal()) / (len(signs) - 1)


def _resize(stretched: Mask) -> Mask:
    """Resample a square mask to the size in which silhouettes are drawn to be fitted."""
    size = _INNER * _FINER
    at = ((np.arange(size) + 0.5) / size * len(stretched)).astype(int)
    return np.asarray(stretched[np.ix_(at, at)])


def _coarsen(fine: Mask) -> Array:
    """Return the cover of each cell, with a margin."""
    cells = fine.reshape(_INNER, _FINER, _INNER, _FINER).mean(axis=(1, 3))
    return np.pad(cells, _MARGIN)


def legibility(
    points: Array, radius: float, light_distance: float, target: Mask, angle_deg: float
) -> float:
    """Return the largest IoU, over four sides, of the turned part's silhouette with the target's.

    Args:
        points: (n, 3) mm in the view's axes (z towards the light), less than a radius apart.
        radius: of the tube, mm.
        light_distance: from the light to the part's middle, mm.
        target: from `stretch_mask`.

    Raises:
        ValueError: the target does not come from `stretch_mask`.
    """
    turns, centred = turns_aside(angle_deg), about_middle(points)
    return max(legibility_from(centred, radius, light_distance, target, turn) for turn in turns)


def legibility_from(
    centred: Array, radius: float, light_distance: float, target: Mask, turn: Array
) -> float:
    """Return `legibility` from one side, for points that `about_middle` has centred.

    Raises:
        ValueError: the target does not come from `stretch_mask`.
    """
    if target.shape != (_GRID, _GRID):
        raise ValueError(f"a target of {_GRID} x {_GRID} cells is asked for, got {target.shape}")
    return _iou_aside(centred, radius, light_distance, target, turn)


@compiled
def _see(centred: Array, radius: float, light_distance: float, turn: Array, grid: int) -> Mask:
    """Draw the turned tube's silhouette, stretched to its box, (grid, grid) with row 0 at the top."""
    flat = np.empty((len(centred), 2))
    left, right, low, top = np.inf, -np.inf, np.inf, -np.inf
    for n in range(len(centred)):
        x, y, z = centred[n, 0], centred[n, 1], centred[n, 2]
        deep = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        scale = light_distance / (light_distance - deep)
        for k in range(2):
            flat[n, k] = scale * (turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z)
        left, right = min(left, flat[n, 0]), max(right, flat[n, 0])
        low, top = min(low, flat[n, 1]), max(top, flat[n, 1])
    covered = np.zeros((grid, grid), dtype=np.bool_)
    left, low = left - radius, low - radius
    wide, high = (right + radius - left) / grid, (top + radius - low) / grid
    for k in range(len(flat)):
        x, y = (flat[k, 0] - left) / wide, (flat[k, 1] - low) / high  # unit: cells
        first = max(0, int(np.ceil(y - radius / high - 0.5)))
        last = min(grid - 1, int(np.floor(y + radius / high - 0.5)))
        for row in range(first, last + 1):
            away = (row + 0.5 - y) * high
            reach = np.sqrt(max(0.0, radius * radius - away * away)) / wide
            begin = max(0, int(np.ceil(x - reach - 0.5)))
            end = min(grid - 1, int(np.floor(x + reach - 0.5)))
            for column in range(begin, end + 1):
                covered[grid - 1 - row, column] = True
    return covered


@compiled
def _iou_aside(
    centred: Array, radius: float, light_distance: float, target: Mask, turn: Array
) -> float:
    covered = _see(centred, radius, light_distance, turn, len(target))
    both, either = 0, 0
    for row in range(len(target)):
        for column in range(len(target)):
            both += covered[row, column] & target[row, column]
            either += covered[row, column] | target[row, column]
    return both / either if either else 1.0


def _fit_all(pictures: Array, look: Array) -> Array:
    return np.array([_fit(picture, look) for picture in pictures])


@compiled
def _fit(picture: Array, look: Array) -> float:
    """Return the largest IoU of two covers (n, n) under an affine map near none, by a compass search."""
    map_ = np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    best, step = _overlap(picture, look, map_), 1.0
    for _ in range(_ROUNDS):
        for i in range(6):
            before = map_[i]
            change = step * (_SHIFT if i % 3 == 2 else _SLOPE)
            for sign in (1.0, -1.0):
                map_[i] = before + sign * change
                if map_[0] * map_[4] - map_[1] * map_[3] < _LEAST_AREA:
                    map_[i] = before
                    continue
                value = _overlap(picture, look, map_)
                if value > best:
                    best = value
                    break
                map_[i] = before
        step *= _SHRINKS
    return best


@compiled
def _overlap(picture: Array, look: Array, map_: Array) -> float:
    n = len(picture)
    middle, both, either = (n - 1) / 2, 0.0, 0.0
    for j in range(n):
        for i in range(n):
            x = map_[0] * (i - middle) + map_[1] * (j - middle) + map_[2] + middle
            y = map_[3] * (i - middle) + map_[4] * (j - middle) + map_[5] + middle
            seen, u, v = 0.0, int(np.floor(x)), int(np.floor(y))
            if 0 <= u < n - 1 and 0 <= v < n - 1:
                right, down = x - u, y - v
                seen = (look[v, u] * (1 - right) + look[v, u + 1] * right) * (1 - down)
                seen += (look[v + 1, u] * (1 - right) + look[v + 1, u + 1] * right) * down
            both += min(picture[j, i], seen)
            either += max(picture[j, i], seen)
    return both / either
