"""The objective: one code for any number of views, summed as it says, and the same at every call."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from oracles import assert_slope, state_at
from questions import ask_views
from shapely import MultiPolygon, Point, box

from knotfab.base.arrays import Array
from knotfab.geometry.measures import Neighbours, find_neighbours, measure_curvature
from knotfab.limits.terms import Felt, State
from knotfab.problem import Problem, Start
from knotfab.search.flow import FlowSettings, Phase
from knotfab.search.objective import (
    SHARPEST,
    TENSION_ARCHED,
    TENSION_LYING,
    Grace,
    Objective,
    Spill,
    Weights,
    add_limits,
)
from knotfab.search.state import begin_search
from knotfab_formats.search import PRESETS

RADIUS, TAU = 4.0, 2.0
DRAFT = PRESETS["draft"].model_copy(update={"grace": 0.0})  # the sum here has no grace
DISC = MultiPolygon([Point(0, 0).buffer(40.0)])
SQUARE = MultiPolygon([box(-30, -40, 30, 40)])
IMAGE_ALONE = Weights(clearance=0.0, bend=0.0, region=0.0, length=0.0)


@pytest.fixture(scope="module")
def both() -> Problem:
    return ask_views([DISC, SQUARE], 0.0, 90.0)


@pytest.fixture(scope="module")
def points() -> Array:
    """A long way round in three dimensions, with tight bends."""
    t = 2 * np.pi * np.arange(160) / 160
    around = 30.0 + 10.0 * np.cos(12 * t)
    return np.column_stack(
        [around * np.cos(2 * t), 35.0 * np.sin(t), around * np.sin(2 * t) + 3.0 * np.cos(t)]
    )


def near_of(points: Array) -> Neighbours:
    return find_neighbours(points, objective_of_one(points).rings, 16.0, 6)


def objective_of_one(points: Array) -> Objective:
    return objective_at(ask_views([DISC], 0.0), points)


def objective_at(
    problem: Problem, points: Array, weights: Weights | None = None, spill: bool = False
) -> Objective:
    """The objective of a coarse phase at one closed polyline."""
    state = begin_search(problem, Start((points,), "for its slope alone"), RADIUS, DRAFT)
    phase = Phase(96, FlowSettings(), weights or Weights(), (TAU, TAU), spill)
    return state.objective(phase)


def value_and_slope(objective: Objective, points: Array) -> tuple[float, Array]:
    return objective(points, near_of(points), 0.0)


def test_views_are_summed_and_limits_counted_once(both: Problem, points: Array) -> None:
    whole = value_and_slope(objective_at(both, points), points)
    pictures = [
        value_and_slope(objective_at(replace(both, views=(v,)), points, IMAGE_ALONE), points)
        for v in both.views
    ]
    limits = value_and_slope(objective_at(both, points, Weights(image=0.0)), points)
    assert min(limits[0], *(p[0] for p in pictures)) > 1.0  # each has a say
    parts = [*pictures, limits]
    assert whole[0] == pytest.approx(sum(p[0] for p in parts), rel=1e-6)
    assert whole[1] == pytest.approx(sum(p[1] for p in parts), abs=1e-5)
    # neither view is deaf: the first pulls across x, the second across z
    assert np.abs(pictures[0][1][:, 0]).max() > 1e-3 < np.abs(pictures[1][1][:, 2]).max()


def test_a_view_given_twice_counts_twice_and_its_limits_once(both: Problem, points: Array) -> None:
    one = replace(both, views=both.views[:1])
    twice = replace(both, views=2 * both.views[:1])
    loss = {
        n: value_and_slope(objective_at(p, points), points)[0] for n, p in ((1, one), (2, twice))
    }
    image = value_and_slope(objective_at(one, points, IMAGE_ALONE), points)[0]
    assert loss[2] - loss[1] == pytest.approx(image, rel=1e-6)


def test_the_limits_are_those_under_guard(both: Problem, points: Array) -> None:
    objective = objective_at(both, points, Weights(image=0.0))
    state = State.at(points, objective.rings, near_of(points))
    terms, _ = add_limits(state, objective.limits, objective.guards, objective.weights)
    assert value_and_slope(objective, points)[0] == pytest.approx(terms, rel=1e-12)


def test_what_stands_outside_adds_its_spill(both: Problem, points: Array) -> None:
    off = points + np.array([0.0, 30.0, 0.0])
    plain, pulled = (objective_at(both, off, spill=spill) for spill in (False, True))
    state = State.at(off, plain.rings, near_of(off))
    spill = sum(Spill.for_view(v, RADIUS)(state, Weights())[0] for v in both.views)
    assert spill > 10.0
    more = value_and_slope(pulled, off)[0] - value_and_slope(plain, off)[0]
    assert more == pytest.approx(spill, rel=1e-6)


@pytest.mark.parametrize(
    ("half_mm", "off_mm", "pulled"),
    [
        (40.0, 36.0, False),  # along the outline, a fifth of a tube outside
        (40.0, 44.0, True),  # a whole tube outside
        (1.5, 0.0, False),  # along the middle of a stroke thinner than the tube
        (1.5, 4.0, True),  # beside it
    ],
)
def test_what_stands_out_as_a_knob_is_pulled_in(
    half_mm: float, off_mm: float, pulled: bool
) -> None:
    (view,) = ask_views([MultiPolygon([box(-60, -half_mm, 60, half_mm)])], 0.0).views
    t = 2 * np.pi * np.arange(120) / 120
    strand = np.column_stack([40 * np.cos(t), np.full_like(t, off_mm), 20 * np.sin(t)])
    cost, slope = Spill.for_knobs(view, RADIUS)(state_at(strand), Weights())
    assert (cost > 10.0) == pulled and (cost < 1.0) != pulled
    assert not pulled or slope[:, 1].sum() > 0


def test_a_call_changes_nothing(both: Problem, points: Array) -> None:
    objective = objective_at(both, points, spill=True)
    objective.find_winners(points, 0.0)
    before = vars(objective) | {"won": deepcopy(objective.won)}
    shares = objective.shares.copy()
    first = value_and_slope(objective, points)
    away = value_and_slope(objective, points + 1.0)
    again = value_and_slope(objective, points)
    assert first[0] == again[0] != away[0]
    np.testing.assert_array_equal(first[1], again[1])
    after = vars(objective)
    assert after.keys() == before.keys()
    for name in set(after) - {"won"}:
        assert after[name] is before[name], name
    assert (objective.shares == shares).all()
    for seen, still in zip(before["won"], after["won"], strict=True):
        assert all((x == y).all() for x, y in zip(seen, still, strict=True))


def test_held_vertices_feel_nothing_and_others_the_same(both: Problem, points: Array) -> None:
    objective = objective_at(both, points)
    loose = np.arange(len(points)) < 40
    held = Objective(
        objective.images,
        objective.rings,
        objective.limits,
        objective.guards,
        objective.weights,
        objective.tau,
        loose=loose,
    )
    free, alone = value_and_slope(objective, points), value_and_slope(held, points)
    assert alone[0] == pytest.approx(free[0], rel=1e-12)
    assert np.abs(alone[1][~loose]).max() == 0.0
    assert alone[1][loose] == pytest.approx(free[1][loose], abs=1e-9)


def test_a_view_sees_along_its_axes(both: Problem) -> None:
    for target, towards in zip(both.views, ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]), strict=True):
        axes = target.axes
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert axes[2] == pytest.approx(towards, abs=1e-12)
        assert axes[1] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
        # a point moved along them moves so in the picture: to the right, and up against v
        image = target.image_at(RADIUS, 96)
        moved = np.vstack([np.zeros(3), axes[:2]])
        middle, right, up = image.frame.pixels(image.frame.local(moved)).tolist()
        assert right[0] - middle[0] == pytest.approx(middle[1] - up[1], rel=1e-4)
        assert right[0] > middle[0] and abs(right[1] - middle[1]) < 1e-4


@pytest.mark.parametrize(("radius", "capped"), [(RADIUS, False), (0.3, True)])
def test_the_picture_gets_sharper_as_far_as_its_pixels_show_it(
    points: Array, radius: float, capped: bool
) -> None:
    """A thin tube's outline would lie between the pixels' middles, which then pull on nothing."""
    state = begin_search(
        ask_views([DISC], 0.0), Start((points,), "for its tau alone"), radius, DRAFT
    )
    objective = state.objective(Phase(96, FlowSettings(), Weights(), (1.5, 15.0)))
    taus = [objective.tau_px(0, progress) for progress in np.linspace(0.0, 1.0, 5)]
    wanted = [1.5 * 10.0**k / objective.images[0].radius_px for k in np.linspace(0.0, 1.0, 5)]
    assert taus == pytest.approx(np.minimum(wanted, SHARPEST))
    assert (taus[-1] == SHARPEST) is capped
    assert sorted(taus) == taus


def test_pictures_in_double_precision_tell_the_same_more_exactly(points: Array) -> None:
    problem, start = ask_views([DISC], 0.0), Start((points,), "for its slope alone")
    found = {}
    for precision in ("single", "double"):
        settings = DRAFT.model_copy(update={"precision": precision})
        phase = Phase(96, FlowSettings(), IMAGE_ALONE, (TAU, TAU))
        objective = begin_search(problem, start, RADIUS, settings).objective(phase)
        found[precision] = value_and_slope(objective, points)
        # along the slope it changes as the slope says
        total, slope = found[precision]
        step = 1e-4 * slope / np.linalg.norm(slope)
        rise = objective(points + step, near_of(points), 0.0)[0] - total
        if precision == "double":
            assert rise == pytest.approx(float((slope * step).sum()), rel=1e-3)
    (one, slope), (exact, exact_slope) = found["single"], found["double"]
    assert one == pytest.approx(exact, rel=1e-4) and one != exact
    assert slope == pytest.approx(exact_slope, abs=1e-3 * np.abs(exact_slope).max())


# Bending and tension: exact on circles, free of scale, and their slope that of finite
# differences.


def felt(points: Array, radius: float, weight: float = 1.0, tension: float = TENSION_LYING) -> Felt:
    return Grace(radius, weight, tension)(state_at(points, 1.0), Weights())


def energy(
    points: Array, radius: float, weight: float = 1.0, tension: float = TENSION_LYING
) -> float:
    return felt(points, radius, weight, tension)[0]


def circle(radius: float, count: int = 400) -> Array:
    t = 2 * np.pi * np.arange(count) / count
    flat = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    return np.asarray(radius * flat)


@pytest.mark.parametrize("size", [2.0, 7.0, 50.0])
def test_grace_of_a_circle_is_its_turn_and_half_its_length(size: float) -> None:
    bending, stretched = 1.5 * 2 * np.pi / size, 2 * np.pi * size / 1.5
    assert energy(circle(size), 1.5) == pytest.approx(bending + 0.5 * stretched, rel=1e-4)


@pytest.mark.parametrize("tension", [TENSION_LYING, TENSION_ARCHED])
def test_a_free_circle_is_as_large_as_both_parts_ask(tension: float) -> None:
    # Euler's elastica: of r / R and the tension times R / r the sum is least at R = r / sqrt(tension)
    sizes = np.linspace(1.0, 4.0, 61)
    found = [energy(circle(size), 1.5, tension=tension) for size in sizes]
    assert sizes[np.argmin(found)] == pytest.approx(1.5 / np.sqrt(tension), abs=0.05)


def test_it_is_free_of_scale_and_in_proportion_to_its_weight() -> None:
    wavy = circle(20.0)
    wavy = wavy + 2.0 * np.sin(9 * np.arctan2(wavy[:, 1], wavy[:, 0]))[:, None] * wavy / 20.0
    once = energy(wavy, 2.0)
    assert energy(3.0 * wavy, 6.0) == pytest.approx(once, rel=1e-12)
    less = energy(wavy, 2.0, weight=0.02)
    assert less == pytest.approx(0.02 * once, rel=1e-12)
    assert once > 1.2 * energy(circle(20.0), 2.0)


def test_its_slope_is_that_of_finite_differences() -> None:
    points = circle(10.0, 40) + 0.4 * np.sin(np.arange(120.0)).reshape(40, 3)
    assert_slope(lambda p: felt(p, 1.0, tension=TENSION_ARCHED), points)


def test_an_edge_without_length_has_a_slope_that_is_finite() -> None:
    points = circle(10.0, 40)
    points[7] = points[6]
    total, slope = felt(points, 1.0)
    assert np.isfinite(total) and np.isfinite(slope).all()


def test_curvature_and_turns_of_a_circle_walked_twice() -> None:
    t = 4 * np.pi * np.arange(500) / 500
    twice = np.stack([5 * np.cos(t), 5 * np.sin(t), 0.1 * np.sin(t / 2)], axis=1)
    found = measure_curvature(twice, 2.0)
    assert found.turns == pytest.approx(2.0, rel=1e-3)
    assert found.mean == pytest.approx(0.4, rel=1e-3)
    assert found.quantile_90 == pytest.approx(0.4, rel=1e-2)
