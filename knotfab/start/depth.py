"""Choose the depth profile: how far along the light's rays each stretch of the template moves.

Moving points along the rays leaves the shadow of a simple curve simple, so the lifted curve is still an
unknot by inspection. Random smooth profiles are drawn, and the best are varied: those that make the picture
least legible from the side and need little support in print. If the lamp is wide, strands that draw the
outline are lowered towards the wall; if careless placing matters, the depth may be reduced. Strands that
hide each other and are still too near are parted along the rays at the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import floor, inf

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled
from knotfab.effects.misplacement import Steadying
from knotfab.effects.penumbra import Sharpening
from knotfab.geometry.legs import find_legs, plan_bars
from knotfab.geometry.overhang import Rules, strands_along, support_cm3, turn_upwards
from knotfab.geometry.polylines import arc_lengths, pair_nearby, sample_evenly, split_alike
from knotfab.problem import DepthChoice
from knotfab.start.arches import Arches, draw_arches, fold_of, highest_mm
from knotfab.start.doubled import find_doubled
from knotfab.start.lanes import part_sides
from knotfab.start.legibility import (
    Onlooker,
    about_middle,
    legibility_from,
    onlooker_for,
    turns_aside,
)
from knotfab.start.profiles import Profile, Relief, draw_profile, draw_relief, lift

AnyProfile = Profile | Relief | Arches

# weight by angle from which a profile is viewed, degrees, largest first
_ASIDE = {45.0: 0.75, 30.0: 0.25}
_SURELY = 0.9  # share of the least support so far that every profile is assumed to need
_DRAWN = 6  # one candidate in six is drawn at random, the others are variations of the best
_KEPT = 4  # number of profiles that are varied in turn
_RODS = 600  # rods by which supports are estimated
_EXTENTS = 20  # extents at which a profile is judged where placing is careless
_NOISE = 0.025  # legibility differs by this much between draws of profiles: less does not count
# arches with a leg that lacks a neighbour are split at most this often, at one of these shares
_SPLITS = 8
_SPLIT_SHARES = 0.5, 0.3, 0.7
_BRACED = 2  # how many of the best arches are braced; the one less legible from the side is taken
_STAND_OUT = 0.05  # weight of a standard deviation by which a picture stands out from foreign signs
_FREE_LEG = 0.03  # weight of a leg that sways, against legibility
_TURNS = 3  # turns to the bed, in which supports are weighed: the best of the first profiles


def _overlapping(samples: tuple[Array, ...], radius: float) -> tuple[Indices, Indices]:
    """Return pairs of samples that hide each other from the light and so must differ in depth."""
    pairs, along = pair_nearby(samples, 1.85 * radius)
    one, other = pairs[along > 6.0 * radius].T
    return one, other


@compiled
def _count_close(points: Array, one: Indices, other: Indices, reach: float) -> int:
    """Count how many of the pairs (p,) of points (n, 3) are closer than `reach`."""
    found = 0
    for p in range(len(one)):
        square = 0.0
        for k in range(3):
            square += (points[one[p], k] - points[other[p], k]) ** 2
        found += square < reach * reach
    return found


@dataclass(frozen=True)
class _Braced:
    """Arches, the places (k, 3) where a leg lacks a bar, and the cost of these and of legibility."""

    arches: Arches
    lacking: Array
    cost: float


@dataclass
class _Judge:
    """The costs of a profile, with samples of the curves and the pairs that hide each other."""

    curves: tuple[Array, ...]
    radius: float
    light_distance: float
    extent_mm: float
    target: Mask
    overhang_deg: float | None
    sharpening: Sharpening | None = None
    lanes: tuple[Array, ...] | None = None
    arched: bool = False  # strands stand on a floor, in arches
    hidden: Callable[[Array], bool] = lambda _: True  # as for `plan_bars`
    turns: Array = field(default_factory=turn_upwards)
    sides: list[int] = field(default_factory=lambda: [0, 1, 2, 3])  # the most telling side first
    least: float = inf  # least weighted support so far

    def __post_init__(self) -> None:
        step = 0.8 * self.radius
        self.samples = tuple(sample_evenly(c, step) for c in self.curves)
        self.arcs = [arc_lengths(s) for s in self.samples]
        self.pairs = _overlapping(self.samples, self.radius)
        self.tops = np.array([min(self.extent_mm, highest_mm(c)) for c in self.curves])
        self.folds = [fold_of(s, self.radius) for s in self.samples]
        self.doubled = find_doubled(self.samples, self.pairs, self.radius) if self.arched else []
        self.drawing = [] if self.sharpening is None else self.sharpening.drawing(self.samples)
        self.beside = None  # heights that the lanes add to the samples, mm
        if self.lanes is not None:
            shares = [arc_lengths(c)[:-1] / arc_lengths(c)[-1] for c in self.curves]
            self.beside = [
                np.interp(arc[:-1] / arc[-1], share, lane, period=1.0)
                for arc, share, lane in zip(self.arcs, shares, self.lanes, strict=True)
            ]

    def draw(self, rng: np.random.Generator, number: int, across_mm: float) -> AnyProfile:
        """Draw a random profile: a relief if strands have lanes, arches if they stand on the bed."""
        if self.lanes is not None:
            return draw_relief(rng, number, across_mm)
        if self.arched:
            return draw_arches(rng, self.arcs, self.tops, self.radius, self.folds, self.doubled)
        return draw_profile(rng, number, across_mm, self.arcs)

    def heights(
        self, profile: AnyProfile, curves: tuple[Array, ...], drawing: list[Array]
    ) -> list[Array]:
        """Return the depth of each vertex of the curves, without their lanes."""
        if isinstance(profile, Relief):
            return self.fit(profile.heights(list(curves)), drawing)
        if isinstance(profile, Arches):
            above = profile.heights([arc_lengths(c) for c in curves])
            return [height - 0.5 * self.extent_mm for height in above]
        return self.fit(profile.heights([arc_lengths(c) for c in curves]), drawing)

    def place(self, profile: AnyProfile) -> list[Array]:
        """Lift the samples by a profile and their lanes."""
        heights = self.heights(profile, self.samples, self.drawing)
        if self.beside is not None:
            heights = [h + b for h, b in zip(heights, self.beside, strict=True)]
        return [lift(s, h, self.light_distance) for s, h in zip(self.samples, heights, strict=True)]

    def part(
        self, profile: AnyProfile, heights: list[Array], separation: float
    ) -> tuple[list[Array], list[Array]]:
        """Part strands that hide each other; return the curves' heights and the lifted samples."""
        own = self.heights(profile, self.samples, self.drawing)
        moves = part_sides(
            self.samples, np.concatenate(own), self.pairs, separation, self.light_distance
        )
        by_curve = split_alike(moves, self.samples)
        parted = []
        for curve, height, arc, move in zip(self.curves, heights, self.arcs, by_curve, strict=True):
            along = arc_lengths(curve)[:-1] / arc_lengths(curve)[-1]
            parted.append(height + np.interp(along, arc[:-1] / arc[-1], move, period=1.0))
        parts = [
            lift(s, h + m, self.light_distance)
            for s, h, m in zip(self.samples, own, by_curve, strict=True)
        ]
        if np.ptp(np.concatenate(parted)) > (1.0 + 1e-9) * self.extent_mm:
            parted = _fit(parted, self.extent_mm)
        return parted, parts

    def fit(self, heights: list[Array], drawing: list[Array]) -> list[Array]:
        """Scale heights to the extent, and lower the strands that draw the outline if the lamp is wide."""
        fitted = _fit(heights, self.extent_mm)
        if self.sharpening is None:
            return fitted
        return _fit(self.sharpening.lower(fitted, drawing), self.extent_mm)

    def brace(self, arches: Arches, modulus_mpa: float) -> _Braced:
        """Split arches until a neighbour can hold every leg, in the way that hides the picture best."""
        share = np.concatenate([arc[:-1] / arc[-1] for arc in self.arcs])
        of = np.repeat(np.arange(len(self.samples)), [len(s) for s in self.samples])
        now = self._free_legs(arches, modulus_mpa)
        for _ in range(_SPLITS):
            if not len(now.lacking):
                break
            nearest = cKDTree(np.concatenate(self.place(now.arches))).query(now.lacking)[1]
            tried = []
            for first in _SPLIT_SHARES:
                split = now.arches
                for curve in np.unique(of[nearest]).tolist():
                    split = split.split(curve, share[nearest[of[nearest] == curve]], first)
                if split is not now.arches:
                    tried.append(self._free_legs(split, modulus_mpa))
            if not tried:
                break
            now = min(tried, key=lambda one: one.cost)
        return now

    def show(self, braced: _Braced, onlooker: Onlooker) -> float:
        """Return the cost of arches plus a price on how clearly an onlooker reads the picture in them."""
        centred = about_middle(np.concatenate(self.place(braced.arches)))
        turns = turns_aside(max(_ASIDE))
        read = [onlooker.read(centred, self.radius, self.light_distance, t) for t in turns]
        return braced.cost + _STAND_OUT * max(read)

    def _free_legs(self, arches: Arches, modulus_mpa: float) -> _Braced:
        parts = self.place(arches)
        _, lacking = plan_bars(find_legs(parts), self.radius, modulus_mpa, self.hidden)
        return _Braced(arches, lacking, self.legibility(parts) + _FREE_LEG * len(lacking))

    def blur(self, parts: list[Array]) -> float:
        """Return the weighted brightness error of a wide lamp; 0 for a small one."""
        return 0.0 if self.sharpening is None else self.sharpening.cost(parts, self.drawing)

    def find_extent(self, profile: AnyProfile, least_mm: float, steadying: Steadying) -> float:
        """Find the depth from `least_mm` to the profile's own, mm, at which its total cost is least.

        The cost of careless placing grows with the depth and hardly depends on the profile's shape. IoU lost
        by it counts like IoU read from the side, and is added to the other costs.
        """
        most, found = self.extent_mm, []
        extents = np.linspace(max(least_mm / most, 1 / _EXTENTS), 1.0, _EXTENTS) * most
        for extent in extents:
            self.extent_mm = float(extent)
            parts = self.place(profile)
            other = self.legibility(parts) + self.blur(parts) + self.support(parts)
            found.append((other, steadying.cost(parts)))
        self.extent_mm = most
        costs = np.array(found)
        best = int(costs.sum(axis=1).argmin())
        other, parting = costs[-1] - costs[best]
        # the gain must exceed the noise both with and without the other costs
        if min(parting, other + parting) <= _NOISE:
            return most
        # so that a rebuild from the number is the same
        return floor(1e4 * float(extents[best])) / 1e4

    def legibility(self, parts: list[Array], at_most: float = inf) -> float:
        """Estimate how legible the picture is from 45 and 30° to the side, plus a cost of strands too close.

        Once the sum exceeds `at_most` the rest is left out. At smaller angles a picture is rarely less
        legible, so a few sides at 45 degrees rule most profiles out.
        """
        points = np.concatenate(parts)
        close = _count_close(points, *self.pairs, 2.2 * self.radius)
        # 0.6: weight of strands that hide each other at nearly equal depth
        found = 0.6 * close / max(len(self.pairs[0]), 1)
        centred, left = about_middle(points), sum(_ASIDE.values())
        for angle, share in _ASIDE.items():
            worst = 0.0
            for side in tuple(self.sides):
                turn = turns_aside(angle)[side]
                seen = legibility_from(centred, self.radius, self.light_distance, self.target, turn)
                worst = max(worst, seen)
                if found + left * worst > at_most:
                    self.sides.remove(side)
                    self.sides.insert(0, side)
                    return found + left * worst
            found += share * worst
            left -= share
        return found

    def cost(self, parts: list[Array], at_most: float, supported: bool = True) -> float:
        """Return the total cost, with or without supports; a lower bound once that exceeds `at_most`.

        Supports take as long as all else, so they are computed only if the other costs plus `_SURELY` of the
        least support so far stay below `at_most`.
        """
        cost, least = self.blur(parts), _SURELY * self.least if supported else 0.0
        cost += self.legibility(parts, at_most - least - cost)
        if not supported or cost + least > at_most:
            return cost + least
        return cost + self.support(parts)

    def support(self, parts: list[Array]) -> float:
        """Return the cost of supports in the best orientation."""
        found = float(self.supports(parts).min())
        self.least = min(self.least, found)
        return found

    def supports(self, parts: list[Array]) -> Array:
        """Return the weighted volume of supports over the tube's, for each orientation, (turns,)."""
        if self.overhang_deg is None:
            return np.zeros(1)
        rules, rods = Rules(self.overhang_deg), strands_along(parts, self.radius, most=_RODS)
        tube_cm3 = np.pi * self.radius**2 * rods.length.sum() / 1000
        found = [support_cm3(rods, turn, rules) for turn in self.turns]
        # 0.02: weight of a support volume equal to the tube's
        return np.asarray(0.02 * np.array(found) / tube_cm3)

    def keep_best_turns(self, placed: list[list[Array]]) -> None:
        """Keep only the orientations in which these samples need the least support."""
        mean = np.mean([self.supports(parts) for parts in placed], axis=0)
        self.turns = self.turns[np.argsort(mean, kind="stable")[:_TURNS]]


