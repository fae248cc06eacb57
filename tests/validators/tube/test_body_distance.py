"""The distance of the nearest bodies, against all pairs of triangles."""

import numpy as np
import pytest

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.triangles import triangle_triangle, triangles_cross
from knotfab_validators.tube.body_distance import nearest_bodies


@pytest.mark.parametrize("seed", range(10))
def test_distance_of_bodies_against_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soups = [rng.normal(size=(12, 3)) * [1, 2, 0.3] + [3 * k, k % 2, 0] for k in range(4)]
    faces = [np.array([[i, i + 1, i + 2] for i in range(10)]) + 12 * k for k in range(4)]
    mesh = Mesh(np.concatenate(soups), np.concatenate(faces))
    least = np.inf
    for a in range(4):
        for b in range(a):
            one = np.repeat(mesh.vertices[faces[a]], 10, axis=0)
            other = np.tile(mesh.vertices[faces[b]], (10, 1, 1))
            distance = triangle_triangle(one, other)[0]
            least = min(least, float(np.where(triangles_cross(one, other), 0.0, distance).min()))
    found = nearest_bodies(mesh)
    assert not isinstance(found, str)
    assert found[0] == pytest.approx(least, abs=1e-9)


def test_copies_and_heaps_of_faces_cost_no_more_than_allowed() -> None:
    """Trees of boxes do not help where all boxes overlap: their work would grow with the square."""
    rng = np.random.default_rng(0)
    one = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [4, 0, 0], [3, 1, 0]])
    copies = Mesh(one, np.tile([[0, 1, 2], [3, 4, 5]], (200_000, 1)))
    found = nearest_bodies(copies)
    assert not isinstance(found, str) and found[0] == pytest.approx(2.0)
    points = rng.normal(size=(2 * 12_000, 3)) * 10
    points[12_000:] += [0, 0, 1e-6]
    chain = np.column_stack([np.arange(11_998), np.arange(11_998) + 1, np.arange(11_998) + 2])
    heap = Mesh(points, np.concatenate([chain, chain + 12_000]))
    assert "boxes that overlap" in str(nearest_bodies(heap))
