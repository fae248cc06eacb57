"""The checks of printability together: turned, without a printer, skipped, and their times."""

import re
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solids import (
    BARE,
    PRINTER,
    blocks,
    box,
    bridge,
    inward,
    move,
    prism,
    quarter,
    run,
    table,
    together,
)
from validator_parts import circle, tangle, tube

from knotfab_formats.piece import Printer
from knotfab_formats.verdict import PRINTING
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing import local_thickness, standing
from knotfab_validators.printing.local_thickness import Probe
from knotfab_validators.printing.printability import printability_checks


def test_a_quarter_turn_changes_nothing_beyond_the_grid() -> None:
    mesh = together(bridge(12.0, 7.3), move(table(), shift=(0, 20, 0)))
    one, two = run(mesh, BARE), run(quarter(mesh), BARE)
    for name in PRINTING:
        a, b = one[name].measured, two[name].measured
        assert a == pytest.approx(b, rel=0.02, abs=1e-9), name


def test_no_printer_measures_against_nothing() -> None:
    found = run(box((0, 0, 0), (10, 10, 0.2)), None)
    assert tuple(found) == PRINTING
    assert all(c.status == "pass" and not c.required for c in found.values())
    assert all("no printer was named" in c.detail for n, c in found.items() if n != "standing")
    assert run(box((0, 0, 0), (10, 10, 0.2)), Printer(name="other"))["feature"].limit is None


def test_what_cannot_be_measured_is_skipped_with_the_reason() -> None:
    mesh = box((0, 0, 0), (1, 1, 1))
    checks = printability_checks(mesh, PRINTER, seconds={}, lacking="the mesh is open")
    assert [(c.name, c.status, c.detail) for c in checks] == [
        (name, "skipped", "the mesh is open") for name in PRINTING
    ]
    huge = run(box((0, 0, 0), (1e6, 1, 1)))
    assert {c.status for c in huge.values()} == {"skipped"}


