"""The weights of several views: who falls short gains, and who lacks nothing asks for nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from questions import ask_views, start_and_search
from shapely import MultiPolygon, Point, box

from knotfab.geometry.measures import find_neighbours
from knotfab.problem import Problem, Start
from knotfab.search.flow import FlowSettings, Phase
from knotfab.search.objective import Weights
from knotfab.search.state import Balance, begin, goals_of
from knotfab.start.filling import fill
from knotfab.start.views import start_between_views
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
    state = begin(asked, Start((points,), "nearly flat"), RADIUS, plain)
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
