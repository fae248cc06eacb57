"""Bending and tension: exact on circles, free of scale, and their slope that of finite differences."""

import numpy as np
import pytest
from slopes import assert_slope, state_at

from knotfab.base.arrays import Array
from knotfab.geometry.measures import measure_curvature
from knotfab.limits.base import Felt
from knotfab.search.grace import Grace
from knotfab.search.objective import Weights


def felt(points: Array, radius: float, weight: float = 1.0, bends: bool = False) -> Felt:
    return Grace(radius, weight, bends)(state_at(points, 1.0), Weights())


def energy(points: Array, radius: float, weight: float = 1.0, bends: bool = False) -> float:
    return felt(points, radius, weight, bends)[0]


def circle(radius: float, count: int = 400) -> Array:
    t = 2 * np.pi * np.arange(count) / count
    flat = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    return np.asarray(radius * flat)


@pytest.mark.parametrize("size", [2.0, 7.0, 50.0])
def test_grace_of_a_circle_is_its_turn_and_half_its_length(size: float) -> None:
    bending, stretched = 1.5 * 2 * np.pi / size, 2 * np.pi * size / 1.5
    assert energy(circle(size), 1.5) == pytest.approx(bending + 0.5 * stretched, rel=1e-4)


def test_a_free_circle_is_as_large_as_both_parts_ask() -> None:
    # Euler's elastica: of r / R and L / 2r the sum is least at R = r * sqrt(2)
    sizes = np.linspace(1.0, 4.0, 61)
    found = [energy(circle(size), 1.5) for size in sizes]
    assert sizes[np.argmin(found)] == pytest.approx(1.5 * np.sqrt(2), abs=0.05)


@pytest.mark.parametrize("bends", [False, True])
def test_it_is_free_of_scale_and_in_proportion_to_its_weight(bends: bool) -> None:
    wavy = circle(20.0)
    wavy = wavy + 2.0 * np.sin(9 * np.arctan2(wavy[:, 1], wavy[:, 0]))[:, None] * wavy / 20.0
    once = energy(wavy, 2.0, bends=bends)
    assert energy(3.0 * wavy, 6.0, bends=bends) == pytest.approx(once, rel=1e-12)
    less = energy(wavy, 2.0, weight=0.02, bends=bends)
    assert less == pytest.approx(0.02 * once, rel=1e-12)
    assert once > 1.2 * energy(circle(20.0), 2.0, bends=bends)


def test_a_bend_costs_no_more_where_it_is_tight() -> None:
    def turn_once(size: float, bends: bool) -> float:
        """What turning once about at this radius takes, what pulls left out."""
        return energy(circle(size), 1.0, bends=bends) - np.pi * size

    tight, wide = 1.0 / 0.3, 1.0 / 0.1
    assert turn_once(tight, bends=True) < 1.01 * turn_once(wide, bends=True)
    assert turn_once(tight, bends=False) > 2.9 * turn_once(wide, bends=False)
    # bent as a wire is they are worth their bending energy
    assert turn_once(tight, bends=True) == pytest.approx(turn_once(tight, bends=False), rel=1e-3)


@pytest.mark.parametrize("bends", [False, True])
def test_its_slope_is_that_of_finite_differences(bends: bool) -> None:
    points = circle(10.0, 40) + 0.4 * np.sin(np.arange(120.0)).reshape(40, 3)
    assert_slope(lambda p: felt(p, 1.0, bends=bends), points)


@pytest.mark.parametrize("bends", [False, True])
def test_an_edge_without_length_has_a_slope_that_is_finite(bends: bool) -> None:
    points = circle(10.0, 40)
    points[7] = points[6]
    total, slope = felt(points, 1.0, bends=bends)
    assert np.isfinite(total) and np.isfinite(slope).all()


def test_curvature_and_turns_of_a_circle_walked_twice() -> None:
    t = 4 * np.pi * np.arange(500) / 500
    twice = np.stack([5 * np.cos(t), 5 * np.sin(t), 0.1 * np.sin(t / 2)], axis=1)
    found = measure_curvature(twice, 2.0)
    assert found.turns == pytest.approx(2.0, rel=1e-3)
    assert found.mean == pytest.approx(0.4, rel=1e-3)
    assert found.quantile_90 == pytest.approx(0.4, rel=1e-2)
