"""The legs of strands that stand in arches, and the break-away bars that keep slender ones from swaying."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled
from knotfab.geometry.polylines import sample_evenly
from knotfab.geometry.tube import Mesh
from knotfab_formats.upright import longest_free_leg_mm

BAR_MM = 0.8, 0.4  # width and height of a bar: pliers break it
SUNK_MM = 0.5  # depth of a bar's end in its strand
MOST_BAR_MM = 9.0  # between the surfaces that a bar joins
_STEP_MM = 0.4  # spacing of the points on a leg
_PROMINENT_MM = 1.0  # least height by which a peak or valley stands out
_LEAST_MM = 0.3  # what is nearer is joined as it prints, or by no bar that could be broken
_MOST_SPARED = 1.5  # by one tie, of a leg
_TRIED = 8  # points at the same height
# cosine of the least angle between a bar and its strand: its end meets no surface sooner
_ASLANT = 0.75
_FINE_MM, _EVERY = 0.05, 10  # points along a bar, and each whose sides are looked at for the shadow
_BACK = 3  # points, from one place to the next
_OWN_RADII = 5.0  # so near along its leg, a point is part of the strand that a bar ends in


@dataclass(frozen=True)
class Leg:
    """A stretch of a curve from a valley up to a peak: its points (n, 3), `_STEP_MM` apart."""

    curve: int
    points: Array

    def list_free(self, ties: Array, within_mm: float) -> Array:
        """Return how much of it stands free below each point, (n,) mm, up to its next tie so near to it."""
        tied = cKDTree(self.points).query_ball_point(ties, within_mm) if len(ties) else []
        held = np.zeros(len(self.points), dtype=np.int64)
        for near in tied:
            held[near] = near
        return np.asarray(_STEP_MM * (np.arange(len(held)) - np.maximum.accumulate(held)))


@dataclass(frozen=True)
class Bar:
    """A level bar: places (3,) on the surfaces that it joins, and the gap between them, mm."""

    start: Array
    end: Array
    gap_mm: float

    def moved(self, motion: Array) -> Bar:
        """Return the bar moved by a similarity (4, 4)."""
        start, end = np.array([self.start, self.end]) @ motion[:3, :3].T + motion[:3, 3]
        return Bar(start, end, self.gap_mm * float(np.cbrt(np.linalg.det(motion[:3, :3]))))

    def record(self) -> dict[str, Any]:
        """Return its entry in knots.json: the axis of the box, its width and height."""
        middle, half = self._axis()
        width, height = BAR_MM
        ends = {"from": (middle - half).tolist(), "to": (middle + half).tolist()}
        return {**ends, "width_mm": width, "height_mm": height}

    def make_body(self) -> Mesh:
        """Make its mesh: a box whose ends are sunk in both strands."""
        (middle, half), side = self._axis(), self.half_width()
        up = np.array([0.0, 0.0, 0.5 * BAR_MM[1]])
        corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        vertices = [middle + i * half + j * side + k * up for k in (-1, 1) for i, j in corners]
        faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
        for n in range(4):
            m = (n + 1) % 4
            faces += [[n, m, m + 4], [n, m + 4, n + 4]]
        return np.array(vertices), np.array(faces, dtype=np.int64)

    def half_width(self) -> Array:
        """Return the way (3,) from its axis to its left side."""
        x, y, _ = (self.end - self.start) / np.linalg.norm(self.end - self.start)
        return 0.5 * BAR_MM[0] * np.array([-y, x, 0.0])

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
    *,
    longest_mm: float = MOST_BAR_MM,
    thrifty: bool = False,
) -> tuple[list[Bar], Array]:
    """Plan bars so that no leg stands free for too long; also return the places (k, 3) that lack a bar.

    From the bed up, the leg that must be held first is joined as late as it may be or, to be thrifty, where
    that spares it and its neighbour the most further bars. A bar ends the free length of both.

    Args:
        hidden: returns whether none of the points (n, 3) along both sides of a bar would show in a picture.
        longest_mm: of a bar, between surfaces.
    """
    if not legs:
        return [], np.empty((0, 3))
    most = longest_free_leg_mm(radius, young_modulus_mpa) + 0.5 * BAR_MM[1]  # to a bar's side
    sizes = [len(leg.points) for leg in legs]
    points = np.concatenate([leg.points for leg in legs])
    own = np.repeat(np.arange(len(legs)), sizes)
    along = np.concatenate([_STEP_MM * np.arange(size) for size in sizes])
    free = _find_free(legs, radius)
    total = free[:, 1]
    begin = np.cumsum([0, *sizes])
    steps = np.concatenate([np.gradient(leg.points, axis=0) for leg in legs])
    ways = steps / np.linalg.norm(steps, axis=1)[:, None]
    level, upwards = cKDTree(points), np.argsort(points[:, 2], kind="stable")
    heights = points[upwards, 2]
    lowest = np.searchsorted(heights, points[:, 2] - 0.5 * _STEP_MM)

    def needs(leg: int, at: float) -> float:
        """Count the ties that a leg still needs above a place along it, begun ones by their share."""
        left = total[leg] - at
        return float(max(np.ceil(left / most - 1e-9) - 1, 0) + 0.5 * max(left / most - 1, 0))

    def spares(leg: int, at: float) -> float:
        """Return what a tie there spares a leg: nothing where it comes too late or too soon."""
        in_time = tied[leg] < at <= tied[leg] + most
        return needs(leg, tied[leg]) - needs(leg, at) if in_time else 0.0

    def in_one_layer(n: int, other: int) -> bool:
        """Return whether a valley or peak at the height of two points joins them."""
        for turns in (begin[:-1], begin[1:] - 1):
            turn = points[turns[own[n]]]
            if (turn == points[turns[own[other]]]).all():
                return bool(abs(turn[2] - points[n, 2]) < radius + 0.5 * BAR_MM[1])
        return False

    def find_bar(n: int, least: float) -> tuple[float, Bar, int] | None:
        """Find the bar from a point that spares the two legs most, and the point that it leads to."""
        best, own_worth = None, spares(own[n], along[n])
        near, away = _find_level(n, points, upwards, lowest, own, along, radius, longest_mm)
        for k in range(len(near)):
            if away[k] < 1.9 * radius:
                continue
            worth = own_worth + spares(own[near[k]], along[near[k]])
            if worth <= least or in_one_layer(n, int(near[k])):
                continue
            found = lay_bar(n, int(near[k]))
            if found is not None:
                best, least = (worth, found, int(near[k])), worth
        return best

    @cache  # both plans try many of the same
    def lay_bar(n: int, other: int) -> Bar | None:
        """Lay a bar between two points; None where it would show, end badly or meet another strand."""
        here = points[n]
        there = points[other] * np.array([1.0, 1.0, 0.0]) + here * np.array([0.0, 0.0, 1.0])
        length = float(np.linalg.norm(there - here))
        if length - 2 * radius > longest_mm:
            return None
        if np.abs(ways[[n, other]] @ (there - here)).max() > _ASLANT * length:
            return None
        line = np.linspace(here, there, int(length / _FINE_MM) + 2)
        close = level.query_ball_point(0.5 * (here + there), 0.5 * length + radius + BAR_MM[1])
        about = points[close]
        first, last, count = _find_air(line, about, radius, 0.0)
        if not count or last - first >= count:
            return None
        # just below a peak its two legs have met at the bar's top
        if not _find_air(line[first : last + 1], about, radius, 0.5 * BAR_MM[1])[2]:
            return None
        start, end = line[first], line[last]
        found = Bar(start, end, float(np.linalg.norm(end - start)))
        if not _LEAST_MM <= found.gap_mm <= longest_mm:
            return None
        looked, side = line[::_EVERY], found.half_width()
        if not hidden(np.concatenate([looked + side, looked - side])):
            return None
        reach = 0.5 * found.gap_mm + radius
        beside = np.array(level.query_ball_point(0.5 * (start + end), reach), dtype=np.int64)
        # a strand that leans towards the other is near the bar, but not in its way
        for e in (n, other):
            theirs = np.abs(along[beside] - along[e]) < _OWN_RADII * radius
            beside = beside[(own[beside] != own[e]) | ~theirs]
        return found if _is_clear(found, points[beside], radius) else None

    def tie_legs(thrifty: bool) -> tuple[list[Bar], Array]:
        tied[:] = free[:, 0]
        bars, lacking = list[Bar](), list[Array]()
        ties = list[tuple[int, int]]()  # the points that each bar joins
        while (total - tied > most).any():
            # the lowest place at which a leg must be held
            latest = begin[:-1] + ((tied + most) / _STEP_MM).astype(int)
            waiting = np.flatnonzero(total - tied > most)
            leg = int(waiting[points[latest[waiting], 2].argmin()])
            above = begin[leg] + int(max(tied[leg], 3 * radius) / _STEP_MM) + 1
            best: tuple[float, Bar, int] | None = None
            for n in range(latest[leg], above, -_BACK):
                least = 0.0 if best is None else best[0]
                if best is not None and (
                    not thrifty or spares(leg, along[n]) + _MOST_SPARED <= least
                ):
                    break
                if (found := find_bar(n, least)) is not None:
                    best, place = found, n
            if best is None:
                lacking.append(points[latest[leg]])
                tied[leg] += most
                continue
            _, bar, other = best
            bars.append(bar)
            ties.append((place, other))
            tied[leg] = along[place]
            if spares(own[other], along[other]):
                tied[own[other]] = along[other]
        kept = _drop_spare(
            [bar.gap_mm for bar in bars],
            [[(int(own[n]), float(along[n])) for n in pair] for pair in ties],
            free,
            most,
        )
        return [bars[n] for n in kept], np.array(lacking).reshape(-1, 3)

    tied = np.zeros(len(legs))
    # a bar lower down may leave its leg out of reach of the next one
    tried = [tie_legs(False), *([tie_legs(True)] if thrifty else [])]
    return min(tried, key=lambda one: (len(one[1]), len(one[0])))


def _find_free(legs: list[Leg], radius: float) -> Array:
    """Find where along each leg it begins to stand free, and ends, (n, 2) mm.

    Near a valley or a peak its two legs are one: within two radii, surely. Below, they count as high as
    that is, for together they are far stiffer.
    """
    found = np.array([[0.0, _STEP_MM * len(leg.points)] for leg in legs])
    for end in (0, -1):
        first = dict[bytes, int]()
        for number, leg in enumerate(legs):
            other = first.setdefault(leg.points[end].tobytes(), number)
            for here, there in ((number, other), (other, number)) if other != number else ():
                one, beside = legs[here].points[:: 2 * end + 1], legs[there].points
                height = np.maximum.accumulate(beside[:, 2])
                apart = [one[:, k] - np.interp(one[:, 2], height, beside[:, k]) for k in (0, 1)]
                count = int(np.argmax(np.hypot(*apart) > 2 * radius))
                saved = _STEP_MM * count - (0.0 if end else one[count, 2] - one[0, 2])
                found[here, end] += max(saved, 0.0) * (2 * end + 1)
    return found


def hide_behind(mask: Mask, projection: Array) -> Callable[[Array], bool]:
    """Return a function that tests whether a picture (H, W) hides the shadows of all points (n, 3).

    `projection` (3, 4) maps them to its pixels, whose centres are whole numbers.
    """
    height, width = mask.shape

    def hidden(points: Array) -> bool:
        u, v, w = projection[:, :3] @ points.T + projection[:, 3:]
        column, row = np.rint(u / w).astype(int), np.rint(v / w).astype(int)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return bool(inside.all() and mask[row, column].all())

    return hidden


def _drop_spare(
    gaps: list[float], ties: list[list[tuple[int, float]]], free: Array, most: float
) -> list[int]:
    """Choose which bars stay: each without which a leg would stand free for more than `most` mm.

    Args:
        gaps: of the bars, the widest of which goes first. ties: the two legs that each joins, and how far
            along.
        free: as `_find_free` says.
    """
    along = [sorted(at for pair in ties for leg, at in pair if leg == n) for n in range(len(free))]
    kept = set(range(len(gaps)))
    for bar in sorted(kept, key=lambda n: -gaps[n]):
        for leg, at in ties[bar]:
            rest, (foot, end) = along[leg].copy(), free[leg]
            rest.remove(at)
            longest = np.diff([foot, *rest, end]).max()
            # where a leg lacks a bar it stands free for longer, whatever else holds it
            if longest > max(most, np.diff([foot, *along[leg], end]).max()):
                break
        else:
            kept.remove(bar)
            for leg, at in ties[bar]:
                along[leg].remove(at)
    return sorted(kept)


@compiled
def _find_level(
    n: int,
    points: Array,
    upwards: Indices,
    lowest: Indices,
    own: Indices,
    along: Array,
    radius: float,
    longest: float,
) -> tuple[Indices, Array]:
    """Find the `_TRIED` points of other legs nearest to point n at its height, off the bed, and how far.

    `upwards` orders all points by their heights; from place `lowest` on they are at that of each point.
    """
    near, away, count = np.empty(_TRIED, np.int64), np.full(_TRIED, np.inf), 0
    z, reach = points[n, 2], 2 * radius + longest
    for place in range(lowest[n], len(upwards)):
        k = upwards[place]
        x, y, up = points[k, 0] - points[n, 0], points[k, 1] - points[n, 1], points[k, 2] - z
        if up >= 0.5 * _STEP_MM:
            break
        if own[k] == own[n] or along[k] <= 3 * radius or -up >= 0.5 * _STEP_MM:
            continue
        if x * x + y * y > reach * reach:
            continue
        far = np.sqrt(x * x + y * y + up * up)
        if far >= away[_TRIED - 1]:
            continue
        at = min(count, _TRIED - 1)
        while at > 0 and away[at - 1] > far:
            near[at], away[at] = near[at - 1], away[at - 1]
            at -= 1
        near[at], away[at] = k, far
        count = min(count + 1, _TRIED)
    return near[:count], away[:count]


@compiled
def _find_air(line: Array, points: Array, radius: float, up: float) -> tuple[int, int, int]:
    """Find the first and last places (n, 3) of a line, raised by `up`, farther than `radius` from all points.

    Also count them all.
    """
    first, last, count = -1, -1, 0
    for n in range(len(line)):
        x, y, z = line[n, 0], line[n, 1], line[n, 2] + up
        free = True
        for k in range(len(points)):
            a, b, c = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            if a * a + b * b + c * c <= radius * radius:
                free = False
                break
        if free:
            if first < 0:
                first = n
            last = n
            count += 1
    return first, last, count


def _is_clear(bar: Bar, near: Array, radius: float) -> bool:
    """Return whether none of the other strands' points (n, 3) near a bar lies between its ends."""
    way, length = bar.end - bar.start, bar.gap_mm
    along = (near - bar.start) @ way / length
    aside = np.linalg.norm(near - bar.start - along[:, None] * way / length, axis=1)
    between = (along > -0.5 * radius) & (along < length + 0.5 * radius)
    return not bool((between & (aside < radius + 0.5 * BAR_MM[0])).any())
