"""The network's search: samples whose type is proved, honest refusals, and pictures that get better."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from knot_curves import mirror
from questions import ask_heart, start_and_search
from validator_parts import trefoil

from knotfab.base.errors import InputError, SceneError
from knotfab.geometry.carry import (
    Carried,
    Curves,
    carry,
    certify_same_type,
    refine_parameters,
    space_evenly,
)
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.problem import Problem, SearchResult
from knotfab.search import network_search
from knotfab.start.circle import start_at_circles
from knotfab.start.filling import Template
from knotfab_formats.search import PRESETS, SearchSettings, search_settings

RADIUS = 5.0
QUICK = PRESETS["draft"].model_copy(
    update={
        "coarse_px": 96,
        "fine_px": 128,
        "coarse_iterations": 25,
        "fine_iterations": 20,
        "depth_candidates": 60,
        "method": "inn",
        "network_depth": 6,
        "network_width": 32,
        "network_iterations": 60,
    }
)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


def _search(
    problem: Problem, settings: SearchSettings, repairs: int = 0
) -> tuple[SearchResult, list[float], list[float]]:
    """The result, and the shares done and the IoU that were reported on the way."""
    shares: list[float] = []
    seen: list[float] = []

    def report(share: float, iou: float | None) -> None:
        shares.append(share)
        seen.append(iou or 0.0)

    result = start_and_search(problem, RADIUS, settings, repairs=repairs, report=report)
    return result, shares, seen


@pytest.mark.slow
def test_circles_are_convex_and_in_planes_of_their_own(problem: Problem) -> None:
    curves = (np.array([[0.0, 0], [40, 0], [40, 90]]), np.array([[1.0, 0], [1, 9], [0, 0]]))
    template = Template(curves, problem.polygons[0], 2.0)
    start = start_at_circles(replace(problem, clearance=0.5), 2.0, QUICK, template)
    assert start.far and start.types == ("unknot", "unknot")
    found = start.curves
    for circle, middle, around in zip(found, ([20, 45], [0.5, 4.5]), (14.0, 8.0), strict=True):
        assert np.ptp(circle[:, 2]) == 0
        np.testing.assert_allclose(np.linalg.norm(circle[:, :2] - middle, axis=1), around)
    assert found[1][0, 2] - found[0][0, 2] == 9.0


def test_splines_pass_through_their_polygons_and_parameters_even_out() -> None:
    curves = Curves.through([trefoil(60, 1.0), 3 * trefoil(40, 1.0)])
    for at, polygon in zip(
        curves.at(curves.knots), (trefoil(60, 1.0), 3 * trefoil(40, 1.0)), strict=True
    ):
        np.testing.assert_allclose(at, polygon, atol=1e-12)
    where = space_evenly(curves.knots, curves.at(curves.knots), curves.periods, 0.2)
    edges = np.linalg.norm(np.diff(curves.at(where)[1], axis=0), axis=1)
    assert abs(edges / 0.2 - 1).max() < 0.05
    finer = refine_parameters(where, curves.periods)
    for coarse, fine, period in zip(where, finer, curves.periods, strict=True):
        assert len(fine) == 2 * len(coarse)
        assert (np.diff(fine) > 0).all()
        assert 0 <= fine[0] < fine[-1] < period
        assert np.isin(coarse, fine).all()


def test_a_polygon_and_its_refinement_agree_unless_the_polygon_is_too_coarse() -> None:
    curves = Curves.through([trefoil(400, 1.0)])

    def agrees(count: int) -> bool:
        where = (np.linspace(0, curves.periods[0], count, endpoint=False),)
        finer = refine_parameters(where, curves.periods)
        motion = curves.at(where), where, curves.at(finer), finer, curves.periods
        return certify_same_type(*motion).reached == 1

    assert agrees(60)
    assert not agrees(5)  # cannot be knotted: a trefoil takes six edges


def test_a_trefoil_and_its_mirror_do_not_agree() -> None:
    where, periods = (np.arange(90.0),), (90.0,)
    one, other = [trefoil(90, 1.0)], [mirror(trefoil(90, 1.0))]
    assert certify_same_type(one, where, one, where, periods).reached == 1
    stuck = certify_same_type(one, where, other, where, periods)
    assert 0.4 < stuck.reached < 0.5  # flat half way


@pytest.mark.parametrize("turn_deg", [60, 120, 150])
def test_a_sharp_corner_is_rounded_in_several_certified_steps(turn_deg: float) -> None:
    # by one step the ends of its shortest edges would go further than those are long
    run, turn = np.arange(6.0)[:, None], np.radians(turn_deg)
    before = -run[::-1] * [1, 0, 0]
    after = run[1:] * [np.cos(turn), np.sin(turn), 0]
    ends = after[-1], before[0]
    back = [ends[0] + [0, 2, 2], (ends[0] + ends[1]) / 2 + [0, 3, 4], ends[1] + [-2, 1, 2]]
    corner = np.concatenate([before, after, back])
    curves = Curves.through([corner])
    where = (np.linspace(0, curves.periods[0], 900, endpoint=False),)
    way = certify_same_type([corner], curves.knots, curves.at(where), where, curves.periods)
    assert way.reached == 1
    assert way.least_margin > 0
    assert way.steps > 1


def test_carrying_proves_a_motion_and_refuses_a_crossing() -> None:
    knot, rings = trefoil(120, 1.0), polylines_of_sizes((120,))

    def turn(points: np.ndarray, share: float) -> np.ndarray:
        c, s = np.cos(3 * share), np.sin(3 * share)
        return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1 + share]]) + 5 * share

    way = carry(knot, rings, turn, 0.3)
    assert way.reached == 1
    np.testing.assert_array_equal(way.points, turn(knot, 1.0))
    assert way.least_margin > 0
    assert way.steps >= 10  # no vertex goes further than 0.3 in one of them

    def untie(points: np.ndarray, share: float) -> np.ndarray:
        return points * [1, 1, 1 - 2 * share]

    stuck = carry(knot, rings, untie, 0.3)
    assert 0.45 < stuck.reached < 0.5  # flat half way
    np.testing.assert_array_equal(stuck.points, untie(knot, stuck.reached))


def test_a_polygon_too_coarse_for_the_map_is_refused_until_it_is_refined() -> None:
    # two rings side by side; the map waves both, and keeps every curve clear of every other
    def ring(vertices: int, y: float) -> np.ndarray:
        x = np.linspace(-8, 8, vertices)
        side = np.column_stack([x, np.full(vertices, y), 0 * x])
        return np.concatenate([side, side[::-1] + [0, np.sign(y) * 3, 0]])

    def wave(points: np.ndarray, share: float) -> np.ndarray:
        wave = share * np.sin(np.pi * points[:, 0])
        return points + np.stack([0 * wave, wave, 0 * wave], axis=1)

    fine = ring(161, 0.1)
    coarse = ring(9, -0.1)  # vertices where the map stands still
    both = polylines_of_sizes((len(fine), len(coarse)))
    assert carry(np.concatenate([fine, coarse]), both, wave, 0.5).reached < 0.5
    even = polylines_of_sizes((len(fine), len(fine)))
    assert carry(np.concatenate([fine, ring(161, -0.1)]), even, wave, 0.5).reached == 1


@pytest.mark.slow
def test_the_network_draws_better_and_its_polygons_are_proved(problem: Problem) -> None:
    longer = QUICK.model_copy(update={"network_iterations": 100})
    result, _, seen = _search(problem, longer)
    assert result.log.certified
    assert result.log.accepted > 3
    assert "invertible network" in result.log.template
    assert result.iou_estimate > max(0.95, seen[0])
    assert [k.type for k in result.knots.knots] == ["unknot"]


@pytest.mark.slow
def test_from_a_circle_the_picture_is_found_and_the_type_kept(problem: Problem) -> None:
    circle = QUICK.model_copy(update={"network_start": "circle"})
    result, _, seen = _search(problem, circle)
    assert result.log.certified
    assert "circle" in result.log.template
    assert result.depth is None
    assert result.iou_estimate > seen[0] + 0.1


@pytest.mark.slow
def test_network_then_flow_ends_feasible(problem: Problem) -> None:
    settings = QUICK.model_copy(update={"method": "inn+flow", "network_iterations": 30})
    result, fractions, _ = _search(problem, settings, repairs=4)
    assert result.feasible
    assert result.log.certified
    assert result.iou_estimate > 0.97
    assert fractions == sorted(fractions)
    assert fractions[-1] <= 1


@pytest.mark.slow
def test_the_same_seed_gives_the_same_knots(problem: Problem) -> None:
    short = QUICK.model_copy(update={"network_iterations": 5})
    one, two = (_search(problem, short)[0].knots.points for _ in range(2))
    assert (one == two).all()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.7, 0.0])
def test_what_cannot_be_carried_all_the_way_stays_where_it_is_certified(
    problem: Problem, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    tried: list[np.ndarray] = []

    def stuck(
        points: np.ndarray, _: object, path: Callable[..., np.ndarray], *__: object
    ) -> Carried:
        tried.append(path(points, share))
        return Carried(tried[-1], share, 12, 3, 0.1)

    monkeypatch.setattr(network_search, "carry", stuck)
    short = QUICK.model_copy(update={"network_iterations": 3})
    result = _search(problem, short)[0]
    assert result.log.certified
    counts = [len(points) for points in tried]
    assert [b / a for a, b in pairwise(counts)] == [2.0] * 5
    if share > 0:
        assert "70.0% of the way" in result.log.template
    else:  # nothing could be carried: the start, whose type is known
        assert "no step of it could be certified" in result.log.template
    # repairs would carry all that proved nothing
    assert sum(len(k.points) for k in result.knots.knots) <= 2 * counts[0]


@pytest.mark.parametrize(
    ("reached", "told"),
    [
        (1.0, "its samples"),
        (0.9996, "99.9% of the way"),
        (0.7, "70.0% of the way"),
        (0.0, "certified"),
    ],
)
def test_what_is_not_all_of_the_way_is_not_told_as_all(reached: float, told: str) -> None:
    way = Carried(np.zeros((3, 3)), reached, 12 if reached else 0, 3, 0.1)
    said = network_search._describe(way, 1)
    assert said.endswith(told) and ("in 12 steps" in said) == (reached > 0)


@pytest.mark.slow
def test_the_flow_runs_no_network(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object, **__: object) -> None:
        raise AssertionError("a network where none is asked for")

    monkeypatch.setattr(network_search, "CouplingNetwork", explode)
    flow = QUICK.model_copy(update={"method": "flow", "coarse_iterations": 2})
    flow = flow.model_copy(update={"fine_iterations": 0, "settle_iterations": 0})
    _search(problem, flow)
    with pytest.raises(AssertionError, match="none is asked for"):
        _search(problem, QUICK)


@pytest.mark.slow
def test_a_circle_cannot_be_a_trefoil(problem: Problem) -> None:
    settings = QUICK.model_copy(update={"network_start": "circle"})
    tied = replace(problem, knot="trefoil")
    with pytest.raises(SceneError, match="a trefoil is asked for"):
        _search(tied, settings)


def test_settings_of_the_network() -> None:
    assert SearchSettings().method == "flow"
    assert search_settings("draft", {"method": "inn+flow"}).method == "inn+flow"
    with pytest.raises(InputError, match=r"\[search\] method"):
        search_settings("draft", {"method": "sgd"})
    with pytest.raises(InputError, match=r"\[search\] network_depth"):
        search_settings("draft", {"network_depth": 0})
    assert SearchSettings(network_iterations=100).scaled(0.5).network_iterations == 50
