"""Random smooth depth profiles and their variations, from which the depth is chosen; lifting points to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from knotfab.base.arrays import Array
from knotfab.base.compiled import compiled

_WAVELENGTHS = (0.65, 0.85, 1.1)  # shortest wave of a profile, over the width of the piece
_RELIEF = 1.0, 1.4, 2.0  # shortest wave of a relief, likewise
_RELIEF_WAVES = 4
_CHANGED = 0.5  # share of its waves that a variation changes
_BLOCK = 256  # points whose waves are summed at once: they stay in the processor's nearest cache


@compiled
def sum_waves(angles: Array, cosines: Array, sines: Array) -> Array:
    """Sum cosines[k - 1] cos(k angle) - sines[k - 1] sin(k angle) over k, by Horner's rule; (n,).

    That is the real part of a polynomial in exp(i angle) with coefficients cosines + i sines.
    """
    total = np.empty(len(angles))
    real, imaginary = np.empty(_BLOCK), np.empty(_BLOCK)
    c, s = np.empty(_BLOCK), np.empty(_BLOCK)
    for begin in range(0, len(angles), _BLOCK):
        size = min(_BLOCK, len(angles) - begin)
        for n in range(size):
            c[n], s[n] = math.cos(angles[begin + n]), math.sin(angles[begin + n])
            real[n] = imaginary[n] = 0.0
        for k in range(len(cosines) - 1, -1, -1):
            for n in range(size):
                x, y = real[n] + cosines[k], imaginary[n] + sines[k]
                real[n] = x * c[n] - y * s[n]
                imaginary[n] = x * s[n] + y * c[n]
        for n in range(size):
            total[begin + n] = real[n]
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


def lift(curve: Array, depth: Array, light_distance: float) -> Array:
    """Move points (n, 2) of the plane z = 0 along their rays to height `depth`; (n, 3)."""
    return np.column_stack([curve * (1.0 - depth / light_distance)[:, None], depth])


def lower(points: Array, light_distance: float) -> Array:
    """Project points (..., 3) from the light onto the plane z = 0, (..., 2); the inverse of `lift`."""
    return np.asarray(points[..., :2] / (1.0 - points[..., 2:] / light_distance))
