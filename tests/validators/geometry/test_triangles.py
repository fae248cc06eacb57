"""Distances between triangles, and whether they cross, against plain references."""

from __future__ import annotations

import numpy as np
import pytest
from validator_parts import tangle, tube

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.triangles import point_triangle, triangle_triangle, triangles_cross


def test_distances_agree_with_sampled_ones() -> None:
    rng = np.random.default_rng(3)
    first = rng.normal(size=(40, 3, 3))
    second = rng.normal(size=(40, 3, 3)) + np.array([4.0, 0, 0])
    d, p, q = triangle_triangle(first, second)
    assert np.linalg.norm(p - q, axis=1) == pytest.approx(d, abs=1e-12)
    i = np.linspace(0, 1, 25)
    u, v = (g[np.add.outer(i, i) <= 1 + 1e-9] for g in np.meshgrid(i, i))
    weight = np.column_stack([1 - u - v, u, v])
    for k in range(len(first)):
        a, b = weight @ first[k], weight @ second[k]
        sampled = np.linalg.norm(a[:, None] - b[None], axis=2)
        assert d[k] <= sampled.min() + 1e-9 and d[k] > sampled.min() - 0.15
        to, near = point_triangle(second[k][:1], first[k][None])
        assert np.linalg.norm(near[0] - second[k][0]) == pytest.approx(to[0])
        assert to[0] <= np.linalg.norm(a - second[k][0], axis=1).min() + 1e-9


def test_touching_and_parallel_triangles() -> None:
    one = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    assert triangle_triangle(one, one + [0, 0, 0.25])[0][0] == pytest.approx(0.25, rel=1e-14)
    assert triangle_triangle(one, one + [1.0, 0, 0])[0][0] == 0.0
    tangled = Mesh(*tube(tangle(60), 1.0, 6))
    corner = tangled.vertices[tangled.faces]
    assert triangle_triangle(corner[:1], corner[:1])[0][0] == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_triangles_cross_as_the_points_of_an_edge_say(seed: int) -> None:
    """A point of an edge of one that lies on the other, found by barycentric coordinates."""
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, 50, 3, 3))
    expected = np.zeros(50, dtype=bool)
    for n in range(50):
        for one, other in ((first[n], second[n]), (second[n], first[n])):
            for k in range(3):
                p, q = one[k], one[(k + 1) % 3]
                matrix = np.column_stack([q - p, other[0] - other[1], other[0] - other[2]])
                t, u, v = np.linalg.solve(matrix, other[0] - p)
                expected[n] |= 0 <= t <= 1 and u >= 0 and v >= 0 and u + v <= 1
    assert (triangles_cross(first, second) == expected).all()
