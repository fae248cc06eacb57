"""The depth profile: it keeps the picture, and descent finds what is less legible and easier to print."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from questions import ask_heart
from scipy.ndimage import gaussian_filter1d
from scipy.stats import spearmanr

from benchmarks.read_aside import WORDS, measure_views, tell_apart
from knotfab.base.arrays import Array
from knotfab.effects.base import Decision
from knotfab.effects.penumbra import PENUMBRA, Sharpening
from knotfab.geometry.overhang import Rules, estimate, strands_along
from knotfab.geometry.polylines import arc_lengths, pair_nearby, sample_evenly
from knotfab.part.orient import AXES
from knotfab.picture.silhouette import mask_iou
from knotfab.problem import DepthChoice, Problem, Start
from knotfab.scene.camera import camera_of
from knotfab.start.arches import draw_arches, fold_of
from knotfab.start.depth import _Judge, choose_depth
from knotfab.start.filling import Template, fill
from knotfab.start.lanes import part_sides
from knotfab.start.legibility import (
    _fit,
    _overlap,
    _see,
    about_middle,
    legibility,
    legibility_from,
    onlooker_for,
    stretch_mask,
    turns_aside,
)
from knotfab.start.lift import lift_template
from knotfab.start.profiles import draw_profile, draw_relief, lift, sum_waves
from knotfab_formats.search import PRESETS
from knotfab_formats.views import Switch

FEW = PRESETS["draft"].model_copy(update={"depth_candidates": 16})


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


@pytest.fixture(scope="module")
def template(problem: Problem) -> Template:
    return fill(problem.polygons[0], 3.0)


def _choose(
    problem: Problem, template: Template, candidates: int, overhang_deg: float | None = None
) -> DepthChoice:
    view = problem.views[0]
    light = view.view.light_distance_mm
    target = stretch_mask(view.mask)
    return choose_depth(template.curves, 3.0, light, 90.0, target, candidates, 0, overhang_deg)


@pytest.mark.slow
def test_depth_keeps_the_picture_and_lowers_legibility(
    problem: Problem, template: Template
) -> None:
    target = stretch_mask(problem.views[0].mask)
    light = problem.views[0].view.light_distance_mm
    choice = _choose(problem, template, 12)
    joined = np.concatenate(choice.depths)
    assert np.ptp(joined) == pytest.approx(90.0)
    lifted = np.concatenate(
        [lift(c, d, light) for c, d in zip(template.curves, choice.depths, strict=True)]
    )
    flat = np.concatenate([lift(c, 0 * c[:, 0], light) for c in template.curves])
    # seen from the light nothing moved
    seen = lifted[:, :2] / (1 - lifted[:, 2:] / light)
    np.testing.assert_allclose(seen, flat[:, :2], atol=1e-9)
    spread = legibility(lifted, 3.0, light, target, 45.0)
    assert spread < legibility(flat, 3.0, light, target, 45.0) - 0.08
    assert legibility(flat, 3.0, light, target, 0.0) > 0.9


@pytest.mark.slow
def test_more_depth_candidates_are_less_legible(problem: Problem, template: Template) -> None:
    few, many = (_choose(problem, template, count) for count in (8, 64))
    assert many.legibility < few.legibility
    for one, other in zip(many.depths, _choose(problem, template, 64).depths, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_where_supports_count_the_piece_needs_fewer(problem: Problem, template: Template) -> None:
    light = problem.views[0].view.light_distance_mm

    def supports(choice: DepthChoice) -> float:
        parts = [lift(c, d, light) for c, d in zip(template.curves, choice.depths, strict=True)]
        rods = strands_along(parts, 3.0)
        return min(estimate(rods, turn, Rules()).support_cm3 for turn in AXES)

    assert supports(_choose(problem, template, 80, 45.0)) < supports(_choose(problem, template, 80))


def test_legibility_is_the_largest_iou_seen_from_four_sides() -> None:
    rng = np.random.default_rng(8)
    points, target = rng.uniform(-40, 40, (60, 3)), rng.random((128, 128)) < 0.4
    centred = about_middle(points)
    seen = [_see(centred, 5.0, 300.0, turn, 128) for turn in turns_aside(30.0)]
    found = legibility(points, 5.0, 300.0, target, 30.0)
    assert found == pytest.approx(max(mask_iou(one, target) for one in seen))
    with pytest.raises(ValueError, match="128 x 128"):
        legibility_from(centred, 5.0, 300.0, target[:, ::2], turns_aside(30.0)[0])


@pytest.mark.parametrize("shear", [-0.15, 0.0, 0.2])
@pytest.mark.parametrize("across", [0.8, 1.2])
def test_a_picture_fits_what_an_affine_map_makes_of_it(shear: float, across: float) -> None:
    v, u = (np.indices((16, 16)) - 7.5).astype(float)

    def draw(u: Array, v: Array) -> Array:
        ring = np.abs(np.hypot(u, v) - 4.0) < 1.2
        return (ring | ((np.abs(u - 2.0) < 1.2) & (np.abs(v) < 5.0))).astype(float)

    fine = [
        np.kron(axis, np.ones((4, 4))) + np.tile((np.indices((4, 4))[k] - 1.5) / 4, (16, 16))
        for k, axis in ((1, u), (0, v))
    ]
    picture = draw(*fine).reshape(16, 4, 16, 4).mean((1, 3))
    seen = draw(fine[0] / across + shear * fine[1], fine[1]).reshape(16, 4, 16, 4).mean((1, 3))
    assert _fit(picture, seen) > max(0.8, _overlap(picture, seen, np.eye(3)[:2].ravel()))
    assert _fit(picture, picture) == 1.0
    assert _fit(picture, seen[::-1, ::-1].copy()) < _fit(picture, seen)


def test_an_onlooker_reads_a_flat_piece_and_not_a_ball(
    problem: Problem, template: Template
) -> None:
    light, (straight, *_) = problem.views[0].view.light_distance_mm, turns_aside(0.0)
    onlooker = onlooker_for(stretch_mask(problem.views[0].mask))
    flat = about_middle(np.concatenate([lift(c, 0 * c[:, 0], light) for c in template.curves]))
    ball = np.random.default_rng(2).normal(size=(300, 3))
    ball *= 40.0 / np.linalg.norm(ball, axis=1)[:, None]
    assert onlooker.read(flat, 3.0, light, straight) > 3.0
    assert onlooker.read(ball, 3.0, light, straight) < 1.5


@pytest.mark.study
def test_onlookers_say_what_a_person_said_of_forty_views() -> None:
    told, onlooker = measure_views().values()
    assert min(tell_apart(measure, WORDS == 2) for measure in (told, onlooker)) > 0.8
    assert spearmanr(onlooker, told)[0] > 0.8


def test_what_a_profile_costs_is_the_same_whatever_it_may_cost(
    problem: Problem, template: Template
) -> None:
    one = problem.views[0]
    light, target = one.view.light_distance_mm, stretch_mask(one.mask)
    judge = _Judge(template.curves, 3.0, light, 90.0, target, 45.0)
    rng = np.random.default_rng(4)
    for number in range(6):
        parts = judge.place(judge.draw(rng, number, 180.0))
        whole = judge.legibility(parts) + judge.supports(parts).min()
        for at_most in (np.inf, 1.01 * whole):
            assert judge.cost(parts, at_most) == pytest.approx(whole)
        for at_most in (0.0, 0.5 * whole, 0.9 * whole):
            assert judge.cost(parts, at_most) > at_most
        assert judge.cost(parts, np.inf, supported=False) == judge.legibility(parts)


def test_what_draws_the_outline_is_told_by_the_distance_to_it(
    problem: Problem, template: Template
) -> None:
    seen = _lit_by(problem, 20.0).views[0]
    wide = Sharpening(Decision(PENUMBRA, 1e3, 1.0), seen.view, seen.polygon, 3.0)
    (drawing,) = wide.drawing(template.curves[:1])
    curve = template.curves[0]
    away = shapely.distance(seen.polygon.boundary, shapely.points(curve))
    share = np.clip((6.0 - away) / 2.1, 0.0, 1.0)
    step = np.linalg.norm(np.diff(curve, axis=0), axis=1).mean()
    exact = gaussian_filter1d(share, 12.0 / step, mode="wrap")
    np.testing.assert_allclose(drawing, exact, atol=1e-3)


def test_the_picture_hides_what_casts_its_shadow_inside_at_any_depth(problem: Problem) -> None:
    rng, (one,) = np.random.default_rng(5), problem.views
    low, high = np.array(one.polygon.bounds).reshape(2, 2)
    flat = rng.uniform(low - 5.0, high + 5.0, (400, 2))
    # to half a pixel, whatever its outline's corners
    sure = shapely.distance(one.polygon.boundary, shapely.points(flat)) > one.view.pixel_mm
    inside = shapely.contains(one.polygon, shapely.points(flat))
    light = one.view.light_distance_mm
    lifted = lift(flat, rng.uniform(-40.0, 40.0, len(flat)), light)
    found = [one.hides(point[None]) for point in lifted[sure]]
    assert 50 < sum(found) < len(found) - 50 and (np.array(found) == inside[sure]).all()
    assert not one.hides(lifted[sure]) and one.hides(lifted[sure & inside])


def _lit_by(problem: Problem, diameter_mm: float, word: Switch = None) -> Problem:
    one = problem.views[0]
    view = one.view.model_copy(update={"light_diameter_mm": diameter_mm})
    return replace(problem, views=(replace(one, view=view),), switches={"penumbra": word})


def _lift_by(
    problem: Problem, template: Template, diameter_mm: float, word: Switch = None
) -> Start:
    return lift_template(_lit_by(problem, diameter_mm, word), template, 3.0, FEW)


@pytest.mark.slow
@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 40.0), (-75.0, -90.0)])
def test_a_piece_stands_before_its_light_wherever_that_is(
    problem: Problem, template: Template, azimuth: float, elevation: float
) -> None:
    one = problem.views[0]
    turned = one.view.model_copy(update={"azimuth_deg": azimuth, "elevation_deg": elevation})
    seen = []
    for view in (one.view, turned):
        lit = replace(problem, views=(replace(one, view=view),))
        start = lift_template(lit, template, 3.0, FEW)
        seen.append(camera_of(view, 200, 200).project(np.concatenate(start.curves)))
    assert seen[1] == pytest.approx(seen[0], abs=1e-6)


def _depths(start: Start) -> list[np.ndarray]:
    assert start.depth is not None
    return list(start.depth.depths)


def test_under_a_wide_lamp_the_outline_stands_near_the_wall(
    problem: Problem, template: Template
) -> None:
    seen = _lit_by(problem, 20.0).views[0]
    wide = Sharpening(Decision(PENUMBRA, 1e3, 1.0), seen.view, seen.polygon, 3.0)
    assert wide.strength(16.0) == 1.0 and wide.strength(2000.0) == pytest.approx(999 / 2000)
    drawing = wide.drawing(template.curves)
    shares = np.concatenate(drawing)
    assert shares.min() < 0.05 and shares.max() > 0.95
    light = seen.view.light_distance_mm
    cost = {}
    for diameter in (0.0, 20.0):
        start = _lift_by(problem, template, diameter)
        assert np.ptp(np.concatenate(_depths(start))) == pytest.approx(problem.depth_mm)
        parts = [lift(c, d, light) for c, d in zip(template.curves, _depths(start), strict=True)]
        cost[diameter] = wide.cost(parts, drawing)
        heights = np.concatenate(_depths(start))
        low = heights[shares > 0.9].mean() - heights[shares < 0.1].mean()
        assert diameter == 0.0 or low < -5.0
    assert cost[20.0] < 0.85 * cost[0.0]


@pytest.mark.slow
def test_a_lamp_that_is_not_called_for_runs_no_code(
    problem: Problem, template: Template, monkeypatch: pytest.MonkeyPatch
) -> None:
    wide = _lift_by(problem, template, 20.0).effects["penumbra"]
    assert wide.where == ["depth"] and wide.calls >= FEW.depth_candidates

    def explode(*_: object) -> None:
        raise AssertionError("the lamp was simulated")

    for name in ("drawing", "lower", "cost"):
        monkeypatch.setattr(Sharpening, name, explode)
    for diameter, word in ((0.0, None), (0.0, True), (20.0, False)):
        off = _lift_by(problem, template, diameter, word).effects["penumbra"]
        assert off.calls == 0 and off.where == [] and off.seconds == 0.0
    with pytest.raises(AssertionError, match="simulated"):
        _lift_by(problem, template, 20.0)


@pytest.mark.slow
def test_what_a_lamp_does_to_depth_grows_from_nothing(problem: Problem, template: Template) -> None:
    point = _lift_by(problem, template, 0.0)
    first = _lift_by(problem, template, 1.0).effects["penumbra"]
    at = first.threshold / first.magnitude  # mm, the diameter at which the threshold is met
    below, above = (_lift_by(problem, template, share * at) for share in (0.99, 1.01))
    assert below.effects["penumbra"].calls == 0 < above.effects["penumbra"].calls
    for start, most in ((below, 0.0), (above, 0.05)):
        moved = [np.abs(a - b).max() for a, b in zip(_depths(start), _depths(point), strict=True)]
        assert max(moved) <= most  # mm


@pytest.mark.parametrize("turn", turns_aside(45.0), ids=str)
def test_the_silhouette_is_the_union_of_discs_on_its_box(turn: Array) -> None:
    rng = np.random.default_rng(3)
    points, radius, light, grid = rng.uniform(-40, 40, (30, 3)) * [1.0, 0.6, 0.8], 6.0, 300.0, 48
    at = points @ turn.T
    flat = at[:, :2] * (light / (light - at[:, 2:]))
    low, high = flat.min(0) - radius, flat.max(0) + radius
    middle = low + (np.arange(grid)[:, None] + 0.5) / grid * (high - low)
    x, y = np.meshgrid(middle[:, 0], middle[::-1, 1])
    away = np.hypot(x[..., None] - flat[:, 0], y[..., None] - flat[:, 1]).min(-1)
    np.testing.assert_array_equal(_see(points, radius, light, turn, grid), away <= radius)


# Strands that hide each other keep their order, and are apart, without being moved out of the
# shadow.


SEPARATION, LIGHT = 4.0, 500.0


@pytest.mark.parametrize("begin", [0.0, 0.1, 0.25, 0.4])
def test_sides_that_change_places_part_in_the_longer_order(begin: float) -> None:
    # a stroke there and back, its sides a millimetre apart, whose depths cross near one end
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    curve = sample_evenly(np.column_stack([60 * np.cos(turn), 0.5 * np.sin(turn)]), 1.5)
    curve = np.roll(curve, -round(begin * len(curve)), axis=0)  # wherever the curve begins
    # and one that lies by itself
    other = curve + np.array([0.0, 100.0])
    share = (arc_lengths(curve)[:-1] / arc_lengths(curve)[-1] + begin) % 1.0
    depth = 10 * np.sin(4 * np.pi * share) + 3 * np.sin(2 * np.pi * share)
    depths = np.concatenate([depth, np.zeros(len(other))])
    pairs, along = pair_nearby((curve, other), 3.5)
    one, two = pairs[(along > 12.0) & (pairs < len(curve)).all(axis=1)].T
    before = depths[one] - depths[two]
    assert before.min() < 0 < before.max()
    moves = part_sides((curve, other), depths, (one, two), SEPARATION, LIGHT)
    after = before + moves[one] - moves[two]
    # pairs are numbered from either side of the stroke: the sign is that of the way round
    upper = np.where(curve[one, 1] >= curve[two, 1], after, -after)
    apart = np.hypot(after, np.linalg.norm(curve[one] - curve[two], axis=1))
    assert (upper > 0).all() or (upper < 0).all()
    assert apart.min() > 0.9 * SEPARATION
    assert (moves[len(curve) :] == 0).all()


def test_nothing_is_moved_where_nothing_hides_another() -> None:
    turn = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    circle = 30 * np.column_stack([np.cos(turn), np.sin(turn)])
    none = np.empty(0, dtype=np.int64)
    assert not part_sides((circle,), np.zeros(100), (none, none), SEPARATION, LIGHT).any()


# Random depth profiles: their waves are summed as written, and a variation keeps their spread.


@pytest.mark.parametrize(("points", "waves"), [(1, 1), (255, 3), (256, 40), (700, 7)])
def test_waves_are_summed_as_written(points: int, waves: int) -> None:
    rng = np.random.default_rng(points)
    angles = rng.uniform(0, 2 * np.pi, points)
    cosines, sines = rng.normal(size=(2, waves))
    of_each = angles[:, None] * np.arange(1, waves + 1)
    whole = (cosines * np.cos(of_each) - sines * np.sin(of_each)).sum(1)
    np.testing.assert_allclose(sum_waves(angles, cosines, sines), whole, atol=1e-11)


def test_a_profile_closes_and_spends_its_length_evenly_in_depth() -> None:
    rng = np.random.default_rng(3)
    arcs = [np.linspace(0, 900, 1801)]
    heights = np.concatenate([draw_profile(rng, n, 60.0, arcs).heights(arcs)[0] for n in range(40)])
    assert np.abs(heights).max() <= 2.0
    shares = np.histogram(heights, bins=4, range=(-2, 2))[0] / len(heights)
    assert shares == pytest.approx(0.25, abs=0.05)
    one = draw_profile(rng, 0, 60.0, arcs).heights(arcs)[0]
    assert abs(one[0] - one[-1]) < 2 * np.abs(np.diff(one)).max()


@pytest.mark.parametrize("change", [0.0, 0.1, 0.6])
def test_a_variation_is_as_near_as_it_is_asked_to_be(change: float) -> None:
    rng = np.random.default_rng(4)
    arcs, places = [np.linspace(0, 900, 901)], [rng.uniform(-90, 90, (900, 2))]
    profile, relief = draw_profile(rng, 1, 60.0, arcs), draw_relief(rng, 1, 60.0)
    for was, now in (
        (profile.heights(arcs)[0], profile.varied(rng, change).heights(arcs)[0]),
        (relief.heights(places)[0], relief.varied(rng, change).heights(places)[0]),
    ):
        moved = np.sqrt(((now - was) ** 2).mean())
        assert moved <= 3.0 * change * was.std()
        assert (moved > 0) == (change > 0)


@pytest.mark.parametrize(
    ("length", "top", "feet"),
    [(600.0, 80.0, (5, 8)), (200.0, 80.0, (3, 5)), (60.0, 80.0, (3, 5)), (9.0, 80.0, (0, 0))],
)
def test_arches_stand_on_feet_with_steep_flanks_and_no_peak_above_the_top(
    length: float, top: float, feet: tuple[int, int]
) -> None:
    rng, radius = np.random.default_rng(3), 1.5
    arcs = [np.linspace(0.0, length, 2001)]
    for number in range(20):
        arches = draw_arches(rng, arcs, np.array([top]), radius, [None])
        if number % 2:
            arches = arches.varied(rng, 0.5)
        (height,) = arches.heights(arcs)
        assert 0.0 <= height.min() < 0.01
        assert height.max() <= top
        low = (height < 0.05) & (np.roll(height, 1) >= 0.05)
        assert feet[0] <= low.sum() <= feet[1]
        steep = np.degrees(np.arctan(np.abs(np.diff(height)) / np.diff(arcs[0])[:-1]))
        assert steep.max(initial=0.0) < 56.0
        if feet[0] > 0:  # but for what is rounded
            flat = (steep < 44.0).mean() * length
            assert flat <= 2.0 * feet[1] * 2.2 * radius


@pytest.mark.parametrize("narrow_mm", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_a_narrow_loop_stands_on_its_edge_one_side_over_the_other(
    narrow_mm: float, turn: float
) -> None:
    """A dot's ring, 4 mm long: where its two sides hide each other they are a tube apart."""
    rng, radius, t = np.random.default_rng(1), 1.0, np.linspace(0.0, 2 * np.pi, 80, endpoint=False)
    sides = np.column_stack([2.0 * np.cos(t + 1.0), 0.5 * narrow_mm * np.sin(t + 1.0)])
    way = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    curve = sides @ way + 30.0
    arcs = [arc_lengths(curve)]
    for number in range(10):
        arches = draw_arches(rng, arcs, np.array([0.0]), radius, [fold_of(curve, radius)])
        (height,) = (arches.varied(rng, 0.5) if number % 2 else arches).heights(arcs)
        assert height.min() == pytest.approx(0.0, abs=0.01)
        middle = np.abs(sides[:, 0]) < 0.3
        above = height[middle & (height > height.mean())]
        assert above.min() - height[middle & (height < height.mean())].max() > 1.9 * radius
    assert fold_of(np.column_stack([2.0 * np.cos(t), 2.0 * np.sin(t)]), radius) is None


@pytest.mark.parametrize("first", [0.5, 0.3, 0.7])
def test_an_arch_is_split_in_two_and_all_others_stay(first: float) -> None:
    rng, arcs = np.random.default_rng(5), [np.linspace(0.0, 600.0, 3001)]
    arches = draw_arches(rng, arcs, np.array([80.0]), 1.5, [None])
    (before,) = arches.heights(arcs)
    peak = int(before.argmax())
    other = arches.split(0, np.array([arcs[0][peak] / 600.0]), first)
    (after,) = other.heights(arcs)
    changed = np.flatnonzero(np.abs(after - before) > 1e-6)
    assert 0 < np.ptp(changed) < 700 and changed.min() < peak < changed.max()
    higher = max(first, 1.0 - first)
    assert after[changed].max() == pytest.approx(higher * before[peak], rel=0.1)
    assert arches.split(0, np.array([0.5]), 0.01) is arches  # no arch so low stands
    nothing = draw_arches(rng, [np.linspace(0.0, 9.0, 50)], np.array([80.0]), 1.5, [None])
    assert nothing.split(0, np.array([0.5]), 0.5) is nothing
