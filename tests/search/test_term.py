"""A term written in torch: its gradient, what it refuses, and that a search heeds it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from questions import ask_views, start_and_search
from shapely import MultiPolygon, Point
from torch import Tensor

from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of
from knotfab.limits.terms import State
from knotfab.search.objective import Weights
from knotfab.search.term import TorchTerm
from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS

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
