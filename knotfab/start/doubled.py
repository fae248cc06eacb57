"""Nest the arches of two strands that hide each other along a thin stroke.

Arches drawn at will would cross in depth there, and where they cross one strand has to step aside past the
other, beyond the outline. So both rise together, one nested under the other. Only where the stroke is longer
than the highest arch do they change places, once for each arch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.polylines import arc_lengths, points_at
from knotfab.start.lanes import number_stretches

# lengths in tube radii
_SHORTEST = 12.0  # strands that hide each other along less than that are not nested
_APART = 2.7  # distance between nested strands, across their flanks
# at a stroke's open end they cross where they are `_CLEAR` apart, if that is within `_FREE`
_CLEAR, _FREE = 2.4, 20.0
_TIP = 6.0  # longest way on from the stretch's end to a turn at the stroke's tip
# two tips within `_CUT` are of one stroke that was cut. The foot of one is `_RAISED` further off, so that
# this tip is higher, and no light falls between them
_CUT, _RAISED = 5.0, 1.2
_TOGETHER = 2.0  # largest distance between places that hide each other
_BESIDE = 3.0  # a third strand within that of the middle between two runs beside them
# least and most angle of the flanks from the bed: flatter ones reach along longer strokes
_FLANKS_DEG = 43.0, 51.5
_HIGHEST = 50.0  # higher arches are so long that they sag where the piece hangs on a wall


class Nested(NamedTuple):
    """An arch: where on which curve its two feet are, mm, and the slope of its flanks."""

    curve: int
    begin_mm: float
    end_mm: float
    slope: float


@dataclass(frozen=True)
class Doubled:
    """A stretch of a curve, from `begin_mm` on, all along which another strand hides it.

    What lies x mm along it hides the place `other_mm[0] + other_mm[1] * x` of the other curve. `ends` are
    where strands are free to cross, mm along it, or where the stroke's tip is and one strand goes on as the
    other. `tips`: by how many mm the first foot there is further from the tip than it must be; None for a
    crossing.
    """

    curves: tuple[int, int]
    begin_mm: float
    other_mm: tuple[float, float]
    ends: tuple[float, float]
    tips: tuple[float | None, float | None]

    def nest(self, rng: np.random.Generator, top_mm: float, radius_mm: float) -> list[Nested]:
        """Find the arches of both strands.

        Feet of the upper strand are outside those of the lower one. Which strand is the upper one is random,
        and changes wherever a further foot is needed.
        """
        low, high = np.tan(np.radians(_FLANKS_DEG)).tolist()
        top_mm = min(top_mm, _HIGHEST * radius_mm)
        beside = 0.5 * _APART * radius_mm / float(np.sin(np.arctan(low)))
        most, whole = 2.0 * top_mm / low - 2.0 * beside, float(np.ptp(self.ends))
        turned = [tip is not None for tip in self.tips]
        if most < 4.0 * beside or (all(turned) and whole <= most):
            return []  # there is no room, or it would stand on two feet
        count = int(np.ceil(whole / most))
        # as far as they reach from the stroke's tip, so that they cross near the body that it leaves
        rest = max(whole - (count - 1) * most, 4.0 * beside) if count > 1 else whole
        steps = np.append(np.full(count - 1, (whole - rest) / max(count - 1, 1)), rest)
        nodes = self.ends[0] + np.cumsum(np.append(0.0, steps[::-1] if turned[1] else steps))
        slope = min(high, 2.0 * top_mm / (float(steps.max()) + 2.0 * beside))
        shifts = np.zeros(count + 1)
        shifts[[0, -1]] = self.tips[0] or 0.0, -(self.tips[1] or 0.0)
        upper = int(rng.integers(2))  # the strand above the other from the first foot on
        feet: list[list[float]] = [[], []]
        for number, (node, shift) in enumerate(zip(nodes.tolist(), shifts.tolist(), strict=True)):
            above = (upper + max(number - 1, 0)) % 2
            outwards = -beside if number == 0 else beside
            if not ((number == 0 and turned[0]) or (number == count and turned[1])):
                feet[above].append(node + outwards)
            feet[1 - above].append(node - outwards + shift)
        one = [self.begin_mm + x for x in feet[0]]
        other = sorted(self.other_mm[0] + self.other_mm[1] * x for x in feet[1])
        found = [(self.curves[0], *pair) for pair in pairwise(one)]
        found += [(self.curves[1], *pair) for pair in pairwise(other)]
        if turned[0]:
            found.append((self.curves[0], other[-1], one[0]))
        if turned[1]:
            found.append((self.curves[0], one[-1], other[0]))
        return [Nested(*each, slope) for each in found]


def find_doubled(
    samples: Sequence[Array], pairs: tuple[Indices, Indices], radius_mm: float
) -> list[Doubled]:
    """Find where two strands hide each other along a thin stroke, the longest stretches first.

    Args:
        samples: closed curves [(n, 2) mm], evenly sampled.
        pairs: numbers of samples that hide each other.
    """
    sizes = [len(s) for s in samples]
    starts = np.cumsum(sizes) - sizes
    numbers = number_stretches(*pairs, sizes)
    found, tips = list[Doubled](), list[Array]()
    taken = np.zeros(sum(sizes), dtype=bool)
    every = cKDTree(np.concatenate(samples))
    for number in np.argsort(-np.bincount(numbers), kind="stable").tolist():
        both = [side[numbers == number] for side in pairs]
        curves = [int(np.searchsorted(starts, side[0], "right")) - 1 for side in both]
        one, other = (
            _Side(samples[curve], side - starts[curve])
            for curve, side in zip(curves, both, strict=True)
        )
        own = np.concatenate([starts[curves[0]] + one.run, starts[curves[1]] + other.run])
        if min(one.along, other.along) < _SHORTEST * radius_mm or taken[own].any():
            continue
        two = _Two(one, other, *np.polyfit(one.places, other.places, 1).tolist())
        within = np.linspace(0.1, 0.9, 9) * one.along
        if two.apart(within).max() > _TOGETHER * radius_mm:
            continue  # one is longer between corners
        near = every.query_ball_point(two.middle(within), _BESIDE * radius_mm)
        if np.mean([len(np.setdiff1d(places, own)) > 0 for places in near]) > 0.5:
            continue  # a third strand hides what steps aside
        taken[own] = True
        ends, feet = [0.0, one.along], list[float | None]([None, None])
        for side, sign in ((0, -1), (1, 1)):
            beyond = two.tip_beyond(ends[side], sign)
            if curves[0] == curves[1] and two.slope < 0.0 and beyond < _TIP * radius_mm:
                ends[side] += sign * beyond
                tip = one.at(np.array(ends[side]))
                cut = any(np.hypot(*(tip - known)) < _CUT * radius_mm for known in tips)
                feet[side] = _RAISED * radius_mm if cut else 0.0
                tips.append(tip)
            else:
                ways = sign * radius_mm * np.arange(0.0, _FREE, 0.5)
                free = two.apart(ends[side] + ways) > _CLEAR * radius_mm
                ends[side] += float(ways[free.argmax()])
        found.append(
            Doubled(
                (curves[0], curves[1]),
                one.begin,
                (other.begin + two.intercept, two.slope),
                (ends[0], ends[1]),
                (feet[0], feet[1]),
            )
        )
    return found


class _Side:
    """A side of a doubled stretch: the shortest run along a closed curve that has all of its samples (k,)."""

    def __init__(self, curve: Array, samples: Indices) -> None:
        self.closed, self.arc = np.vstack([curve, curve[:1]]), arc_lengths(curve)
        known = np.unique(samples)
        gaps = np.diff(known, append=known[0] + len(curve))
        widest = int(gaps.argmax())
        first = int(known[(widest + 1) % len(known)])
        self.run = (first + np.arange(len(curve) - int(gaps[widest]) + 1)) % len(curve)
        self.length, self.begin = float(self.arc[-1]), float(self.arc[first])
        self.places = (self.arc[samples] - self.begin) % self.length  # mm along the run
        self.along = float((self.arc[self.run[-1]] - self.begin) % self.length)

    def at(self, x_mm: Array) -> Array:
        """Return the points (..., 2) at distances along the run, mm."""
        arc = (self.begin + x_mm) % self.length
        return points_at(self.closed, self.arc, arc)


class _Two(NamedTuple):
    """Both sides; the place x mm along `one` hides that at `slope` * x + `intercept` mm along `other`."""

    one: _Side
    other: _Side
    slope: float
    intercept: float

    def apart(self, x_mm: Array) -> Array:
        """Return how far places along the first side are from what they hide, mm."""
        return np.asarray(np.hypot(*(self.one.at(x_mm) - self._hidden(x_mm)).T))

    def middle(self, x_mm: Array) -> Array:
        return 0.5 * (self.one.at(x_mm) + self._hidden(x_mm))

    def tip_beyond(self, x_mm: float, sign: int) -> float:
        """Return how far beyond a place the tip is, mm, where the two sides of one curve meet."""
        apart = self.other.begin + self.intercept - self.one.begin + (self.slope - 1.0) * x_mm
        return sign * apart % self.one.length / (1.0 - self.slope)

    def _hidden(self, x_mm: Array) -> Array:
        return self.other.at(self.intercept + self.slope * x_mm)
