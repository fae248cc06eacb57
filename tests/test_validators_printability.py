"""Walls, gaps, overhangs, bridges, islands and standing, against solids with known measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solids import (
    blocks,
    box,
    bridge,
    cone,
    inward,
    moved,
    prism,
    quarter,
    table,
    together,
)
from validator_parts import circle, trefoil, tube

from knotfab_validators.check import Check
from knotfab_validators.printability import NAMES, printability_checks
from knotfab_validators.read_mesh import Mesh
from knotfab_validators.read_scene import Printer
from knotfab_validators.standing import bodies

PRINTER = Printer("test", None, nozzle_mm=0.4)
BARE = replace(PRINTER, supports=False)  # prints without supports
SKEW = Rotation.from_euler("xyz", [0.4, 0.7, -1.1]).as_matrix()


def run(mesh: Mesh, printer: Printer | None = PRINTER, stands: bool = False) -> dict[str, Check]:
    checks = printability_checks(mesh, printer, seconds={}, stands=stands)
    return {c.name: c for c in checks}


def nozzle(mm: float) -> Printer:
    return replace(PRINTER, nozzle_mm=mm)


# Walls


@pytest.mark.parametrize("turn", [np.eye(3), SKEW])
def test_a_slab_is_as_thick_as_it_is(turn: np.ndarray) -> None:
    slab = moved(box((0, 0, 0), (20, 15, 0.4)), turn, (3, 4, 20))
    found = run(slab)["feature"]
    assert found.measured == pytest.approx(0.4, rel=1e-6)
    assert (found.status, found.required, found.limit) == ("pass", True, 0.4)
    assert run(slab, nozzle(0.4004))["feature"].status == "fail"
    inside = (np.array(found.at[0]) - (3, 4, 20)) @ turn
    assert (inside > 0).all() and (inside < [20, 15, 0.4]).all()


def test_a_wall_of_nine_tenths_of_the_nozzle_is_rejected_with_its_place() -> None:
    wall = box((30, 10, 0), (30.36, 40, 20))
    found = run(together(box((0, 0, 0), (20, 20, 20)), wall))["feature"]
    assert found.status == "fail" and found.measured == pytest.approx(0.36, rel=1e-9)
    assert len(found.at) > 1 and all(30 < x < 30.36 for x, _, _ in found.at)


@pytest.mark.parametrize("corner", [(3.0, 5.0), (11.3, 20.7), (30.1, 17.2), (22.2, 33.3)])
def test_the_thin_floor_of_a_pocket_is_found(corner: tuple[float, float]) -> None:
    x, y = ([0.0, c, c + 3.0, 40.0] for c in corner)
    filled = np.ones((3, 3, 2))
    filled[1, 1, 1] = 0
    found = run(blocks(x, y, [0.0, 0.3, 4.0], filled))["feature"]
    assert found.measured == pytest.approx(0.3, rel=1e-9) and found.status == "fail"
    assert x[1] < found.at[0][0] < x[2] and y[1] < found.at[0][1] < y[2]


def test_edges_and_corners_are_no_walls() -> None:
    assert run(box((0, 0, 0), (10, 20, 30)))["feature"].measured == pytest.approx(10.0)
    blunt = prism([(0, 0), (10, 0), (5, 5 * np.tan(np.radians(40)))], 30)  # edges of 40°
    assert run(blunt)["feature"].measured > 29.9


def test_a_fin_that_thins_out_is_a_thin_wall() -> None:
    fin = prism([(0, 0), (0.35, 0), (0.175, 10)], 30)
    assert run(fin)["feature"].status == "fail"


def test_a_tube_is_as_thick_as_its_diameter() -> None:
    mesh = moved(Mesh(*tube(circle(200, 20.0), 1.5)), shift=(30, 30, 5))
    assert run(mesh)["feature"].measured == pytest.approx(3.0, rel=0.01)


# Gaps


def test_two_blocks_at_a_gap() -> None:
    pair = together(box((0, 0, 0), (10, 10, 10)), box((10.3681, 0, 0), (20, 10, 10)))
    found = run(pair)["gap"]
    assert found.measured == pytest.approx(0.3681, rel=1e-9) and found.status == "pass"  # 8 % off
    assert run(pair, nozzle(0.4003))["gap"].status == "fail"
    assert 10 < found.at[0][0] < 10.3681


def crossing_rods(gap: float, sides: int = 40) -> Mesh:
    """Two rods at right angles, each with an edge where they are closest."""
    t = 2 * np.pi * np.arange(sides) / sides
    corners = 2.0 * np.column_stack([np.cos(t), np.sin(t)])
    below = moved(prism(corners, 40), shift=(20, 0, 2))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return together(below, moved(prism(corners, 40), turn, (40.3, 17.7, 6 + gap)))


def test_crossing_tubes_are_measured_where_they_are_closest() -> None:
    mesh = moved(crossing_rods(0.35), SKEW, (40, 40, 40))
    found = run(mesh)["gap"]
    assert found.measured == pytest.approx(0.35, rel=1e-6) and found.status == "fail"
    place = (np.array(found.at[0]) - 40) @ SKEW
    assert place == pytest.approx([20, 17.7, 4.175], abs=0.02)
    assert run(crossing_rods(0.369))["gap"].status == "pass"


def test_a_slot_is_a_gap_and_a_crease_is_none() -> None:
    filled = np.ones((3, 3, 2))
    filled[1, 1, 1] = 0
    slot = blocks([0, 9, 9.35, 20], [0, 5, 35, 40], [0, 5, 9], filled)
    assert run(slot)["gap"].measured == pytest.approx(0.35, rel=1e-9)
    corner = blocks([0, 5, 20], [0, 10], [0, 5, 20], [[[1, 1]], [[1, 0]]])
    assert run(corner)["gap"].measured == "none"
    # a notch of 20° from above
    a = 10 * np.tan(np.radians(10))
    left = prism([(0, 0), (15, 0), (15, 2), (15 - a, 12), (0, 12)], 30)
    right = prism([(15, 0), (30, 0), (30, 12), (15 + a, 12), (15, 2)], 30)
    notch = together(left, right)
    walls = (notch.vertices[notch.faces][:, :, 0] == 15).all(axis=1)
    assert run(Mesh(notch.vertices, notch.faces[~walls]))["gap"].measured == "none"


def test_where_a_tube_enters_a_plate_there_is_a_crease_and_no_gap() -> None:
    from manifold3d import Manifold, Mesh64

    turn = Rotation.from_euler("x", 0.15).as_matrix()
    ring = moved(Mesh(*tube(circle(150, 25.0), 2.0, 24)), turn)
    ring = moved(ring, shift=(40, 40, 2.7 - ring.vertices[:, 2].min()))
    solids = [
        Manifold(Mesh64(m.vertices, m.faces.astype(np.uint64)))
        for m in (ring, box((0, 0, 0), (80, 80, 3)))
    ]
    joined = (solids[0] + solids[1]).to_mesh64()
    mesh = Mesh(
        np.asarray(joined.vert_properties)[:, :3], np.asarray(joined.tri_verts).astype(np.int64)
    )
    assert run(mesh)["gap"].measured > 1.0
    aloft = moved(ring, shift=(0, 0, 0.62))  # 0.32 mm above the plate
    assert run(together(aloft, box((0, 0, 0), (80, 80, 3))))["gap"].measured == pytest.approx(0.32)


def hairpin(apart: float, radius: float = 2.0, sides: int = 32) -> Mesh:
    """A tube that comes back beside itself, its centre lines `apart`; facets of the tube's volume."""
    bend = apart / 2
    t = np.linspace(-np.pi / 2, np.pi / 2, 25)
    cap = np.column_stack([np.cos(t), np.sin(t), np.zeros(25)]) * bend
    run_ = np.linspace(0, 20, 41)[1:-1]
    line = np.column_stack([20 - run_, np.full(39, bend), np.zeros(39)])
    points = np.concatenate([cap + [20, 0, 0], line, -cap, -line + [20, 0, 0]])
    step = 2 * np.pi / sides
    mesh = Mesh(*tube(points, radius * float(np.sqrt(step / np.sin(step))), sides))
    return moved(mesh, shift=(10, 10, 3))


