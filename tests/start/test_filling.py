"""The filling template: simple disjoint curves that cover the silhouette."""

from itertools import pairwise
from math import cos, pi, sin

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from shapely import LinearRing, LineString, MultiPolygon, Point, Polygon, box, union_all
from tables import some

from benchmarks.hard.pictures import HardPicture, circle, hard_pictures
from knotfab.base.arrays import Array
from knotfab.geometry.polylines import arc_lengths, sample_evenly
from knotfab.picture.silhouette import trace_polygon
from knotfab.start.arches import Arches, draw_arches
from knotfab.start.depth import _overlapping
from knotfab.start.doubled import Doubled, find_doubled
from knotfab.start.filling import enlarge_loops, fill, rings_of, simple_curves, template_iou
from knotfab.start.lanes import assign_lanes, part_passes
from knotfab.start.profiles import lift
from knotfab.start.strokes import follow_strokes

DISC = Point(0, 0).buffer(50, quad_segs=64)
RING = Polygon(DISC.exterior, [Point(0, 0).buffer(30, quad_segs=64).exterior])
COMB = shapely.union_all([box(0, 0, 100, 12)] + [box(x, 0, x + 7, 60) for x in range(0, 100, 18)])


@pytest.mark.slow
@pytest.mark.parametrize("shape", [DISC, RING, COMB], ids=["disc", "ring", "comb"])
@pytest.mark.parametrize("radius", [1.2, 2.0, 3.1])
def test_one_simple_curve_covers_a_piece(shape: Polygon, radius: float) -> None:
    template = fill(MultiPolygon([shape]), radius)
    assert len(template.curves) == 1
    assert LinearRing(template.curves[0]).is_simple
    assert template_iou(template, template.polygon) > 0.9


def test_pieces_become_knots_of_their_own_or_are_bridged() -> None:
    both = MultiPolygon([DISC, box(60, -20, 90, 20), box(100, -20, 120, 20)])
    apart = fill(both, 2.0)
    assert len(apart.curves) == 3
    assert simple_curves(list(apart.curves))
    two = fill(both, 2.0, knots=2)
    assert len(two.curves) == 2
    one = fill(both, 2.0, knots=1)
    assert len(one.curves) == 1
    assert LinearRing(one.curves[0]).is_simple
    # every piece is still drawn
    for piece in both.geoms:
        drawn = LinearRing(one.curves[0]).buffer(2.0).intersection(piece).area
        assert drawn > 0.9 * piece.area


def test_rings_keep_their_distance_from_the_outline() -> None:
    for ring in rings_of(DISC, 2.0):
        assert ring.distance(DISC.exterior) >= 2.0 - 1e-6


def test_a_piece_smaller_than_the_tube_still_gets_a_loop() -> None:
    template = fill(MultiPolygon([box(0, 0, 1, 1)]), 2.0)
    assert len(template.curves) == 1
    assert len(template.curves[0]) >= 8


def test_a_piece_that_no_tube_draws_gets_no_curve() -> None:
    """The middle of a thin frame about a block is in the block, where a loop draws nothing of it."""
    frame = box(-60, -60, 60, 60).difference(box(-59, -59, 59, 59))
    both = MultiPolygon([box(-30, -20, 30, 20), frame])
    template = fill(both, 1.5)
    assert len(template.curves) == 1
    assert LinearRing(template.curves[0]).within(both.geoms[0])
    assert template_iou(template, both) == pytest.approx(2400 / both.area, abs=0.06)
    # a hair beside it has its middle in itself, of which a loop draws next to nothing
    hair = MultiPolygon([both.geoms[0], box(40, -40, 40.5, 40)])
    assert len(fill(hair, 1.5).curves) == len(fill(hair, 1.5, knots=2).curves) == 1
    # a template does not refuse a part that no tube draws
    alone = fill(MultiPolygon([frame]), 1.5)
    assert len(alone.curves) == 1 and template_iou(alone, alone.polygon) < 0.1


def test_a_loop_counts_as_the_least_ring_that_the_tube_bends_to() -> None:
    dot = MultiPolygon([Point(0, 0).buffer(6.0), DISC.buffer(0).difference(DISC.buffer(-20))])
    template = fill(dot, 5.5)
    bent = enlarge_loops(template, 5.7)
    changed = [
        k for k, (a, b) in enumerate(zip(template.curves, bent.curves, strict=True)) if a is not b
    ]
    assert len(template.curves) == 2 and len(changed) == 1
    ring = bent.curves[changed[0]]
    assert np.linalg.norm(ring, axis=1).max() == pytest.approx(5.7, rel=1e-3)
    assert template_iou(bent, dot) < template_iou(template, dot) - 0.01
    thin = fill(dot, 2.0)
    assert all(a is b for a, b in zip(enlarge_loops(thin, 2.2).curves, thin.curves, strict=True))


