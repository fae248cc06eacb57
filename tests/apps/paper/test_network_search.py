"""The network's search: samples whose type is proved, honest refusals, and pictures that get better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from questions import ask_heart, start_and_search

from knotfab.apps.paper import network_search
from knotfab.base.errors import SceneError
from knotfab.geometry.carry import Carried
from knotfab.problem import Problem, SearchResult
from knotfab.start.filling import Template
from knotfab.start.start import start_at_circles
from knotfab_formats.errors import InputError
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


@pytest.mark.study  # as from a circle and before the flow
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
def test_what_cannot_be_carried_stays_where_it_is_certified(
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