def test_a_tube_that_keeps_its_clearance_passes_and_one_closer_does_not() -> None:
    assert run(hairpin(4.4))["gap"].status == "pass"
    found = run(hairpin(4.35))["gap"]
    assert found.status == "fail" and found.measured == pytest.approx(0.35, abs=0.02)


# Overhangs and supports


def leaning(angle_deg: float) -> Mesh:
    """A parallelogram whose underside overhangs by an angle; 10 mm high, 20 mm long."""
    shift = 10 * np.tan(np.radians(angle_deg))
    return prism([(0, 0), (6, 0), (6 + shift, 10), (shift, 10)], 20)


def test_the_overhang_begins_beyond_the_limit() -> None:
    assert run(leaning(45.0), BARE)["overhang"].measured == 0.0
    assert run(leaning(45.0), BARE)["overhang"].status == "pass"
    found = run(leaning(45.2), BARE)["overhang"]
    # all of the underside but what belongs to the first layer
    area = 20 * (10 - 0.201) / np.cos(np.radians(45.2)) / 100
    assert found.status == "fail" and found.measured == pytest.approx(area, rel=1e-6)
    assert run(leaning(45.2), replace(BARE, max_overhang_deg=45.2))["overhang"].status == "pass"
    assert run(leaning(45.2))["overhang"].required is False


def test_a_table_needs_a_box_of_support() -> None:
    found = run(table())
    assert found["overhang"].measured == pytest.approx(3.84, rel=1e-9)
    assert (found["overhang"].status, found["overhang"].limit) == ("pass", None)
    assert found["support_volume"].measured == pytest.approx(3.84, rel=1e-9)
    fits = replace(PRINTER, max_support_cm3=3.8400001)
    assert run(table(), fits)["support_volume"].status == "pass"
    tight = run(table(), replace(fits, max_support_cm3=3.839))["support_volume"]
    assert (tight.status, tight.required) == ("fail", True)
    assert run(table(), replace(BARE, max_support_cm3=1.0))["support_volume"].required is False