def test_even_samples_are_even_and_stay_on_the_curve() -> None:
    rng = np.random.default_rng(0)
    polygon = rng.normal(size=(40, 3))
    samples = sample_evenly(polygon, 0.05)
    closed = np.concatenate([polygon, polygon[:1]])
    a, e = closed[:-1], np.diff(closed, axis=0)
    for p in samples[::17]:
        t = np.clip(((p - a) * e).sum(1) / (e * e).sum(1), 0, 1)
        assert np.linalg.norm(a + t[:, None] * e - p, axis=1).min() < 1e-9


def test_crossing_curves_are_told() -> None:
    eight = np.array([[0, 0], [10, 10], [10, 0], [0, 10]], dtype=float)
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], dtype=float)
    assert simple_curves([square, square + 20])
    assert not simple_curves([eight])
    assert not simple_curves([square, square + 5])


@pytest.mark.slow
def test_strands_that_just_touch_have_the_area_they_cover() -> None:
    """A block's insets lie exactly two radii apart: GEOS once drew them as an invalid polygon."""
    mask = np.zeros((128, 128), dtype=np.bool_)
    mask[40:90, 20:60] = True
    polygon = shapely.transform(trace_polygon(mask), lambda p: p * 150 / 128)
    for radius in (1.5, 1.9472):
        template = fill(polygon, radius)
        low_x, low_y, high_x, high_y = polygon.buffer(2 * radius).bounds
        step = radius / 6
        x, y = np.meshgrid(np.arange(low_x, high_x, step), np.arange(low_y, high_y, step))
        at = shapely.points(x.ravel(), y.ravel())
        lines = shapely.union_all([LinearRing(c) for c in template.curves])
        tube, inside = shapely.dwithin(lines, at, radius), shapely.contains(polygon, at)
        counted = (tube & inside).sum() / (tube | inside).sum()
        assert template_iou(template, polygon) == pytest.approx(counted, abs=0.01)


SLOW = {"checkerboard", "noise", "page", "carpet", "koch", "rings", "lattice", "dots", "spiral"}


def test_an_outline_of_a_hundred_thousand_corners_is_filled() -> None:
    outline = shapely.MultiPolygon([shapely.Polygon(circle(100_000, 10.0)[:, :2])])
    found = fill(outline, 2.0)
    assert len(found.curves) == 1
    assert all(np.isfinite(c).all() for c in found.curves)


@pytest.mark.parametrize(
    "case", [c for c in hard_pictures() if c.name not in SLOW], ids=lambda case: case.name
)
def test_hard_pictures_have_valid_outlines_and_templates(case: HardPicture) -> None:
    mask = case.draw()
    polygon = trace_polygon(mask)
    assert polygon.is_valid
    area = float(np.count_nonzero(mask))
    assert polygon.is_empty == (case.name in {"blank", "pixel", "strip"})
    if polygon.is_empty:
        return
    for radius in (4.0, 40.0):
        found = fill(polygon, radius)
        assert all(len(c) >= 3 and np.isfinite(c).all() for c in found.curves)
    if area > 2000:
        assert polygon.area == pytest.approx(area, rel=0.05)


def test_an_inset_that_splits_gives_one_curve_all_the_same() -> None:
    case = next(c for c in hard_pictures() if c.name == "dumbbell")
    found = fill(trace_polygon(case.draw()), 14.0)
    assert len(found.curves) == 1
    assert shapely.LinearRing(found.curves[0]).is_simple


@pytest.mark.slow
def test_noise_is_filled_at_the_tubes_own_scale() -> None:
    case = next(c for c in hard_pictures() if c.name == "noise")
    found = fill(trace_polygon(case.draw()), 8.0)
    assert 1 <= len(found.curves) < 100


@settings(max_examples=2)
@given(seed=st.lists(st.integers(0, 2**31), min_size=1, max_size=1))
@example(seed=[2613, 1])  # whose inset once crossed itself
@pytest.mark.slow
def test_blurred_noise_is_traced_and_filled_by_a_tube_of_any_thickness(seed: list[int]) -> None:
    rng = np.random.default_rng(seed)
    noise = gaussian_filter(rng.normal(size=(160, 200)), float(rng.uniform(0, 12)))
    polygon = trace_polygon(noise > np.quantile(noise, rng.uniform(0.2, 0.95)))
    assert polygon.is_valid
    if not polygon.is_empty:
        for curve in fill(polygon, float(10.0 ** rng.uniform(0.4, 1.8))).curves:
            assert np.isfinite(curve).all() and len(curve) >= 3


