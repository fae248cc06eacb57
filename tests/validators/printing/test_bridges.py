"""Bridges and ledges of known length."""

from __future__ import annotations

import numpy as np
import pytest
from printed_solids import BARE, PRINTER, leaning, run
from solids import blocks, box, bridge, cone, inward, move, together
from validator_parts import trefoil, tube

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing import bridges as columns_module
from knotfab_validators.printing.bridges import _heights, columns


@pytest.mark.parametrize("width", [3.0, 60.0])
def test_a_bridge_is_as_long_as_its_span(width: float) -> None:
    found = run(bridge(10.0, width), BARE)
    assert found["bridge"].measured == pytest.approx(10.0, abs=1e-9)
    assert found["bridge"].status == found["overhang"].status == "pass"
    assert found["islands"].measured == 0
    less = run(bridge(10.0, width), BARE.model_copy(update={"max_bridge_mm": 9.99}))
    assert less["bridge"].status == less["overhang"].status == "fail"
    assert less["overhang"].measured == pytest.approx(10 * width / 100, rel=1e-9)
    x, y, z = less["bridge"].at[0]
    assert 9 < x < 11 and 0 < y < width and z == pytest.approx(10.0)
    assert (
        run(bridge(10.0, width), PRINTER.model_copy(update={"max_bridge_mm": 1.0}))["bridge"].status
        == "pass"
    )


def test_a_ledge_counts_twice_and_is_no_bridge() -> None:
    ledge = blocks([0, 10, 14], [0, 20], [0, 10, 12], [[[1, 1]], [[0, 1]]])
    found = run(ledge, BARE)
    assert found["bridge"].measured == pytest.approx(8.0, abs=1e-9)
    assert found["bridge"].status == "pass" and found["overhang"].status == "fail"
    assert run(ledge, BARE.model_copy(update={"max_bridge_mm": 7.9}))["bridge"].status == "fail"


def test_a_slope_that_holds_itself_is_no_long_ledge() -> None:
    assert run(leaning(45.0), BARE)["bridge"].measured <= 1.0


# Columns through solids, and distances between triangles, against plain references.


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


# What begins in mid-air, and what only seems to.


def test_what_hangs_down_in_mid_air_is_an_island() -> None:
    filled = np.zeros((5, 1, 3))
    filled[:, :, 2] = filled[0] = filled[4] = 1
    filled[2, :, 1] = 1
    hanging = blocks([0, 5, 9, 11, 15, 20], [0, 10], [0, 6, 10, 12], filled)
    found = run(hanging, BARE)
    assert (found["islands"].measured, found["islands"].status) == (1, "fail")
    assert found["floating"].measured == 0 and found["floating"].status == "pass"
    x, _, z = found["islands"].at[0]
    assert 9 <= x <= 11 and z == pytest.approx(6.0)
    assert run(hanging)["islands"].status == "pass"


def test_a_leg_thinner_than_the_grid_still_holds() -> None:
    filled = np.zeros((5, 5, 4))
    filled[:, :, 0] = filled[:, :, 3] = filled[2, 2] = 1
    filled[[0, -1], :, 1] = filled[:, [0, -1], 1] = 1  # it stands in a tray
    line = [0.0, 2.0, 4.85, 5.15, 8.0, 10.0]  # between the axes at 4.75 and 5.25
    found = run(blocks(line, line, [0.0, 2.0, 3.0, 6.0, 8.0], filled), BARE)
    assert found["islands"].measured == 0


def test_a_cone_on_its_tip() -> None:
    standing = run(cone((20, 20, 0), 8.0, 12.0), BARE)
    assert standing["islands"].measured == standing["floating"].measured == 0
    aloft = run(cone((20.1, 20.2, 5), 8.0, 12.0), BARE)
    assert aloft["islands"].measured == aloft["floating"].measured == 1
    assert aloft["floating"].at[0] == pytest.approx((20.1, 20.2, 5))
    assert aloft["islands"].at[0] == pytest.approx((20.1, 20.2, 5), abs=0.8)
