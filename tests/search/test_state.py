"""The weights of several views: who falls short gains, and who lacks nothing asks for nothing."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from oracles import assert_slope, state_at
from questions import ask_views, start_and_search
from shapely import MultiPolygon, Point, box
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of
from knotfab.limits.terms import Felt, State
from knotfab.problem import Problem, Start
from knotfab.search.flow import FlowSettings, Phase
from knotfab.search.objective import Weights
from knotfab.search.state import Balance, begin_search, goals_of
from knotfab.search.term import TorchTerm
from knotfab.search.upright import FLANK_DEG, Upright
from knotfab.start.filling import fill
from knotfab.start.views import start_between_views
from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS

RADIUS = 3.5
DRAFT = PRESETS["draft"].model_copy(
    update={"coarse_iterations": 20, "fine_iterations": 50, "settle_iterations": 0, "fine_px": 128}
)
DISC = MultiPolygon([Point(0, 0).buffer(30.0)])
LOW = MultiPolygon([box(-25, -18, 25, 18)])


def problem(goals: tuple[float, ...] | None = None) -> Problem:
    """A disc from the front and a lower box from the side: the disc's top and bottom spill there."""
    return ask_views([DISC, LOW], 0.0, 90.0, side_mm=90.0, goals=goals)


def test_a_goal_is_a_little_below_its_bound() -> None:
    bounds = (0.9, 0.75, 1.0)
    assert np.subtract(bounds, goals_of(bounds)) == pytest.approx([0.015] * 3)


def test_shares_become_equal_where_no_view_lacks_anything() -> None:
    balance = Balance((0.9, 0.8, 0.7))
    balance.update((0.95, 0.8, 0.99))
    assert balance.shares.tolist() == [1.0, 1.0, 1.0]
    balance.update((0.85, 0.9, 0.9))
    first = balance.shares.copy()
    assert first[0] > 1 > first[1] == first[2]
    balance.update((0.95, 0.95, 0.95))
    assert 1 < balance.shares[0] < first[0]
    for _ in range(100):
        balance.update((0.95, 0.95, 0.95))
    assert balance.shares == pytest.approx([1.0] * 3, abs=1e-3)


def test_shares_grow_by_the_shortfall_alone_and_keep_their_mean() -> None:
    balance = Balance((0.97, 0.97, 0.97))
    balance.update((0.95, 0.96, 0.999))  # short by 0.02, 0.01 and nothing: the mean is 0.01
    assert balance.shares.mean() == pytest.approx(1.0)
    ratios = np.log(balance.shares / balance.shares[1])
    assert ratios == pytest.approx([0.3, 0.0, -0.3])
    again = Balance((0.97, 0.97, 0.97))
    again.update((0.999, 0.95, 0.96))
    assert again.shares == pytest.approx(np.roll(balance.shares, 1))


def test_no_view_is_silenced_and_each_can_come_back() -> None:
    balance = Balance((0.9, 0.9))
    for _ in range(200):
        balance.update((0.5, 0.9))
    assert balance.shares.min() > 0.05 and balance.shares[0] > balance.shares[1]
    for _ in range(3):
        balance.update((0.9, 0.5))
    assert balance.shares[0] < balance.shares[1]


def test_the_objective_weighs_each_image_by_its_share() -> None:
    asked = problem()
    (curve,) = fill(DISC, RADIUS, 1).curves
    points = np.column_stack([curve, 4.0 * np.cos(np.arange(len(curve)))])
    plain = DRAFT.model_copy(update={"grace": 0.0})
    state = begin_search(asked, Start((points,), "nearly flat"), RADIUS, plain)
    none = Weights(image=0.5, clearance=0.0, bend=0.0, region=0.0, length=0.0)
    phase = Phase(96, FlowSettings(), none, (2.0, 2.0))
    near = find_neighbours(points, state.rings, 12.0, 6)

    objective = state.objective(phase)
    terms = [objective.image_term(n, points, objective.tau_px(n, 0.0))[0] for n in (0, 1)]
    assert objective(points, near, 0.0)[0] == pytest.approx(0.5 * sum(terms), rel=1e-5)
    front, side = objective.ious(points)
    assert front > side  # nearly flat: the side sees a thin line

    state.balance = Balance((front, side + 0.02))
    update = state.between(objective, phase)
    update(points, near, 0, 0.0)
    shares = objective.shares.copy()
    assert np.log(shares[1] / shares[0]) == pytest.approx(0.6)
    found = objective(points, near, 0.0)[0]
    assert found == pytest.approx(0.5 * float(np.dot(shares, terms)), rel=1e-5)
    for iteration in range(1, 20):  # not at every step: looking costs a rendering a view
        update(points, near, iteration, 0.0)
    assert objective.shares.tolist() == shares.tolist()
    update(points, near, 20, 0.0)
    assert objective.shares[1] > shares[1]
    # a picture that is too soft to say what a view falls short of is not asked
    soft = state.objective(replace(phase, balanced=False))
    state.between(soft, replace(phase, balanced=False))(points, near, 0, 0.0)
    assert soft.shares.tolist() == [1.0, 1.0]


@pytest.mark.slow
def test_the_view_that_falls_short_is_given_more() -> None:
    """Two pictures that cannot both be drawn: each is drawn better when its goal asks for it."""
    start = start_between_views(problem(), RADIUS, DRAFT)
    found = [
        start_and_search(problem(goals_of(bounds)), RADIUS, DRAFT, start, repairs=0)
        for bounds in ((1.0, 0.5), (0.5, 1.0))
    ]
    (front_first, side_last), (front_last, side_first) = (f.ious for f in found)
    assert front_first > front_last + 0.02
    assert side_first > side_last + 0.02
    assert all(f.log.certified for f in found)


