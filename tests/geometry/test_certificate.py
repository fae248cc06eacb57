"""Certificates: what they let pass is an isotopy, and what crosses is refused."""

import numpy as np
import pytest

from knotfab.geometry.carry import certify, resample, subdivide
from knotfab.geometry.kernels import closest_parameters
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.geometry.tube import sweep
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.clearance import check_clearance


def _circle(n: int, radius: float = 10.0, z: float = 0.0) -> np.ndarray:
    t = np.arange(n) / n * 2 * np.pi
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), np.full(n, z)])


def test_a_strand_may_not_pass_through_another() -> None:
    # the upper of two circles falls through the lower
    points = np.concatenate([_circle(60), _circle(60, z=2.0)])
    rings = polylines_of_sizes((60, 60))
    near = find_neighbours(points, rings, 8.0, 6)
    step = np.zeros_like(points)
    step[60:, 2] = -1.5
    assert certify(points, step, rings, near).valid
    step[60:, 2] = -2.5
    verdict = certify(points, step, rings, near)
    assert not verdict.valid
    assert "pass through" in verdict.reason


def test_both_moving_together_is_no_crossing() -> None:
    points = np.concatenate([_circle(60), _circle(60, z=0.5)])
    rings = polylines_of_sizes((60, 60))
    near = find_neighbours(points, rings, 60.0, 6)
    step = np.full_like(points, 9.0)
    assert certify(points, step, rings, near).valid


def test_an_old_neighbour_list_is_refused() -> None:
    points, rings = _circle(60), polylines_of_sizes((60,))
    near = find_neighbours(points, rings, 3.0, 6)
    far = points + 5.0 * points / 10.0
    assert "too old" in certify(far, np.zeros_like(points), rings, near).reason


def test_folding_back_is_refused() -> None:
    points, rings = _circle(60), polylines_of_sizes((60,))
    near = find_neighbours(points, rings, 8.0, 6)
    step = np.zeros_like(points)
    step[7] = 1.2 * (points[9] - points[7])
    assert not certify(points, step, rings, near).valid
    step[7] = np.nan
    assert not certify(points, step, rings, near).valid


def test_closest_parameters_against_a_grid() -> None:
    rng = np.random.default_rng(1)
    p, u, q, v = rng.normal(size=(4, 200, 3))
    s, t = closest_parameters(p, u, q, v)
    found = np.linalg.norm(p + s[:, None] * u - q - t[:, None] * v, axis=1)
    grid = np.linspace(0, 1, 41)
    a, b = (x.ravel() for x in np.meshgrid(grid, grid))
    for k in range(200):
        sampled = p[k] + a[:, None] * u[k] - q[k] - b[:, None] * v[k]
        assert found[k] <= np.linalg.norm(sampled, axis=1).min() + 1e-9


def test_resampling_is_even_and_certified() -> None:
    t = np.sort(np.random.default_rng(3).uniform(0, 2 * np.pi, 150))
    points = np.column_stack([10 * np.cos(t), 10 * np.sin(t), 3 * np.sin(3 * t)])
    fresh, rings, verdict = resample(points, polylines_of_sizes((150,)), 0.3)
    assert verdict.valid
    edges = np.linalg.norm(fresh[rings.next] - fresh, axis=1)
    assert edges.max() / edges.min() < 1.02


def test_resampling_too_coarsely_is_refused() -> None:
    # a thin hairpin pair of strands that coarse vertices would make cross
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    wave = np.sin(40 * t)
    points = np.concatenate(
        [
            np.column_stack([10 * np.cos(t), 10 * np.sin(t), wave]),
            np.column_stack([10 * np.cos(t), 10 * np.sin(t), wave + 0.2]),
        ]
    )
    rings = polylines_of_sizes((400, 400))
    same, same_rings, verdict = resample(points, rings, 3.0)
    assert not verdict.valid
    assert same is points
    assert same_rings is rings


def test_subdividing_leaves_the_curve_as_it_is() -> None:
    # long edges that no certified resampling would take (the drawn cat once ended infeasible on them)
    points, rings = _circle(12, 10.0), polylines_of_sizes((12,))
    fine, fine_rings = subdivide(points, rings, 1.0)
    edges = np.linalg.norm(fine[fine_rings.next] - fine, axis=1)
    assert edges.max() < 1.5
    before = np.linalg.norm(points[rings.next] - points, axis=1).sum()
    assert edges.sum() == pytest.approx(before, rel=1e-12)
    corners = np.linalg.norm(fine[:, None] - points[None], axis=2).min(axis=0)
    assert corners.max() == 0.0


def test_the_smallest_ring_keeps_the_clearance_of_its_hole() -> None:
    """Twelve vertices would bring the corners across the hole nearer, though they face each other no more."""
    angle = 2 * np.pi * np.arange(12) / 12
    small = 1.035 * np.column_stack([np.cos(angle), np.sin(angle), 0.05 * np.cos(2 * angle)])
    fresh, rings, verdict = resample(small, polylines_of_sizes((12,)), 0.9)
    assert verdict.valid and rings.sizes == (24,)
    vertices, faces = sweep(fresh, 0.8, 12)
    curves = Curves((fresh,), ("unknot",), (True,), 0.8)
    assert check_clearance(Mesh(vertices, faces), curves, 0.4).status == "pass"
