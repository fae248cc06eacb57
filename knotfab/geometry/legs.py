"""The legs of strands that stand in arches, and the break-away bars that keep slender ones from swaying."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices
from knotfab.geometry.polylines import sample_evenly
from knotfab.geometry.tube import Mesh
from knotfab_formats.upright import longest_free_leg_mm

BAR_MM = 0.8, 0.4  # width and height of a bar: pliers break it
SUNK_MM = 0.5  # depth of a bar's end in its strand
MOST_BAR_MM = 9.0  # between the surfaces that a bar joins
_STEP_MM = 0.4  # spacing of the points on a leg
_PROMINENT_MM = 1.0  # least height by which a peak or valley stands out
_SPARE = 0.9  # a share of the longest free leg: the mesh and the layers find it a little longer
_WAITS_MM = 1.0  # a longer bar waits until its leg has stood free for 95 % of what it may
_LEAST_MM = 0.3  # what is nearer is joined as it prints, or by no bar that could be broken
_SOON = 0.6  # share of the longest free leg
_TRIED = 8  # points at the same height
# cosine of the least angle between a bar and its strand: its end meets no surface sooner
_ASLANT = 0.75
_FINE_MM, _EVERY = 0.05, 10  # points along a bar, and each that is looked at for the shadow
_BACK = 3  # points, from one place to the next
_OWN_RADII = 5.0  # so near along its leg, a point is part of the strand that a bar ends in


@dataclass(frozen=True)
class Leg:
    """A stretch of a curve from a valley up to a peak: its points (n, 3), `_STEP_MM` apart."""

    curve: int
    points: Array


@dataclass(frozen=True)
class Bar:
    """A level bar: places (3,) on the surfaces that it joins, and the gap between them, mm."""

    start: Array
    end: Array
    gap_mm: float

    def record(self) -> dict[str, Any]:
        """Return its entry in knots.json: the axis of the box, its width and height."""
        middle, half = self._axis()
        width, height = BAR_MM
        ends = {"from": (middle - half).tolist(), "to": (middle + half).tolist()}
        return {**ends, "width_mm": width, "height_mm": height}

    def make_body(self) -> Mesh:
        """Make the box."""
        middle, half = self._axis()
        along = half / np.linalg.norm(half)
        side = 0.5 * BAR_MM[0] * np.array([-along[1], along[0], 0.0])
        up = np.array([0.0, 0.0, 0.5 * BAR_MM[1]])
        corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        vertices = [middle + i * half + j * side + k * up for k in (-1, 1) for i, j in corners]
        faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
        for n in range(4):
            m = (n + 1) % 4
            faces += [[n, m, m + 4], [n, m + 4, n + 4]]
        return np.array(vertices), np.array(faces, dtype=np.int64)

    def _axis(self) -> tuple[Array, Array]:
        way = self.end - self.start
        half = way / np.linalg.norm(way) * (0.5 * self.gap_mm + SUNK_MM)  # ends in the strands
        return 0.5 * (self.start + self.end), half


def find_legs(curves: list[Array]) -> list[Leg]:
    """Find the legs of closed curves [(n, 3) mm], z up: two for each valley."""
    legs = []
    for number, curve in enumerate(curves):
        points = sample_evenly(curve, _STEP_MM)
        height, count = points[:, 2], len(points)
        valleys, peaks = peaks_of(-height), set(peaks_of(height).tolist())
        for valley in valleys.tolist():
            for way in (1, -1):
                steps = [valley]
                while len(steps) <= count:
                    steps.append((steps[-1] + way) % count)
                    if steps[-1] in peaks:
                        break
                legs.append(Leg(number, points[steps]))
    return legs


def peaks_of(height: Array) -> Indices:
    """Return the indices of the peaks that stand out by at least 1 mm in a ring of heights (n,), mm."""
    first = int(height.argmin())
    turned = np.append(np.roll(height, -first), height[first])
    tops = 1 + np.flatnonzero((turned[:-2] < turned[1:-1]) & (turned[1:-1] >= turned[2:]))
    found = [top for top in tops.tolist() if _prominence(turned, top) >= _PROMINENT_MM]
    return np.array([(top + first) % len(height) for top in found], dtype=np.int64)


def _prominence(height: Array, top: int) -> float:
    """Return how far a peak stands above the higher of the two saddles to higher ground."""
    saddles = []
    for side in (height[:top][::-1], height[top + 1 :]):
        higher = np.flatnonzero(side > height[top])
        saddles.append(side[: higher[0] if len(higher) else None].min())
    return float(height[top] - max(saddles))


def plan_bars(
    legs: list[Leg],
    radius: float,
    young_modulus_mpa: float,
    hidden: Callable[[Array], bool] = lambda _: True,
) -> tuple[list[Bar], Array]:
    """Plan bars so that no leg stands free for too long; also return the places (k, 3) that lack a bar.

    From the bed up, each leg is joined to a near one as soon as it has stood free for most of the length
    allowed. A bar ends the free length of both.

    Args:
        hidden: returns whether none of the points (n, 3) along a bar would show in a picture.
    """
    if not legs:
        return [], np.empty((0, 3))
    most = _SPARE * longest_free_leg_mm(radius, young_modulus_mpa)
    sizes = [len(leg.points) for leg in legs]
    points = np.concatenate([leg.points for leg in legs])
    own = np.repeat(np.arange(len(legs)), sizes)
    along = np.concatenate([_STEP_MM * np.arange(size) for size in sizes])
    total = _STEP_MM * np.array(sizes)
    begin = np.cumsum([0, *sizes])
    steps = np.concatenate([np.gradient(leg.points, axis=0) for leg in legs])
    ways = steps / np.linalg.norm(steps, axis=1)[:, None]
    flat, level = cKDTree(points[:, :2]), cKDTree(points)

    def find_bar(n: int, longest: float) -> tuple[Bar, int] | None:
        """Find the shortest bar from a point, no longer than `longest`, and the point that it leads to."""
        here = points[n]
        near = np.array(flat.query_ball_point(here[:2], 2 * radius + longest))
        near = near[(np.abs(points[near, 2] - here[2]) < 0.5 * _STEP_MM) & (own[near] != own[n])]
        near = near[along[near] > 3 * radius]
        away = np.linalg.norm(points[near] - here, axis=1)
        for k in np.argsort(away, kind="stable").tolist()[:_TRIED]:
            if away[k] < 1.9 * radius:
                continue
            there = points[near[k]] * np.array([1.0, 1.0, 0.0]) + here * np.array([0.0, 0.0, 1.0])
            length = float(np.linalg.norm(there - here))
            if length - 2 * radius > longest:
                break
            if np.abs(ways[[n, near[k]]] @ (there - here)).max() > _ASLANT * length:
                continue
            line = np.linspace(here, there, int(length / _FINE_MM) + 2)
            air = np.flatnonzero(level.query(line)[0] > radius)
            if not len(air) or np.ptp(air) >= len(air):
                continue
            # just below a peak its two legs have met at the bar's top
            if level.query(line[air] + [0.0, 0.0, 0.5 * BAR_MM[1]])[0].max() <= radius:
                continue
            start, end = line[air[0]], line[air[-1]]
            found = Bar(start, end, float(np.linalg.norm(end - start)))
            if not _LEAST_MM <= found.gap_mm <= longest or not hidden(line[::_EVERY]):
                continue
            reach = 0.5 * found.gap_mm + radius
            beside = np.array(level.query_ball_point(0.5 * (start + end), reach), dtype=np.int64)
            # a strand that leans towards the other is near the bar, but not in its way
            for e in (n, near[k]):
                theirs = np.abs(along[beside] - along[e]) < _OWN_RADII * radius
                beside = beside[(own[beside] != own[e]) | ~theirs]
            if _is_clear(found, points[beside], radius):
                return found, int(near[k])
        return None

    tied = np.zeros(len(legs))
    bars, lacking = list[Bar](), list[Array]()
    for n in np.argsort(points[:, 2], kind="stable").tolist():
        leg = int(own[n])
        free = along[n] - tied[leg]
        if total[leg] - tied[leg] <= most or free < _SOON * most:
            continue
        late = free >= 0.95 * most
        found = find_bar(n, MOST_BAR_MM if late else _WAITS_MM)
        if found is None and free > most:
            # nothing where a bar would be best: the next one down
            lowest = begin[leg] + int(max(tied[leg], 3 * radius) / _STEP_MM) + 1
            for lower in range(n - _BACK, lowest, -_BACK):
                if (found := find_bar(lower, MOST_BAR_MM)) is not None:
                    n = lower
                    break
            else:
                lacking.append(points[n])
                tied[leg] = along[n]
        if found is not None:
            bar, other = found
            bars.append(bar)
            tied[leg] = along[n]
            tied[own[other]] = max(tied[own[other]], along[other])
    return bars, np.array(lacking).reshape(-1, 3)


def _is_clear(bar: Bar, near: Array, radius: float) -> bool:
    """Return whether none of the other strands' points (n, 3) near a bar lies between its ends."""
    way, length = bar.end - bar.start, bar.gap_mm
    along = (near - bar.start) @ way / length
    aside = np.linalg.norm(near - bar.start - along[:, None] * way / length, axis=1)
    between = (along > -0.5 * radius) & (along < length + 0.5 * radius)
    return not bool((between & (aside < radius + 0.5 * BAR_MM[0])).any())
