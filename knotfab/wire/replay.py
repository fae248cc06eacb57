"""Bend the wire again from its rows alone, and measure the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array
from knotfab.geometry.sampling import pair_nearby, sample_evenly
from knotfab.wire.bends import BendList

__all__ = [
    "Deviation",
    "Sensitivity",
    "measure_deviation",
    "measure_least_distance",
    "measure_sensitivity",
    "replay",
]


_STEP_MM = 0.1  # between the places at which two curves are compared
_WINDOW = 30  # places to either side
_APART_MM = 0.25  # between the places of which distances of strands are taken


def replay(rows: BendList, step_deg: float = 4.0, step_mm: float = 0.5) -> tuple[Array, Array]:
    """Return the centre line that the rows give, from the start to the other end.

    Carries a frame along: `t` the direction of the wire and `n` the side it bends to. A rotation
    by a takes n to n cos a + (t x n) sin a; a bend by b moves along an arc of the row's radius to
    t cos b + n sin b.

    Returns:
        (k, 3) points in mm, and the place (m, 3) where each bend begins (rows with a bend). The
        first and last point are the wire's two ends, which a closed plan brings together.
    """
    at = rows.start.copy()
    points, begins = [at], []
    for row, (t, n) in zip(rows.bends, _carry_frames(rows), strict=True):
        pieces = max(1, int(np.ceil(row.feed_mm / step_mm)))
        points += [at + t * (row.feed_mm * (k + 1) / pieces) for k in range(pieces)]
        at = points[-1]
        if row.bend_deg <= 0:
            continue
        begins.append(at)
        bend, steps = np.deg2rad(row.bend_deg), max(1, int(np.ceil(row.bend_deg / step_deg)))
        for b in bend * (np.arange(steps) + 1) / steps:
            points.append(at + row.radius_mm * (np.sin(b) * t + (1 - np.cos(b)) * n))
        at = points[-1]
    return np.array(points), np.array(begins).reshape(-1, 3)


def _carry_frames(rows: BendList) -> list[tuple[Array, Array]]:
    """Return the direction of each row's straight, and the side that the wire then bends to."""
    t, n = rows.direction, rows.normal
    found = []
    for row in rows.bends:
        # kept at right angles and of length one: otherwise rounding doubles with every few bends
        t = t / np.linalg.norm(t)
        n = n - (n @ t) * t
        n = n / np.linalg.norm(n)
        angle, bend = np.deg2rad(row.rotation_deg), np.deg2rad(row.bend_deg)
        n = np.cos(angle) * n + np.sin(angle) * np.cross(t, n)
        found.append((t, n))
        t, n = np.cos(bend) * t + np.sin(bend) * n, np.cos(bend) * n - np.sin(bend) * t
    return found


@dataclass(frozen=True)
class Deviation:
    """Measure how far two closed curves are from each other (mm).

    `largest` and `mean` are plain distances, `across` is the largest distance across the rays of any
    view's light: the only kind that the shadows see.
    """

    largest: float
    mean: float
    across: float
    at: tuple[float, float, float]  # a place on the first curve


def measure_deviation(curve: Array, other: Array, lights: Sequence[Array]) -> Deviation:
    """Measure distances of the points of a closed curve (n, 3) from another (k, 3), both ways.

    Points answer to about the same share of the way around, so that another strand that passes
    close by does not excuse one that strayed.

    Args:
        other: begins anywhere and runs in the same sense.
        lights: (3,) of each view; none: every direction counts as across.
    """
    first, second = sample_evenly(curve, _STEP_MM), sample_evenly(other, _STEP_MM)
    # start both at the same place: the point of the first that is nearest to where the other begins
    shift = int(((first - second[0]) ** 2).sum(axis=1).argmin())
    first = np.roll(first, -shift, axis=0)
    there = _find_nearest(first, second)
    back = _find_nearest(second, first)
    gaps = np.concatenate([second[there] - first, second - first[back]])
    places = np.concatenate([first, first[back]])
    size = np.linalg.norm(gaps, axis=1)
    across = size if not len(lights) else np.zeros(len(gaps))
    for light in lights:
        ray = light - places
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        seen = np.linalg.norm(gaps - (gaps * ray).sum(axis=1)[:, None] * ray, axis=1)
        across = np.maximum(across, seen)
    x, y, z = places[int(size.argmax())]
    return Deviation(
        float(size.max()),
        float(size[: len(first)].mean()),
        float(across.max()),
        (float(x), float(y), float(z)),
    )


def _find_nearest(points: Array, others: Array) -> NDArray[np.int64]:
    """Find for each point the nearest of `others` at about the same share of the way around.

    The share becomes a circle in two more dimensions, wide enough that a strand elsewhere is farther
    than the right one, and flat enough that stretching moves nothing.
    """
    size = float(np.ptp(np.concatenate([points, others]), axis=0).max())

    def lifted(p: Array) -> Array:
        angle = 2 * np.pi * np.arange(len(p)) / len(p)
        return np.column_stack([p, size * np.cos(angle), size * np.sin(angle)])

    _, found = cKDTree(lifted(others)).query(lifted(points))
    # the circle draws the answer along the strand a little: the nearest within a few mm of it
    window = (found[:, None] + np.arange(-_WINDOW, _WINDOW + 1)) % len(others)
    gap = points[:, None, :] - others[window]
    best = (gap * gap).sum(axis=2).argmin(axis=1)
    return np.asarray(window[np.arange(len(points)), best], dtype=np.int64)


def measure_least_distance(curves: list[Array], diameter: float) -> float:
    """Measure the least distance (mm) of centre lines where they are different strands.

    Two places of one curve count as different strands when the way between them along the wire is
    longer than a half circle about one diameter: shorter ones are one bend. Distances above three
    diameters are not looked for: the answer is then three diameters.
    """
    even = [sample_evenly(c, _APART_MM) for c in curves]
    points = np.concatenate(even)
    for reach in (1.2 * diameter, 3.0 * diameter):
        pairs, along = pair_nearby(even, reach)
        a, b = pairs[along > 0.5 * np.pi * diameter + reach].T
        if len(a):
            return float(np.linalg.norm(points[a] - points[b], axis=1).min())
    return 3.0 * diameter


@dataclass(frozen=True)
class Sensitivity:
    """Measure how far the rest of the wire moves for one degree of error in a bend (mm).

    `worst` of any single bend; `typical`: of one degree at every bend, the errors independent.
    """

    worst: float
    typical: float


def measure_sensitivity(rows: BendList) -> Sensitivity:
    """Measure movement of the wire's far end for errors of one degree in bend angles."""
    points, begins = replay(rows)
    pairs = zip(rows.bends, _carry_frames(rows), strict=True)
    axes = np.array([np.cross(t, n) for row, (t, n) in pairs if row.bend_deg > 0])
    arms = np.linalg.norm(np.cross(axes.reshape(-1, 3), points[-1] - begins), axis=1)
    moved = arms * np.deg2rad(1.0)
    return Sensitivity(float(moved.max(initial=0.0)), float(np.sqrt((moved**2).sum())))
