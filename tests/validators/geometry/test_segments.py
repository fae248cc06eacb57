"""Distances of points and segments: against fine samples, in degenerate places, and nearly parallel."""

import numpy as np
import pytest
from validator_parts import Array

from knotfab_validators.geometry.segments import nearest_on_two, point_segment, segment_segment
from knotfab_validators.geometry.triangle_loops import _from_segment, _nearest_parameters


def rows(*points: tuple[float, ...]) -> list[Array]:
    return [np.array([point], dtype=np.float64) for point in points]


@pytest.mark.parametrize("seed", range(4))
def test_distances_agree_with_sampled_ones(seed: int) -> None:
    a, b, c, d = np.random.default_rng(seed).normal(size=(4, 30, 3))
    t = np.linspace(0, 1, 201)[:, None, None]
    one, other = a + t * (b - a), c + t * (d - c)
    to_point = np.linalg.norm(one - c, axis=2).min(axis=0)
    between = np.linalg.norm(one[:, None] - other[None], axis=3).min(axis=(0, 1))
    assert point_segment(c, a, b) == pytest.approx(to_point, abs=1e-3)
    found = segment_segment(a, b, c, d)
    assert (found <= between + 1e-12).all() and found == pytest.approx(between, abs=0.02)
    p, q = nearest_on_two(a, b, c, d)
    assert np.linalg.norm(p - q, axis=1) == pytest.approx(found, abs=1e-12)


def test_parallel_and_pointlike_segments() -> None:
    a, b, c, d = rows((0, 0, 0), (4, 0, 0), (1, 3, 0), (9, 3, 0))
    assert segment_segment(a, b, c, d)[0] == 3.0
    assert segment_segment(a, b, *rows((7, 4, 0), (9, 4, 0)))[0] == 5.0
    assert segment_segment(a, b, c, c)[0] == 3.0 and segment_segment(c, c, a, a)[0] == 10**0.5
    assert point_segment(c, a, a)[0] == 10**0.5


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 1e-6])
def test_segments_that_cross_at_a_small_angle_meet(angle: float) -> None:
    a, b = rows((-1, 0, 0), (1, 0, 0))
    c, d = rows((-0.9, -0.9 * angle, 0), (0.8, 0.8 * angle, 0))
    assert segment_segment(a, b, c, d)[0] < 1e-15 / angle
    above = [p + [0, 0, 0.5] for p in (c, d)]
    assert segment_segment(a, b, *above)[0] == pytest.approx(0.5, rel=1e-12)


def test_the_compiled_loops_of_triangles_have_the_same_distances() -> None:
    points = np.random.default_rng(4).normal(size=(4, 200, 3))
    points[1, :20], points[3, 10:30] = points[0, :20], points[2, 10:30]  # without length
    a, b, c, d = points
    p, q = nearest_on_two(a, b, c, d)
    far = point_segment(c, a, b)
    for k, (u, v, w) in enumerate(zip(b - a, d - c, c - a, strict=True)):
        s, t = _nearest_parameters(tuple(u), tuple(v), tuple(w))
        np.testing.assert_allclose([a[k] + s * u, c[k] + t * v], [p[k], q[k]], atol=1e-12)
        found = _from_segment(tuple(c[k]), tuple(a[k]), tuple(b[k]))
        assert found == pytest.approx(far[k], abs=1e-12)