def test_a_template_that_crosses_itself_has_an_iou() -> None:
    comb = trace_polygon(next(c for c in hard_pictures() if c.name == "comb").draw())
    for radius in (2.0, 3.0):
        assert 0 <= template_iou(fill(comb, radius), comb) <= 1


# A drawing's lines become one simple closed curve, and passes that hide each other keep apart.


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
@settings(max_examples=12)
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


# Arches of two strands that hide each other along a thin stroke.


RADIUS_DOUBLED = 1.7
TOP_MM = 85.0


def draw_body(*strokes: LineString, wide: float = 1.0) -> list[Array]:
    """Return centre lines about a disc, 80 mm across, with thin strokes, `wide` tube radii apart."""
    ribbons = [s.buffer(0.5 * wide * RADIUS_DOUBLED, cap_style="flat") for s in strokes]
    shape = union_all([Point(0, 0).buffer(40.0), *ribbons])
    assert isinstance(shape, Polygon)
    rings = [shape.exterior, *shape.interiors]
    return [sample_evenly(np.asarray(ring.coords)[:-1], 0.8 * RADIUS_DOUBLED) for ring in rings]


def find(samples: list[Array]) -> list[Doubled]:
    return find_doubled(samples, _overlapping(tuple(samples), RADIUS_DOUBLED), RADIUS_DOUBLED)


def draw(rng: np.random.Generator, samples: list[Array], doubled: list[Doubled]) -> Arches:
    arcs = [arc_lengths(s) for s in samples]
    given = rng, arcs, np.full(len(samples), TOP_MM), RADIUS_DOUBLED, [None] * len(samples)
    return draw_arches(*given, doubled)


def changes_of_order(samples: list[Array], arches: Arches, near: LineString) -> int:
    """Count how often strands along a stroke change places in depth."""
    height = np.concatenate(arches.heights([arc_lengths(s) for s in samples]))
    points = np.concatenate(samples)
    one, other = _overlapping(tuple(samples), RADIUS_DOUBLED)
    along = np.array([near.project(Point(p)) for p in points])
    left = np.array([near.buffer(4.0, single_sided=True).covers(Point(p)) for p in points])
    beside = (np.abs(along[one] - along[other]) < RADIUS_DOUBLED) & (left[one] != left[other])
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
@pytest.mark.slow
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
    one, other = _overlapping(tuple(samples), RADIUS_DOUBLED)
    for _ in range(10):
        (height,) = draw(rng, samples, find(samples)).heights([arc])
        points = np.column_stack([samples[0], height])
        along = 0.5 * (points[one, 0] + points[other, 0])
        inside = (along > 50.0) & (along < 130.0)
        apart = np.linalg.norm(points[one] - points[other], axis=1)[inside]
        assert apart.min() > 2.1 * RADIUS_DOUBLED


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
    bar = STRAIGHT.buffer(0.5 * wide * RADIUS_DOUBLED, cap_style="flat")
    shape = MultiPolygon([union_all([Point(0, 0).buffer(40.0), bar])])
    curves = [sample_evenly(c, 0.8 * RADIUS_DOUBLED) for c in fill(shape, RADIUS_DOUBLED).curves]
    long = [d for d in find(curves) if d.ends[1] - d.ends[0] > 60.0]
    assert len(long) == strokes


@pytest.mark.parametrize("top_mm", [0.0, 2.0, 5.0, 20.0, TOP_MM])
@pytest.mark.parametrize("length", [30.0, 60.0, 150.0])
def test_a_stroke_alone_stands_on_three_feet_or_lies(length: float, top_mm: float) -> None:
    ribbon = LineString([(0, 0), (length, 0)]).buffer(0.5 * RADIUS_DOUBLED)
    samples = [sample_evenly(np.asarray(ribbon.exterior.coords)[:-1], 0.8 * RADIUS_DOUBLED)]
    rng, (arc,) = np.random.default_rng(2), [arc_lengths(s) for s in samples]
    for _ in range(10):
        given = rng, [arc], np.array([top_mm]), RADIUS_DOUBLED, [None]
        arches = draw_arches(*given, find(samples))
        (height,) = arches.heights([arc])
        feet = ((height < 0.2) & (np.roll(height, 1) >= 0.2)).sum()
        assert not height.any() or (feet >= 3 and height.max() <= top_mm)
