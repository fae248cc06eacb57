"""Random smooth depth profiles, and variations of them: what the depth is chosen from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import erf

from knotfab.base.arrays import Array, Mask
from knotfab.base.compiled import compiled

_WAVELENGTHS = (0.65, 0.85, 1.1)  # shortest wave of a profile, over the width of the piece
_RELIEF = 1.0, 1.4, 2.0  # shortest wave of a relief, likewise
_RELIEF_WAVES = 4
_CHANGED = 0.5  # share of its waves that a variation changes
_GRID = 128  # side of the grid on which legibility is estimated, to 0.02
_BLOCK = 256  # points whose waves are summed at once: they stay in the processor's nearest cache


@compiled
def sum_waves(angles: Array, cosines: Array, sines: Array) -> Array:
    """Sum cosines[k - 1] cos(k angle) - sines[k - 1] sin(k angle) over k, by Horner's rule; (n,).

    That is the real part of a polynomial in exp(i angle) with coefficients cosines + i sines.
    """
    total = np.empty(len(angles))
    real, imaginary = np.empty(_BLOCK), np.empty(_BLOCK)
    for begin in range(0, len(angles), _BLOCK):
        size = min(_BLOCK, len(angles) - begin)
        c, s = np.cos(angles[begin : begin + size]), np.sin(angles[begin : begin + size])
        real[:] = 0.0
        imaginary[:] = 0.0
        for k in range(len(cosines) - 1, -1, -1):
            for n in range(size):
                x, y = real[n] + cosines[k], imaginary[n] + sines[k]
                real[n] = x * c[n] - y * s[n]
                imaginary[n] = x * s[n] + y * c[n]
        total[begin : begin + size] = real[:size]
    return total


@dataclass(frozen=True)
class Profile:
    """A smooth depth profile: for each curve the cosines and sines (2, k) of k waves, and an offset.

    `shortest` is the shortest wavelength, mm.
    """

    waves: tuple[Array, ...]
    offsets: Array
    shortest: float

    def heights(self, arcs: list[Array]) -> list[Array]:
        """Return heights from about -2 to 2 at each curve's arc lengths (n + 1,), the last its length."""
        out = []
        for (cosines, sines), offset, arc in zip(self.waves, self.offsets, arcs, strict=True):
            length = float(arc[-1])
            wave = sum_waves(2 * np.pi / length * arc[:-1], cosines, sines)
            # the error function makes a normal variable uniform, so the curve spreads evenly over the depth;
            # a curve shorter than a wave stays nearly level, at a depth of its own
            own = offset if length < 3 * self.shortest else 0.0
            spread = erf(wave / np.sqrt(2 * len(cosines)))
            out.append(2.0 * spread * min(1.0, length / self.shortest) + own)
        return out

    def varied(self, rng: np.random.Generator, change: float) -> Profile:
        """Return a variation of equal variance: about half the waves get a share `change` of new noise."""

        def mix(wave: Array) -> Array:
            step = rng.normal(size=wave.shape) * (rng.random(wave.shape[-1]) < _CHANGED)
            return np.asarray(np.sqrt(1.0 - change**2) * wave + change * step)

        offsets = self.offsets + change * rng.normal(size=len(self.offsets))
        return Profile(tuple(mix(w) for w in self.waves), offsets, self.shortest)


@dataclass(frozen=True)
class Relief:
    """A depth profile of plane waves over the picture, for passes of a stroke that rise and fall together.

    `vectors` (k, 2) are wave vectors in rad/mm, `waves` (2, k) the cosines and sines.
    """

    vectors: Array
    waves: Array

    def heights(self, places: list[Array]) -> list[Array]:
        """Return heights from about -2 to 2 at points (n, 2) of each curve, equal for all strands there."""
        out = []
        for points in places:
            angle = points @ self.vectors.T
            wave = self.waves[0] * np.cos(angle) - self.waves[1] * np.sin(angle)
            out.append(2.0 * erf(wave.sum(1) / np.sqrt(2 * len(self.vectors))))
        return out

    def varied(self, rng: np.random.Generator, change: float) -> Relief:
        """Return a variation with the same wave vectors, each wave with a share `change` of new noise."""
        step = rng.normal(size=self.waves.shape)
        return Relief(self.vectors, np.sqrt(1.0 - change**2) * self.waves + change * step)