# A term written in torch: its gradient, what it refuses, and that a search heeds it.


RNG = np.random.default_rng(5)
POINTS = RNG.normal(0.0, 20.0, (24, 3))
RINGS = polylines_of((POINTS[:10], POINTS[10:]))


def state_of(points: np.ndarray) -> State:
    return State.at(points, RINGS, find_neighbours(points, RINGS, 8.0, 4))


def bent(points: Tensor) -> Tensor:
    return (points[:, 0] * points[:, 1].sin()).mean() + points.pow(2).sum(1).sqrt().max()


def test_the_gradient_is_the_functions_own() -> None:
    term, step = TorchTerm(bent), 1e-6
    value, slope = term(state_of(POINTS), Weights())
    assert value == float(bent(torch.tensor(POINTS))) and slope.shape == POINTS.shape
    way = RNG.normal(size=POINTS.shape)
    ahead, behind = (term(state_of(POINTS + sign * step * way), Weights())[0] for sign in (1, -1))
    assert (ahead - behind) / (2 * step) == pytest.approx(float((slope * way).sum()), rel=1e-6)


def test_what_does_not_depend_on_the_vertices_pulls_on_none() -> None:
    value, slope = TorchTerm(lambda points: torch.tensor(3.0))(state_of(POINTS), Weights())
    assert value == 3.0 and not slope.any() and slope.shape == POINTS.shape


@pytest.mark.parametrize(
    "function",
    [
        lambda points: points,
        lambda points: points.sum() / 0.0,
        lambda points: 1.0,
        lambda points: points.sum().long(),
        lambda points: None,
    ],
    ids=["no scalar", "infinite", "no tensor", "whole numbers", "nothing"],
)
def test_what_is_no_finite_scalar_is_refused(function: Callable[[Tensor], Tensor]) -> None:
    with pytest.raises(InputError, match=r"the term .lambda.*no finite scalar"):
        TorchTerm(function)(state_of(POINTS), Weights())


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (lambda points: (0.0 * points).norm(dim=1).sqrt().sum(), "slope is not finite"),
        (lambda points: points[1000, 0], "it fails"),
    ],
)
def test_a_slope_that_is_not_finite_is_told(function: Callable[[Tensor], Tensor], why: str) -> None:
    with pytest.raises(InputError, match=f"the term low: .*{why}"):
        TorchTerm(function, name="low")(state_of(POINTS), Weights())


@pytest.mark.slow
def test_a_search_heeds_it() -> None:
    """The middle of the vertices comes nearer to x = 0, and every step is certified as ever."""
    few = {"coarse_iterations": 20, "fine_iterations": 20, "settle_iterations": 10, "grace": 0.0}
    settings = PRESETS["sketch"].model_copy(update=few)
    problem = ask_views([MultiPolygon([Point(6, 0).buffer(40.0)])], 0.0)

    def aside(points: Tensor) -> Tensor:
        return 50.0 * points[:, 0].mean() ** 2

    middles = []
    for terms in ((), (TorchTerm(aside),)):
        found = start_and_search(problem, 4.0, settings, repairs=0, terms=terms)
        assert found.log.certified
        middles.append(abs(np.concatenate([k.points for k in found.knots.knots])[:, 0].mean()))
    assert middles[1] < 0.8 * middles[0]


# The pull to stand: its slope is that of finite differences along the vertical, and nothing
# across.


UP = np.array([0.0, 0.6, 0.8])
SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])


def stand(heights: Array, size: float = 20.0) -> Array:
    """A circle in the plane across `UP`, with its vertices at these heights."""
    t = 2 * np.pi * np.arange(len(heights)) / len(heights)
    around = np.stack([np.cos(t), np.sin(t)], axis=1)
    return np.asarray(size * around @ SIDE + heights[:, None] * UP)


def felt(points: Array) -> Felt:
    return Upright(1.5, UP, 1.0, 15.0)(state_at(points, 1.0), Weights())


def zigzag(angle_deg: float, count: int = 120) -> Array:
    """Six arches of this angle about the circle of `stand`, their valleys on the floor."""
    run = 2 * 20.0 * np.sin(np.pi / count) * np.tan(np.radians(angle_deg))
    k = np.arange(count) % 20
    return np.asarray(1.0 + run * np.minimum(k, 20 - k))


def test_slope_along_the_vertical_is_that_of_its_number_and_none_is_across() -> None:
    heights = 6.0 + 7.0 * np.random.default_rng(0).normal(size=40)

    def call(h: Array) -> Felt:
        total, slope = felt(stand(h.ravel()))
        assert np.abs(slope @ SIDE.T).max() < 1e-12
        return total, (slope @ UP)[:, None]

    assert_slope(call, heights[:, None])


@pytest.mark.parametrize(
    ("heights", "lies_well"),
    [
        (np.full(120, 1.0), True),  # a ring on the floor
        (zigzag(FLANK_DEG + 0.5)[:120].clip(max=12.0), False),  # level tops
        (zigzag(FLANK_DEG - 6), False),
        (1.0 + zigzag(FLANK_DEG + 0.5), False),  # valleys above the floor
        (zigzag(FLANK_DEG + 0.5) * 2.0, False),  # above the top
        (zigzag(FLANK_DEG + 0.5), True),
    ],
)
def test_only_what_stands_in_steep_arches_or_lies_on_the_floor_feels_nothing(
    heights: Array, lies_well: bool
) -> None:
    points = stand(heights)
    points = points - (points @ UP - heights)[:, None] * UP
    assert (felt(points)[0] < 1e-9) == lies_well