@pytest.mark.parametrize(
    ("module", "limit", "said"),
    [
        (local_thickness, "MOST_PAIRS", "faces beside the narrowest places"),
        (standing, "MOST_BODIES", "bodies"),
        (standing, "MOST_AROUND", "pairs of a hollow and a face"),
    ],
)
def test_a_check_ends_at_its_limit_of_work_in_a_sentence(
    module: ModuleType, limit: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    near = together(box((0, 0, 0), (20, 20, 3)), box((0, 0, 3.5), (20, 20, 6.5)))
    mesh = together(near, inward(box((1, 1, 1), (19, 19, 2))))
    assert {c.status for c in run(mesh).values()} != {"skipped"}
    monkeypatch.setattr(module, limit, 1)
    found = run(mesh)
    assert tuple(found) == PRINTING
    for check in found.values():  # a printer was named: without them nothing is accepted
        assert check.status == "skipped" and check.required
        assert re.fullmatch(rf"not tested: \d+ {said}, more than 1", check.detail)
    assert not any(check.required for check in run(mesh, None).values())


def test_the_time_of_each_group_is_told() -> None:
    seconds: dict[str, float] = {}
    printability_checks(box((0, 0, 0), (5, 5, 5)), PRINTER, seconds=seconds)
    assert set(seconds) == {"feature", "gap", "overhang", "bridges", "standing"}


POWDER = Printer(name="powder", nozzle_mm=0.5, process="powder", min_wall_mm=1.0, min_gap_mm=0.6)


def test_in_powder_nothing_overhangs_but_walls_and_gaps_count() -> None:
    """A table over air, floating above the bed: powder carries it. Its walls and gaps are the process's."""
    air = move(table(), shift=(0, 0, 40))
    found = run(air, POWDER)
    assert tuple(found) == PRINTING
    asked = {name for name, check in found.items() if check.status != "skipped"}
    assert asked == {"feature", "gap"}
    assert all("powder" in c.detail for n, c in found.items() if n not in asked)
    assert run(air, BARE)["islands"].status == run(air, BARE)["floating"].status == "fail"
    thin = box((0, 0, 0), (20, 20, 0.9))
    assert run(thin, POWDER)["feature"].status == "fail"
    assert run(thin, PRINTER)["feature"].status == "pass"
    near = together(box((0, 0, 0), (20, 20, 3)), box((0, 0, 3.5), (20, 20, 6.5)))
    assert run(near, POWDER)["gap"].status == "fail"
    assert "powder must come out" in run(near, POWDER)["gap"].detail
    assert run(near, PRINTER)["gap"].status == "pass"


def test_a_stand_of_powder_still_has_to_stand() -> None:
    tower = box((0, 0, 0), (5, 5, 20))
    found = run(tower, POWDER, stands=True)
    assert found["standing"].status == "pass" and found["standing"].required
    assert found["overhang"].status == "skipped"


# Walls and gaps of solids whose thickness is known.


SKEW = Rotation.from_euler("xyz", [0.4, 0.7, -1.1]).as_matrix()


def nozzle(mm: float) -> Printer:
    return PRINTER.model_copy(update={"nozzle_mm": mm})


@pytest.mark.parametrize("turn", [np.eye(3), SKEW])
def test_a_slab_is_as_thick_as_it_is(turn: np.ndarray) -> None:
    slab = move(box((0, 0, 0), (20, 15, 0.4)), turn, (3, 4, 20))
    found = run(slab)["feature"]
    assert found.measured == pytest.approx(0.4, rel=1e-6)
    assert (found.status, found.required, found.limit) == ("pass", True, 0.4)
    assert run(slab, nozzle(0.4004))["feature"].status == "fail"
    inside = (np.array(found.at[0]) - (3, 4, 20)) @ turn
    assert (inside > 0).all() and (inside < [20, 15, 0.4]).all()


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
    mesh = move(Mesh(*tube(circle(200, 20.0), 1.5)), shift=(30, 30, 5))
    assert run(mesh)["feature"].measured == pytest.approx(3.0, rel=0.01)


def crossing_rods(gap: float, sides: int = 40) -> Mesh:
    """Two rods at right angles, each with an edge where they are closest."""
    t = 2 * np.pi * np.arange(sides) / sides
    corners = 2.0 * np.column_stack([np.cos(t), np.sin(t)])
    below = move(prism(corners, 40), shift=(20, 0, 2))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return together(below, move(prism(corners, 40), turn, (40.3, 17.7, 6 + gap)))


def test_crossing_tubes_are_measured_where_they_are_closest() -> None:
    mesh = move(crossing_rods(0.35), SKEW, (40, 40, 40))
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
    # a notch of 20° is cut from above
    a = 10 * np.tan(np.radians(10))
    left = prism([(0, 0), (15, 0), (15, 2), (15 - a, 12), (0, 12)], 30)
    right = prism([(15, 0), (30, 0), (30, 12), (15 + a, 12), (15, 2)], 30)
    notch = together(left, right)
    walls = (notch.vertices[notch.faces][:, :, 0] == 15).all(axis=1)
    assert run(Mesh(notch.vertices, notch.faces[~walls]))["gap"].measured == "none"


@pytest.mark.slow
def test_a_tube_that_enters_a_plate_makes_a_crease_and_no_gap() -> None:
    from manifold3d import Manifold, Mesh64

    turn = Rotation.from_euler("x", 0.15).as_matrix()
    ring = move(Mesh(*tube(circle(150, 25.0), 2.0, 24)), turn)
    ring = move(ring, shift=(40, 40, 2.7 - ring.vertices[:, 2].min()))
    solids = [
        Manifold(Mesh64(m.vertices, m.faces.astype(np.uint64)))
        for m in (ring, box((0, 0, 0), (80, 80, 3)))
    ]
    joined = (solids[0] + solids[1]).to_mesh64()
    mesh = Mesh(
        np.asarray(joined.vert_properties)[:, :3], np.asarray(joined.tri_verts).astype(np.int64)
    )
    assert run(mesh)["gap"].measured > 1.0
    aloft = move(ring, shift=(0, 0, 0.62))  # 0.32 mm above the plate
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
    return move(mesh, shift=(10, 10, 3))


@pytest.mark.parametrize(
    "mesh",
    [
        hairpin(4.35),
        hairpin(9.0, 1.0),
        crossing_rods(8.0),  # a gap beyond the reach of the first rays
        box((0, 0, 0), (30, 20, 9)),  # no gap
        together(hairpin(5.0), move(hairpin(7.0), shift=(0, 0, 30))),
        Mesh(*tube(tangle(300, 3, 40.0), 1.5, 16)),
    ],
)
def test_rays_of_limited_reach_find_what_those_without_end_do(mesh: Mesh) -> None:
    class Endless(Probe):
        def _cast(self, *asked: Any) -> Any:
            return super()._cast(*asked[:3])

    for found, known in zip(
        *([p.wall(), p.gap()] for p in (Probe(mesh), Endless(mesh))), strict=True
    ):
        assert found.value == known.value
        assert np.array_equal(found.widths, known.widths) and np.array_equal(found.at, known.at)


def test_a_tube_passes_at_its_clearance_and_not_closer() -> None:
    assert run(hairpin(4.4))["gap"].status == "pass"
    found = run(hairpin(4.35))["gap"]
    assert found.status == "fail" and found.measured == pytest.approx(0.35, abs=0.02)


@pytest.mark.parametrize(("proud", "status"), [(0.0, "fail"), (0.02, "fail"), (0.026, "pass")])
def test_a_gap_may_be_narrower_by_what_facets_stand_out(proud: float, status: str) -> None:
    filled = np.ones((3, 3, 2))
    filled[1, 1, 1] = 0
    slot = blocks([0, 9, 9.35, 20], [0, 5, 35, 40], [0, 5, 9], filled)
    checks = printability_checks(
        slot, PRINTER, seconds={}, proud=lambda places: np.full(len(places), proud)
    )
    assert next(c for c in checks if c.name == "gap").status == status