def draw_relief(rng: np.random.Generator, number: int, across_mm: float) -> Relief:
    """Draw a random relief for a piece `across_mm` wide; `number` picks its wavelengths."""
    turn = rng.uniform(0.0, 2 * np.pi, _RELIEF_WAVES)
    length = _RELIEF[number % len(_RELIEF)] * across_mm * rng.uniform(1.0, 2.0, _RELIEF_WAVES)
    vectors = 2 * np.pi / length[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return Relief(vectors, rng.normal(size=(2, _RELIEF_WAVES)))


def draw_profile(
    rng: np.random.Generator, number: int, across_mm: float, arcs: list[Array]
) -> Profile:
    """Draw a random profile for curves of these arc lengths (n + 1,); `number` picks its wavelengths."""
    shortest = _WAVELENGTHS[number % len(_WAVELENGTHS)] * across_mm
    counts = [max(1, int(arc[-1] / shortest)) for arc in arcs]
    return Profile(
        tuple(rng.normal(size=(2, n)) for n in counts), rng.normal(size=len(arcs)), shortest
    )


# Legibility: how well the picture can be read from aside.


def stretch_mask(mask: Mask) -> Mask:
    """Crop a mask to its bounding box and stretch it to the grid of `legibility`."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    at = (np.arange(_GRID) + 0.5) / _GRID
    v = rows[0] + (at * (rows[-1] + 1 - rows[0])).astype(int)
    u = columns[0] + (at * (columns[-1] + 1 - columns[0])).astype(int)
    return np.asarray(mask[np.ix_(v, u)])


@compiled
def _cover(points: Array, radius: float, grid: int) -> Mask:
    """Rasterise discs about points (n, 2) on their bounding box, (grid, grid) with row 0 at the top."""
    covered = np.zeros((grid, grid), dtype=np.bool_)
    left, low = points[:, 0].min() - radius, points[:, 1].min() - radius
    wide = (points[:, 0].max() + radius - left) / grid
    high = (points[:, 1].max() + radius - low) / grid
    for k in range(len(points)):
        x, y = (points[k, 0] - left) / wide, (points[k, 1] - low) / high  # unit: cells
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
    """Return the IoU of the turned tube's silhouette, stretched to its box, with the target.

    `centred` are dense samples (n, 3) in the view's axes.
    """
    flat = np.empty((len(centred), 2))
    for n in range(len(centred)):
        x, y, z = centred[n, 0], centred[n, 1], centred[n, 2]
        deep = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
        scale = light_distance / (light_distance - deep)
        for k in range(2):
            flat[n, k] = scale * (turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z)
    covered = _cover(flat, radius, len(target))
    both, either = 0, 0
    for row in range(len(target)):
        for column in range(len(target)):
            both += covered[row, column] & target[row, column]
            either += covered[row, column] | target[row, column]
    return both / either if either else 1.0


@lru_cache
def turns_aside(angle_deg: float) -> list[Array]:
    """Return four rotations (3, 3) by this angle: to both sides, up and down."""
    a = np.deg2rad(angle_deg)
    c, s = np.cos(a), np.sin(a)
    sideways = [np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]]) for d in (s, -s)]
    return sideways + [np.array([[1, 0, 0], [0, c, -d], [0, d, c]]) for d in (s, -s)]


def legibility(
    points: Array, radius: float, light_distance: float, target: Mask, angle_deg: float
) -> float:
    """Return the largest IoU, over four sides, of the turned part's silhouette with the target's.

    Args:
        points: (n, 3) mm in the view's axes (z towards the light), less than a radius apart.
        radius: of the tube, mm.
        light_distance: from the light to the part's middle, mm.
        target: from `stretch_mask`.
    """
    turns, centred = turns_aside(angle_deg), about_middle(points)
    return max(legibility_from(centred, radius, light_distance, target, turn) for turn in turns)


def about_middle(points: Array) -> Array:
    """Shift points (n, 3) so that the centre of their bounding box, about which a part turns, is at 0."""
    middle = [0.5 * (column.min() + column.max()) for column in points.T]
    return np.asarray(points - np.array(middle))


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
