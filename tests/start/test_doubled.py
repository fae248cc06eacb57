"""Arches of two strands that hide each other along a thin stroke."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import LineString, MultiPolygon, Point, Polygon, union_all
from tables import some

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import arc_lengths, sample_evenly
from knotfab.start.arches import Arches, draw_arches
from knotfab.start.depth import _overlapping
from knotfab.start.doubled import Doubled, find_doubled
from knotfab.start.filling import fill

RADIUS = 1.7
TOP_MM = 85.0


def draw_body(*strokes: LineString, wide: float = 1.0) -> list[Array]:
    """Return centre lines about a disc, 80 mm across, with thin strokes, `wide` tube radii apart."""
    ribbons = [s.buffer(0.5 * wide * RADIUS, cap_style="flat") for s in strokes]
    shape = union_all([Point(0, 0).buffer(40.0), *ribbons])
    assert isinstance(shape, Polygon)
    rings = [shape.exterior, *shape.interiors]
    return [sample_evenly(np.asarray(ring.coords)[:-1], 0.8 * RADIUS) for ring in rings]


def find(samples: list[Array]) -> list[Doubled]:
    return find_doubled(samples, _overlapping(tuple(samples), RADIUS), RADIUS)


def draw(rng: np.random.Generator, samples: list[Array], doubled: list[Doubled]) -> Arches:
    arcs = [arc_lengths(s) for s in samples]
    given = rng, arcs, np.full(len(samples), TOP_MM), RADIUS, [None] * len(samples)
    return draw_arches(*given, doubled)


def changes_of_order(samples: list[Array], arches: Arches, near: LineString) -> int:
    """Count how often strands along a stroke change places in depth."""
    height = np.concatenate(arches.heights([arc_lengths(s) for s in samples]))
    points = np.concatenate(samples)
    one, other = _overlapping(tuple(samples), RADIUS)
    along = np.array([near.project(Point(p)) for p in points])
    left = np.array([near.buffer(4.0, single_sided=True).covers(Point(p)) for p in points])
    beside = (np.abs(along[one] - along[other]) < RADIUS) & (left[one] != left[other])
    one, other = one[beside], other[beside]
    gap = np.where(left[one], 1.0, -1.0) * (height[one] - height[other])
    order = np.sign(gap[np.argsort(along[one], kind="stable")])
    return int((np.diff(order[order != 0]) != 0).sum())


STRAIGHT = LineString([(30, 0), (140, 0)])
LONG = LineString([(30, 0), (330, 0)])


@pytest.mark.parametrize(
    ("stroke", "changes"), [(STRAIGHT, 0), (LONG, 1)], ids=["one arch", "two arches"]
)
@pytest.mark.parametrize("count", some([6, 20], 2))
def test_strands_change_places_only_where_the_stroke_is_longer_than_an_arch(
    stroke: LineString, changes: int, count: int
) -> None:
    samples = draw_body(stroke)
    (stretch,) = find(samples)
    assert [tip is None for tip in stretch.tips] in ([True, False], [False, True])
    rng, (arc,) = np.random.default_rng(0), [arc_lengths(s) for s in samples]
    loose = [changes_of_order(samples, draw(rng, samples, []), stroke) for _ in range(count)]
    assert np.mean(loose) > changes + 1
    for number in range(count):
        arches = draw(rng, samples, [stretch])
        if number % 2:
            arches = arches.varied(rng, 0.5)
        assert changes_of_order(samples, arches, stroke) <= changes
        assert sum(span.length_mm for span in arches.spans[0]) == pytest.approx(arc[-1])
        (height,) = arches.heights([arc])
        assert 0.0 <= height.min() < 0.05 and height.max() <= TOP_MM
        steep = np.degrees(np.arctan(np.abs(np.diff(height)) / np.diff(arc)[:-1]))
        assert (steep < 40.0).mean() < 0.2  # but for what is rounded


def test_nested_strands_are_more_than_a_tube_apart() -> None:
    samples = draw_body(STRAIGHT)
    rng, (arc,) = np.random.default_rng(1), [arc_lengths(s) for s in samples]
    one, other = _overlapping(tuple(samples), RADIUS)
    for _ in range(10):
        (height,) = draw(rng, samples, find(samples)).heights([arc])
        points = np.column_stack([samples[0], height])
        along = 0.5 * (points[one, 0] + points[other, 0])
        inside = (along > 50.0) & (along < 130.0)
        apart = np.linalg.norm(points[one] - points[other], axis=1)[inside]
        assert apart.min() > 2.1 * RADIUS


def test_where_a_ring_was_cut_one_tip_is_above_the_other() -> None:
    ring = [(-np.cos(t) * 60 + 60, 60 * np.sin(t)) for t in np.linspace(0.3, 2 * np.pi - 0.3, 90)]
    halves = LineString(ring[:45]), LineString(ring[45:])
    samples = draw_body(*halves)
    found = find(samples)
    assert len(found) == 2
    tips = sorted(tip for stretch in found for tip in stretch.tips if tip is not None)
    assert tips[0] == 0.0 < tips[1]


def test_a_picture_without_thin_strokes_has_none() -> None:
    samples = draw_body(LineString([(0, 0), (90, 0)]), wide=8.0)
    assert find(samples) == []
    (stroke,) = find(draw_body(STRAIGHT))
    assert find(draw_body(LineString([(0, 0), (55, 0)]))) == []  # too short to matter
    assert stroke.ends[1] - stroke.ends[0] == pytest.approx(100.0, abs=10.0)


@pytest.mark.parametrize(("wide", "strokes"), [(3.0, 1), (5.2, 0), (7.0, 0)])
def test_a_stroke_of_three_strands_hides_what_steps_aside(wide: float, strokes: int) -> None:
    bar = STRAIGHT.buffer(0.5 * wide * RADIUS, cap_style="flat")
    shape = MultiPolygon([union_all([Point(0, 0).buffer(40.0), bar])])
    curves = [sample_evenly(c, 0.8 * RADIUS) for c in fill(shape, RADIUS).curves]
    long = [d for d in find(curves) if d.ends[1] - d.ends[0] > 60.0]
    assert len(long) == strokes


@pytest.mark.parametrize("top_mm", [0.0, 2.0, 5.0, 20.0, TOP_MM])
@pytest.mark.parametrize("length", [30.0, 60.0, 150.0])
def test_a_stroke_alone_stands_on_three_feet_or_lies(length: float, top_mm: float) -> None:
    ribbon = LineString([(0, 0), (length, 0)]).buffer(0.5 * RADIUS)
    samples = [sample_evenly(np.asarray(ribbon.exterior.coords)[:-1], 0.8 * RADIUS)]
    rng, (arc,) = np.random.default_rng(2), [arc_lengths(s) for s in samples]
    for _ in range(10):
        given = rng, [arc], np.array([top_mm]), RADIUS, [None]
        arches = draw_arches(*given, find(samples))
        (height,) = arches.heights([arc])
        feet = ((height < 0.2) & (np.roll(height, 1) >= 0.2)).sum()
        assert not height.any() or (feet >= 3 and height.max() <= top_mm)