def test_support_stands_on_the_surface_below() -> None:
    plate = box((-10, -10, 0), (30, 30, 4))
    legless = moved(table(), shift=(0, 0, 0))
    found = run(together(plate, moved(legless, shift=(0, 0, 5))))["support_volume"]
    # the leg's own underside hangs 1 mm above the plate, the top 11 mm
    assert found.measured == pytest.approx((16 * 1 + 384 * 11) / 1000, rel=0.02)


def test_a_slope_off_the_grid_is_supported_within_its_error() -> None:
    found = run(moved(leaning(60.0), Rotation.from_euler("z", 0.3).as_matrix(), (10, 5, 0)))
    shift = 10 * np.tan(np.radians(60))
    assert found["support_volume"].measured == pytest.approx(shift * 10 / 2 * 20 / 1000, rel=0.02)


# Bridges, ledges, islands


@pytest.mark.parametrize("width", [3.0, 60.0])
def test_a_bridge_is_as_long_as_its_span(width: float) -> None:
    found = run(bridge(10.0, width), BARE)
    assert found["bridge"].measured == pytest.approx(10.0, abs=1e-9)
    assert found["bridge"].status == found["overhang"].status == "pass"
    assert found["islands"].measured == 0
    less = run(bridge(10.0, width), replace(BARE, max_bridge_mm=9.99))
    assert less["bridge"].status == less["overhang"].status == "fail"
    assert less["overhang"].measured == pytest.approx(10 * width / 100, rel=1e-9)
    x, y, z = less["bridge"].at[0]
    assert 9 < x < 11 and 0 < y < width and z == pytest.approx(10.0)
    assert run(bridge(10.0, width), replace(PRINTER, max_bridge_mm=1.0))["bridge"].status == "pass"


def test_a_ledge_counts_twice_and_is_no_bridge() -> None:
    ledge = blocks([0, 10, 14], [0, 20], [0, 10, 12], [[[1, 1]], [[0, 1]]])
    found = run(ledge, BARE)
    assert found["bridge"].measured == pytest.approx(8.0, abs=1e-9)
    assert found["bridge"].status == "pass" and found["overhang"].status == "fail"
    assert run(ledge, replace(BARE, max_bridge_mm=7.9))["bridge"].status == "fail"


def test_a_slope_that_holds_itself_is_no_long_ledge() -> None:
    assert run(leaning(45.0), BARE)["bridge"].measured <= 1.0


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


def test_a_body_one_layer_up_still_lies_on_the_bed() -> None:
    ground = box((0, 0, 0), (10, 10, 5))
    for height, count in ((0.2, 0), (0.203, 1)):
        found = run(together(ground, box((20, 0, height), (30, 10, 5))), BARE)
        assert (found["floating"].measured, found["islands"].measured) == (count, count)
        assert found["floating"].status == ("fail" if count else "pass")
    assert run(box((0, 0, 3), (5, 5, 5)))["floating"].status == "pass"  # with supports


# Standing


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


def test_nothing_on_the_bed_does_not_stand() -> None:
    assert run(box((0, 0, 3), (5, 5, 5)), stands=True)["standing"].status == "fail"


# All together


def test_a_quarter_turn_changes_nothing_beyond_the_grid() -> None:
    mesh = together(bridge(12.0, 7.3), moved(table(), shift=(0, 20, 0)))
    one, two = run(mesh, BARE), run(quarter(mesh), BARE)
    for name in NAMES:
        a, b = one[name].measured, two[name].measured
        assert a == pytest.approx(b, rel=0.02, abs=1e-9), name


def test_no_printer_measures_against_nothing() -> None:
    found = run(box((0, 0, 0), (10, 10, 0.2)), None)
    assert tuple(found) == NAMES
    assert all(c.status == "pass" and not c.required for c in found.values())
    assert all("no printer was named" in c.detail for n, c in found.items() if n != "standing")
    assert run(box((0, 0, 0), (10, 10, 0.2)), Printer("other", None))["feature"].limit is None


def test_what_cannot_be_measured_is_skipped_with_the_reason() -> None:
    mesh = box((0, 0, 0), (1, 1, 1))
    checks = printability_checks(mesh, PRINTER, seconds={}, lacking="the mesh is open")
    assert [(c.name, c.status, c.detail) for c in checks] == [
        (name, "skipped", "the mesh is open") for name in NAMES
    ]
    huge = run(box((0, 0, 0), (1e6, 1, 1)))
    assert {c.status for c in huge.values()} == {"skipped"}


def test_the_time_of_each_group_is_told() -> None:
    seconds: dict[str, float] = {}
    printability_checks(box((0, 0, 0), (5, 5, 5)), PRINTER, seconds=seconds)
    assert set(seconds) == {"feature", "gap", "overhang", "bridges", "standing"}
