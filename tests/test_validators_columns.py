"""Columns through solids, and distances between triangles, against plain references."""

from __future__ import annotations

import numpy as np
import pytest
from solids import box, inward, moved, together
from validator_parts import tangle, trefoil, tube

from knotfab_validators.columns import columns
from knotfab_validators.overhang import above
from knotfab_validators.read_mesh import Mesh
from knotfab_validators.triangle_distance import point_triangle, triangle_triangle


def test_columns_fill_the_volume() -> None:
    mesh = Mesh(*tube(trefoil(300, 10.0), 2.5))
    grid = columns(mesh, 0.2)
    corner = mesh.vertices[mesh.faces]
    volume = np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    assert (grid.high - grid.low).sum() * grid.cell**2 == pytest.approx(volume, rel=0.005)
    assert (grid.high > grid.low).all() and (np.diff(grid.column) >= 0).all()


def test_a_hollow_parts_a_column_and_an_overlap_joins_two() -> None:
    block, hole = box((0, 0, 0), (10, 10, 10)), inward(box((2, 2, 4), (8, 8, 6)))
    grid = columns(together(block, hole))
    inside = (grid.low == 6) & (grid.high == 10)
    assert inside.sum() == 12 * 12 and (grid.low == 0).sum() == 20 * 20
    lapped = columns(together(block, box((0, 0, 5), (10, 10, 15))))
    assert set(lapped.low) == {0.0} and set(lapped.high) == {15.0}


def test_an_axis_through_edges_and_corners_is_counted_once() -> None:
    # a fan about the middle, and the grid's axes on its spokes
    mesh = box((0, 0, 0), (4, 4, 4))
    shifted = moved(mesh, shift=(-0.50137 * 0.5, -0.50079 * 0.5, 0))
    grid = columns(together(shifted, moved(shifted, shift=(2.0, 2.0, 6.0))))
    assert (grid.high - grid.low == pytest.approx(4.0)) and len(grid.low) == 2 * 64


def test_many_columns_make_wider_cells() -> None:
    assert columns(box((0, 0, 0), (5000, 1, 1))).cell == pytest.approx(5.0)


@pytest.mark.parametrize("level", [-1.0, 0.0, 0.3, 0.6, 1.1, 2.0, 3.0])
def test_the_share_of_a_triangle_above_a_level(level: float) -> None:
    samples = np.random.default_rng(0).dirichlet([1, 1, 1], 200_000) @ [0.0, 0.6, 2.0]
    share = above(np.array([[0.6, 2.0, 0.0]]), level)[0]
    assert share == pytest.approx((samples > level).mean(), abs=0.005)


def test_the_share_of_level_edges_is_exact() -> None:
    z = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    assert above(z, 0.5).tolist() == [0.75, 0.25, 1.0]


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
