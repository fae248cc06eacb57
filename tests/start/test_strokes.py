"""A drawing's lines become one simple closed curve, and passes that hide each other keep apart."""

from __future__ import annotations

from itertools import pairwise
from math import cos, pi, sin

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import LinearRing, LineString, MultiPolygon, Point

from knotfab.start.depth import lift
from knotfab.start.filling import simple_curves
from knotfab.start.lanes import assign_lanes, part_passes
from knotfab.start.strokes import follow_strokes

Line = NDArray[np.float64]
RADIUS, SEPARATION, LIGHT = 1.0, 2.5, 500.0


def line(*points: tuple[float, float]) -> Line:
    """A line of many points."""
    return np.asarray(shapely.get_coordinates(LineString(points).segmentize(0.5)))


def ring(x: float, y: float, radius: float, ends: int = 1) -> list[Line]:
    """A circle in so many arcs, which meet exactly."""
    at = [2 * pi * k / ends for k in range(ends + 1)]
    arcs = []
    for one, end in pairwise(at):
        t = np.linspace(one, end, 80 // ends)
        arcs.append(np.stack([x + radius * np.cos(t), y + radius * np.sin(t)], axis=1))
        arcs[-1][-1] = (x + radius * cos(end % (2 * pi)), y + radius * sin(end % (2 * pi)))
        arcs[-1][0] = (x + radius * cos(one % (2 * pi)), y + radius * sin(one % (2 * pi)))
    return arcs


def drawn(lines: list[Line]) -> MultiPolygon:
    """The lines as wide as the tube."""
    shape = shapely.union_all([LineString(one).buffer(RADIUS) for one in lines])
    return shape if isinstance(shape, MultiPolygon) else MultiPolygon([shape])


# lines, curves, and how many times their length the curves are long, about
CASES: dict[str, tuple[list[Line], int, float]] = {
    "line": ([line((0, 0), (40, 0))], 1, 2.0),
    "ring": (ring(0, 0, 15), 1, 1.0),
    "star": ([line((0, 0), (20 * cos(t), 20 * sin(t))) for t in (0.3, 2.2, 4.0)], 1, 2.0),
    "eight": ([*ring(-10, 0, 10), *[x * (-1.0, 1.0) for x in ring(-10, 0, 10)]], 1, 1.0),
    "theta": ([*ring(0, 0, 15, 2), line((-15, 0), (15, 0))], 1, 154.2 / 124.2),
    "tail": ([*ring(0, 0, 10), line((10, 0), (30, 0))], 1, 102.8 / 82.8),
    "window": ([line(a, b) for a, b in (
        ((0, 0), (10, 0)), ((10, 0), (20, 0)), ((0, 10), (10, 10)), ((10, 10), (20, 10)),
        ((0, 20), (10, 20)), ((10, 20), (20, 20)), ((0, 0), (0, 10)), ((0, 10), (0, 20)),
        ((10, 0), (10, 10)), ((10, 10), (10, 20)), ((20, 0), (20, 10)), ((20, 10), (20, 20)),
    )], 1, 16 / 12),
    "two": ([line((0, 0), (30, 0)), line((0, 20), (30, 20))], 2, 2.0),
}  # fmt: skip
# lines meet to the last digit
CASES["eight"][0][0][[0, -1]] = CASES["eight"][0][1][[0, -1]] = (0.0, 0.0)
CASES["theta"][0][0][-1] = CASES["theta"][0][1][0] = (-15.0, 0.0)
CASES["theta"][0][1][-1] = (15.0, 0.0)


@pytest.mark.parametrize("name", CASES)
def test_one_simple_curve_runs_along_all_lines(name: str) -> None:
    lines, count, times = CASES[name]
    found = follow_strokes(lines, drawn(lines), RADIUS)
    assert found.passes and len(found.curves) == count and simple_curves(list(found.curves))
    curves = [LinearRing(c) for c in found.curves]
    every = shapely.union_all(curves)
    along = np.concatenate(lines)
    assert shapely.distance(shapely.points(along), every).max() < 0.9 * RADIUS
    middle = shapely.union_all([LineString(x) for x in lines])
    assert shapely.distance(shapely.points(np.concatenate(found.curves)), middle).max() < RADIUS
    length = sum(LineString(x).length for x in lines)
    # as few lines twice as the parity of their ends asks for (Guan's postman, 1962)
    assert sum(c.length for c in curves) / length == pytest.approx(times, rel=0.09)


def test_wide_strokes_are_run_through_twice() -> None:
    lines = ring(0, 0, 15)
    wide = MultiPolygon([LinearRing(lines[0]).buffer(1.6 * RADIUS)])
    once = follow_strokes(lines, drawn(lines), RADIUS).curves[0]
    twice = follow_strokes(lines, wide, RADIUS).curves[0]
    assert LinearRing(twice).length > 1.8 * LinearRing(once).length


def test_pieces_are_joined_into_one_knot() -> None:
    lines = CASES["two"][0]
    found = follow_strokes(lines, drawn(lines), RADIUS, knots=1)
    assert len(found.curves) == 1 and simple_curves(list(found.curves))


@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=12)
def test_any_tree_of_strokes_is_gone_around(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, lines = [np.zeros(2)], []
    for _ in range(200):
        root = places[int(rng.integers(len(places)))]
        turn = rng.uniform(0, 2 * pi)
        tip = root + rng.uniform(6, 15) * np.array([cos(turn), sin(turn)])
        new = LineString([root, tip])
        clear = all(LineString(x).distance(new) > 3 for x in lines if not (x == root).all(1).any())
        beside = [x for x in lines if (x == root).all(1).any()]
        if clear and all(
            LineString(x).distance(Point(root + (tip - root) / 2)) > 3 for x in beside
        ):
            lines.append(line(tuple(root), tuple(tip)))
            places.append(lines[-1][-1])
        if len(lines) == 9:
            break
    (curve,) = follow_strokes(lines, drawn(lines), RADIUS).curves
    assert LinearRing(curve).is_simple
    total = sum(LineString(x).length for x in lines)
    assert LinearRing(curve).length == pytest.approx(2 * total, rel=0.12)


@pytest.mark.parametrize("name", CASES)
def test_passes_that_hide_each_other_are_apart(name: str) -> None:
    lines = CASES[name][0]
    curves = follow_strokes(lines, drawn(lines), RADIUS).curves
    lanes = assign_lanes(curves, SEPARATION)
    # on a slope, so that passes side by side must differ by more
    depths = tuple(0.8 * c[:, 0] + 0.3 * c[:, 1] for c in curves)
    found = part_passes(curves, depths, lanes, SEPARATION, LIGHT)
    solid = [lift(c, d, LIGHT) for c, d in zip(curves, found, strict=True)]
    near = 0
    for k, one in enumerate(solid):
        for m, other in enumerate(solid[k:], k):
            apart = np.linalg.norm(one[:, None] - other, axis=2)
            if k == m:
                arc = np.cumsum(np.hypot(*np.diff(curves[k], axis=0, prepend=curves[k][-1:]).T))
                along = np.abs(arc[:, None] - arc)
                along = np.minimum(along, arc[-1] - along)
                apart[along < 2.5 * SEPARATION] = np.inf
            near += int((apart < 0.9 * SEPARATION).sum())
    assert near <= 0.001 * sum(map(len, curves)) ** 2
