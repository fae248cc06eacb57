"""The checks tell whether parts reach the bed, and how far they are from toppling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solids import (
    BARE,
    PRINTER,
    blocks,
    box,
    bridge,
    cone,
    inward,
    leaning,
    move,
    prism,
    run,
    table,
    together,
)
from validator_parts import trefoil, tube

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing import bridges as columns_module
from knotfab_validators.printing.bridges import _heights, columns
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.printing.standing import bodies, share_above


def test_a_body_one_layer_up_still_lies_on_the_bed() -> None:
    ground = box((0, 0, 0), (10, 10, 5))
    for height, count in ((0.2, 0), (0.203, 1)):
        found = run(together(ground, box((20, 0, height), (30, 10, 5))), BARE)
        assert (found["floating"].measured, found["islands"].measured) == (count, count)
        assert found["floating"].status == ("fail" if count else "pass")
    assert run(box((0, 0, 3), (5, 5, 5)))["floating"].status == "pass"  # with supports


def test_a_box_stands_by_half_its_width() -> None:
    found = run(box((5, 5, 0), (15, 45, 20)), stands=True)["standing"]
    assert found.measured == pytest.approx(5.0) and found.status == "pass"
    assert "26.6°" in found.detail and found.at[0] == pytest.approx((10, 25, 10))


@pytest.mark.parametrize(("more", "status"), [(0.0, "pass"), (0.001, "fail")])
def test_a_top_that_reaches_out_too_far_topples(more: float, status: str) -> None:
    reach = 2 + np.sqrt(8) + more  # the centre is above the foot's edge
    mesh = blocks([0, 2, reach], [0, 6], [0, 1, 2], [[[1, 1]], [[0, 1]]])
    found = run(mesh, stands=True)["standing"]
    assert (found.status, found.required) == (status, True)
    assert found.measured == pytest.approx(0.0, abs=1e-3)
    assert run(mesh)["standing"].status == "pass"


def test_a_hollow_moves_the_centre() -> None:
    solid, hole = box((0, 0, 0), (20, 20, 20)), box((12, 5, 5), (18, 15, 15))
    found = run(together(solid, inward(hole)), stands=True)
    x = (8000 * 10 - 600 * 15) / 7400
    assert found["standing"].at[0] == pytest.approx((x, 10, 10))
    assert found["standing"].measured == pytest.approx(x)
    assert found["feature"].measured == pytest.approx(2.0)
    assert "of 1;" in found["floating"].detail


def test_the_centre_of_mass_is_that_of_other_libraries() -> None:
    pymeshlab, trimesh = pytest.importorskip("pymeshlab"), pytest.importorskip("trimesh")
    vertices, faces = tube(trefoil(120, 10.0), 2.0, 24)
    (body,) = bodies(Mesh(vertices + [50.0, 60.0, 70.0], faces))
    other = trimesh.Trimesh(vertices + [50.0, 60.0, 70.0], faces, process=False)
    assert body.volume_mm3 == pytest.approx(other.volume, rel=1e-9)
    assert body.center == pytest.approx(other.center_mass, rel=1e-9)
    third = pymeshlab.MeshSet()
    third.add_mesh(pymeshlab.Mesh(vertices, faces))
    measures = third.get_geometric_measures()
    assert body.volume_mm3 == pytest.approx(measures["mesh_volume"], rel=1e-4)
    assert body.center - [50, 60, 70] == pytest.approx(measures["center_of_mass"], abs=1e-3)


def test_each_body_stands_for_itself() -> None:
    pair = together(box((0, 0, 0), (10, 10, 5)), cone((30, 30, 0), 5.0, 8.0))
    found = run(pair, stands=True)["standing"]
    assert found.measured == pytest.approx(0.201 * 5 / 8 * np.cos(np.pi / 48), rel=1e-6)
    assert "2 bodies" in found.detail
    edge = prism([(5, 0), (10, 5), (5, 10), (0, 5)], 8)  # lies on an edge, within the layer 0.4 mm
    assert run(edge, stands=True)["standing"].measured == pytest.approx(0.201)


def test_what_is_printed_lying_stands_as_it_is_turned() -> None:
    """A wide low block, printed on its edge; places are told as it is printed."""
    mesh = box((0, 0, 0), (4, 40, 40))
    up = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # print x is up
    lying = printability_checks(mesh, None, seconds={}, stands=True)
    stood = printability_checks(mesh, None, seconds={}, stands=True, desk=up)
    one, other = ({c.name: c for c in found}["standing"] for found in (lying, stood))
    assert one.measured == pytest.approx(2.0) and other.measured == pytest.approx(20.0)
    assert other.at[0] == pytest.approx((2, 20, 20))
    assert other.status == "pass" and "not as it is printed" in other.detail


# Overhangs and the support under them, of solids whose numbers are known.


@pytest.mark.parametrize("level", [-1.0, 0.0, 0.3, 0.6, 1.1, 2.0, 3.0])
def test_the_share_of_a_triangle_above_a_level(level: float) -> None:
    samples = np.random.default_rng(0).dirichlet([1, 1, 1], 200_000) @ [0.0, 0.6, 2.0]
    share = share_above(np.array([[0.6, 2.0, 0.0]]), level)[0]
    assert share == pytest.approx((samples > level).mean(), abs=0.005)


def test_the_share_of_level_edges_is_exact() -> None:
    z = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    assert share_above(z, 0.5).tolist() == [0.75, 0.25, 1.0]


def test_the_overhang_begins_beyond_the_limit() -> None:
    assert run(leaning(45.0), BARE)["overhang"].measured == 0.0
    assert run(leaning(45.0), BARE)["overhang"].status == "pass"
    found = run(leaning(45.2), BARE)["overhang"]
    # all of the underside but what belongs to the first layer
    area = 20 * (10 - 0.201) / np.cos(np.radians(45.2)) / 100
    assert found.status == "fail" and found.measured == pytest.approx(area, rel=1e-6)
    assert (
        run(leaning(45.2), BARE.model_copy(update={"max_overhang_deg": 45.2}))["overhang"].status
        == "pass"
    )
    assert run(leaning(45.2))["overhang"].required is False


def test_a_table_needs_a_box_of_support() -> None:
    found = run(table())
    assert found["overhang"].measured == pytest.approx(3.84, rel=1e-9)
    assert (found["overhang"].status, found["overhang"].limit) == ("pass", None)
    assert found["support_volume"].measured == pytest.approx(3.84, rel=1e-9)
    fits = PRINTER.model_copy(update={"max_support_cm3": 3.8400001})
    assert run(table(), fits)["support_volume"].status == "pass"
    tight = run(table(), fits.model_copy(update={"max_support_cm3": 3.839}))["support_volume"]
    assert (tight.status, tight.required) == ("fail", True)
    assert (
        run(table(), BARE.model_copy(update={"max_support_cm3": 1.0}))["support_volume"].required
        is False
    )


def test_support_stands_on_the_surface_below() -> None:
    plate = box((-10, -10, 0), (30, 30, 4))
    legless = move(table(), shift=(0, 0, 0))
    found = run(together(plate, move(legless, shift=(0, 0, 5))))["support_volume"]
    # the leg's own underside hangs 1 mm above the plate, the top 11 mm
    assert found.measured == pytest.approx((16 * 1 + 384 * 11) / 1000, rel=0.02)


def test_a_slope_off_the_grid_is_supported_within_its_error() -> None:
    found = run(move(leaning(60.0), Rotation.from_euler("z", 0.3).as_matrix(), (10, 5, 0)))
    shift = 10 * np.tan(np.radians(60))
    assert found["support_volume"].measured == pytest.approx(shift * 10 / 2 * 20 / 1000, rel=0.02)


# Bridges and ledges of known length.


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