def _fit(heights: list[Array], extent_mm: float) -> list[Array]:
    """Shift and scale the heights of all curves to the extent, centred on zero."""
    joined = np.concatenate(heights)
    low, high = float(joined.min()), float(joined.max())
    scale = extent_mm / max(high - low, 1e-9)
    return [(h - 0.5 * (low + high)) * scale for h in heights]


def choose_depth(
    curves: tuple[Array, ...],
    radius: float,
    light_distance: float,
    extent_mm: float,
    target: Mask,
    candidates: int,
    seed: int,
    overhang_deg: float | None = None,
    sharpening: Sharpening | None = None,
    lanes: tuple[Array, ...] | None = None,
    steadying: Steadying | None = None,
    least_mm: float = 0.0,
    separation: float | None = None,
    modulus_mpa: float | None = None,
    hidden: Callable[[Array], bool] = lambda _: True,
) -> DepthChoice:
    """Return the best of `candidates` depth profiles: some are random, the others variations of the best.

    Args:
        curves: closed planar polylines [(n, 2) mm], evenly sampled.
        radius: tube radius, mm.
        light_distance: from the light to the middle of the piece, mm.
        extent_mm: extent of the centre lines along the view's axis.
        target: the picture's mask from `legibility.stretch_mask`.
        overhang_deg: largest overhang from the vertical that prints unsupported; None: supports cost nothing.
        sharpening: the cost of a wide lamp, None if it need not be considered.
        lanes: [(n,) mm] offsets of strands that hide each other. Profiles are judged with them, but the
            depths returned leave them out.
        steadying: the cost of careless placing, or None; with it the choice names the best extent.
        least_mm: lower bound on that extent.
        separation: distance to which strands that hide each other are parted, mm; None: they are not.
        modulus_mpa: Young's modulus. If it is given, strands stand in arches on a floor at the extent's
            bottom, and arches with a leg that would sway while printing are halved.
        hidden: as for `plan_bars`, of points in the view's axes.
    """
    rng = np.random.default_rng(seed)
    judge = _Judge(
        curves,
        radius,
        light_distance,
        extent_mm,
        target,
        overhang_deg,
        sharpening,
        lanes,
        modulus_mpa is not None,
        hidden,
    )
    every = np.concatenate(curves)
    across = float((every.max(0) - every.min(0)).max()) + 2 * radius
    drawn = max(min(candidates, 2 * _KEPT), candidates // _DRAWN)
    first: list[tuple[float, AnyProfile, list[Array]]] = []
    for n in range(drawn):
        profile = judge.draw(rng, n, across)
        parts = judge.place(profile)
        most = first[-1][0] if len(first) == 2 * _KEPT else inf
        first.append((judge.cost(parts, most, supported=False), profile, parts))
        first = sorted(first, key=lambda one: one[0])[: 2 * _KEPT]
    judge.keep_best_turns([parts for _, _, parts in first])
    scored = [(seen + judge.support(parts), profile) for seen, profile, parts in first]
    best = sorted(scored, key=lambda one: one[0])[:_KEPT]
    # size of the variations, first and last, as a share of a wave's standard deviation
    begin, end = 0.6, 0.1
    for n in range(drawn, candidates):
        change = begin + (end - begin) * (n - drawn) / (candidates - drawn)
        profile = best[n % len(best)][1].varied(rng, change)
        cost = judge.cost(judge.place(profile), best[-1][0])
        best = sorted([*best, (cost, profile)], key=lambda one: one[0])[:_KEPT]
    profile = best[0][1]
    if modulus_mpa is not None:
        arches = [one for _, one in best[:_BRACED] if isinstance(one, Arches)]
        braced = [judge.brace(one, modulus_mpa) for one in arches]
        onlooker = onlooker_for(target)
        profile = min(braced, key=lambda one: judge.show(one, onlooker)).arches
    best_mm = extent_mm
    if steadying is not None and least_mm < extent_mm:
        best_mm = judge.find_extent(profile, least_mm, steadying)
    drawing = [] if sharpening is None else sharpening.drawing(curves)
    heights = judge.heights(profile, curves, drawing)
    if separation is None:
        return DepthChoice(tuple(heights), judge.legibility(judge.place(profile)), best_mm)
    heights, parts = judge.part(profile, heights, separation)
    return DepthChoice(tuple(heights), judge.legibility(parts), best_mm)
