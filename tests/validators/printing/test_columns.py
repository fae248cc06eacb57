"""Columns through solids, and distances between triangles, against plain references."""

import numpy as np
import pytest
from solids import box, inward, move, together
from validator_parts import trefoil, tube

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing import columns as columns_module
from knotfab_validators.printing.columns import _heights, columns


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
    # the grid's axes lie on the spokes of a fan about the middle
    mesh = box((0, 0, 0), (4, 4, 4))
    shifted = move(mesh, shift=(-0.50137 * 0.5, -0.50079 * 0.5, 0))
    grid = columns(together(shifted, move(shifted, shift=(2.0, 2.0, 6.0))))
    assert (grid.high - grid.low == pytest.approx(4.0)) and len(grid.low) == 2 * 64


def test_many_columns_make_wider_cells() -> None:
    assert columns(box((0, 0, 0), (5000, 1, 1))).cell == pytest.approx(5.0)


def test_rows_are_counted_before_they_are_looked_through(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fibres in a row, 40 mm long: many rows of axes a face, few axes."""
    fibres = together(*(box((x, 0, 0), (x + 0.1, 40, 0.1)) for x in np.arange(0, 10, 0.2)))
    counted: list[int] = []
    rows = columns_module._rows

    def look(corner: np.ndarray, start: np.ndarray, cell: float) -> object:
        counted.append(int((np.ptp(corner[:, :, 1], axis=1) / cell).sum()))
        return rows(corner, start, cell)

    monkeypatch.setattr(columns_module, "_rows", look)
    monkeypatch.setattr(columns_module, "MOST_TESTS", 10_000)
    assert columns(fibres).cell > 0.5 and max(counted) <= 10_000


@pytest.mark.slow
def test_slivers_across_the_part_are_met_as_by_brute_force() -> None:
    """A plate whose faces are a fan of slivers, aslant: every axis tested against every face."""
    n = 90
    turn = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack([10 * np.cos(turn), 10 * np.sin(turn), np.zeros(n)])
    number, ahead = np.arange(n), np.roll(np.arange(n), -1)
    low = np.column_stack([np.full(n, 2 * n), ahead, number])
    high = np.column_stack([np.full(n, 2 * n + 1), number + n, ahead + n])
    sides = [
        np.column_stack([number, ahead, ahead + n]),
        np.column_stack([number, ahead + n, number + n]),
    ]
    far = np.array([[9.5, 1.5, 0.0], [9.5, 1.5, 3.0]])
    vertices = np.concatenate([rim, rim + [0.0, 0.0, 3.0], far])
    vertices[:, 2] += 0.05 * vertices[:, 0]
    mesh = Mesh(vertices, np.concatenate([low, high, *sides]))
    grid = columns(mesh)
    place = grid.across * np.arange(41)[:, None] + np.arange(grid.across)
    face, column = (k.ravel() for k in np.indices((len(mesh.faces), place.size)))
    x, y = (
        grid.origin[k] + grid.cell * at
        for k, at in enumerate((column % grid.across, column // grid.across))
    )
    z, facing = _heights(mesh, face, x, y)
    ends = {k: z[(column == k) & (facing != 0)] for k in np.unique(column[facing != 0])}
    assert list(ends) == grid.column.tolist() and len(ends) > 1000
    assert all(len(met) == 2 for met in ends.values())
    np.testing.assert_allclose(grid.low, [met.min() for met in ends.values()])
    np.testing.assert_allclose(grid.high, [met.max() for met in ends.values()])
