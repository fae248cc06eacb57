"""Columns through solids, and distances between triangles, against plain references."""

from __future__ import annotations

import numpy as np
import pytest
from solids import box, inward, move, together
from validator_parts import trefoil, tube

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.columns import columns


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
    shifted = move(mesh, shift=(-0.50137 * 0.5, -0.50079 * 0.5, 0))
    grid = columns(together(shifted, move(shifted, shift=(2.0, 2.0, 6.0))))
    assert (grid.high - grid.low == pytest.approx(4.0)) and len(grid.low) == 2 * 64


def test_many_columns_make_wider_cells() -> None:
    assert columns(box((0, 0, 0), (5000, 1, 1))).cell == pytest.approx(5.0)
