"""Doubling: old vertices stay, new ones round the corners off, and the step is certified."""

import numpy as np
from scipy.spatial import cKDTree

from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import rings_of_sizes
from knotfab.sequence.doubling import double_vertices


def _trefoil(n: int) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    x, y = np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)
    return 20 * np.stack([x, y, -np.sin(3 * t)], axis=1)


def test_old_vertices_stay_and_new_ones_lie_on_the_curve() -> None:
    points = _trefoil(90)
    carried, both = double_vertices(points, rings_of_sizes((90,)))
    fine = carried.points
    assert carried.reached == 1.0 and carried.least_margin > 0
    assert both.sizes == (180,)
    np.testing.assert_array_equal(fine[::2], points)
    curve = cKDTree(_trefoil(90 * 400))
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    assert curve.query(fine[1::2])[0].max() < 0.1 * curve.query(middles)[0].max()


def test_bends_stay_what_they_are() -> None:
    points = _trefoil(90)
    rings = rings_of_sizes((90,))
    carried, both = double_vertices(points, rings)
    assert bend_radii(carried.points, both).min() > 0.97 * bend_radii(points, rings).min()


def test_a_step_that_could_cross_is_not_taken() -> None:
    """A strand close behind a sharp turn: the spline's overshoot would pass through it."""
    t = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    coarse = 30 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    # another ring that runs just outside one edge's middle, where the spline goes
    middle = 0.5 * (coarse[0] + coarse[1])
    outward = middle / np.linalg.norm(middle)
    s = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    at = middle + 0.15 * outward
    other = at + 4 * outward * (1 - np.cos(s)) + 4 * np.sin(s) * np.array([0.0, 0.0, 1.0])
    points, rings = np.concatenate([coarse, other]), rings_of_sizes((12, 40))
    carried, _ = double_vertices(points, rings)
    fine = carried.points
    # the spline would go 1 mm outwards; the other ring is 0.15 mm away
    gone = float((fine[1] - middle) @ outward)
    assert gone < 0.15
    np.testing.assert_array_equal(fine[:24:2], coarse)
    assert carried.reached < 1.0 < carried.steps + carried.refused
    assert carried.least_margin > 0
