"""Doubling: corners are rounded off, nothing bends more than it did, and the step is certified."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from validator_parts import trefoil

from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.sequence.search import double_vertices


def test_new_vertices_halve_the_edges_and_round_the_corners() -> None:
    points = trefoil(90, 20.0)
    rings = polylines_of_sizes((90,))
    carried, both = double_vertices(points, rings)
    fine = carried.points
    assert carried.reached == 1.0 and carried.least_margin > 0
    assert both.sizes == (180,)
    ahead, behind = np.roll(points, -1, axis=0), np.roll(points, 1, axis=0)
    np.testing.assert_array_equal(fine[1::2], 0.5 * (points + ahead))
    # this is the mask of the uniform cubic B-spline, in full
    np.testing.assert_allclose(fine[::2], 0.75 * points + 0.125 * (ahead + behind), atol=1e-12)
    # the curve stays as near to the true one as the middles of the old edges were
    curve = cKDTree(trefoil(90 * 400, 20.0))
    middles = 0.5 * (points + ahead)
    assert curve.query(fine)[0].max() < 1.01 * curve.query(middles)[0].max()
    assert bend_radii(fine, both).min() > 0.97 * bend_radii(points, rings).min()


def test_bends_that_alternate_are_not_made_stronger() -> None:
    """A wide ring whose bends go up and down a little: a curve through its vertices bends far more."""
    around, tube_mm, ring_mm, zigzag = 240, 1.8, 33.0, 0.05
    t = np.linspace(0, 2 * np.pi, around, endpoint=False)
    edge = 2 * np.pi * ring_mm / around
    away = ring_mm + zigzag * (edge**2 / (4 * ring_mm)) * (-1.0) ** np.arange(around)
    points = np.stack([away * np.cos(t), away * np.sin(t), 0 * t], axis=1)
    rings = polylines_of_sizes((around,))
    before = bend_radii(points, rings).min()
    assert edge < 0.5 * tube_mm and 0.93 * ring_mm < before < 0.97 * ring_mm
    carried, both = double_vertices(points, rings)
    assert bend_radii(carried.points, both).min() > 0.999 * before
    spline = CubicSpline(
        np.arange(around + 1), np.concatenate([points, points[:1]]), bc_type="periodic"
    )
    through = np.asarray(spline(np.arange(2 * around) / 2))
    assert bend_radii(through, both).min() < 0.96 * before


def test_a_step_that_could_cross_is_not_taken() -> None:
    """A strand close inside a sharp turn, which would pass through it where its corner is cut."""
    t = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    coarse = 30 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    # another ring goes around the first corner, just inside of it
    outward = coarse[0] / np.linalg.norm(coarse[0])
    s = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    at = coarse[0] - 0.15 * outward
    other = at + 4 * outward * (1 - np.cos(s)) + 4 * np.sin(s) * np.array([0.0, 0.0, 1.0])
    points, rings = np.concatenate([coarse, other]), polylines_of_sizes((12, 40))
    carried, _ = double_vertices(points, rings)
    # the corner would go 1 mm inwards; the other ring is 0.15 mm away, and less as it shrinks itself
    gone = float((coarse[0] - carried.points[0]) @ outward)
    assert 0.0 <= gone < 0.15
    assert carried.reached < 1.0 < carried.steps + carried.refused
    assert carried.steps == 0 or carried.least_margin > 0
