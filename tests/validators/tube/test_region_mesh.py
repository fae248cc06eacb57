"""How far tubes and parts stick out of a region that is a mesh."""

import numpy as np
import pytest
from region_meshes import CURVE, box_mesh, prism

from knotfab_formats.bounds import Matrix
from knotfab_formats.piece import Region
from knotfab_formats.verdict import Check
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.region import check_region

Room = tuple[Region, Mesh | None]


def room(mesh: Mesh, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Room:
    return Region(kind="mesh", file="room.stl", center_mm=center), mesh


def check_in(
    room: Room, pose: Matrix | None, curves: Curves | None, part: Mesh | None = None
) -> Check:
    return check_region(room[0], pose, curves, part, room[1])


REGIONS = {
    "box": lambda out: (Region(kind="box", size_mm=(86.0 - 2 * out, 100.0, 10.0)), None),
    "cylinder": lambda out: (Region(kind="cylinder", size_mm=(100.0, 86.0 - 2 * out, 100.0)), None),
    "sphere": lambda out: (Region(kind="sphere", size_mm=(86.0 - 2 * out,) * 3), None),
    "mesh": lambda out: room(box_mesh((86.0 - 2 * out, 100.0, 10.0))),
}


SHIFT = ((1.0, 0, 0, -7.0), (0, 1.0, 0, -8.0), (0, 0, 1.0, -9.0), (0, 0, 0, 1.0))


@pytest.mark.parametrize("kind", REGIONS)
def test_a_strand_a_tenth_outside_is_refused_with_its_place(kind: str) -> None:
    part = Curves((CURVE + [7.0, 8.0, 9.0],), ("unknot",), (True,), 3.0)
    for out, status in ((0.1, "fail"), (2e-6, "fail"), (0.0, "pass"), (-0.1, "pass")):
        check = check_in(REGIONS[kind](out), SHIFT, part)
        assert check.measured == pytest.approx(out, abs=1e-9)
        assert check.status == status and check.required
        place = np.array(check.at[0]) - [7.0, 8.0, 9.0]
        assert np.linalg.norm(place) == pytest.approx(
            40.0
        )  # on the curve, in the part's coordinates
        assert kind == "sphere" or np.abs(place).max() == pytest.approx(40.0, abs=1e-6)


def test_a_wall_that_pokes_in_between_two_vertices_is_found() -> None:
    square = np.array([[-20.0, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]])
    knot = Curves((square,), ("unknot",), (True,), 3.0)

    def wedge(tip: float) -> Room:  # its edge stands at (0, tip), far from every vertex
        corners = [
            (0.0, tip), (-9.0, 60.0), (-60.0, 60.0), (-60.0, -60.0), (60.0, -60.0), (60.0, 60.0),
        ]  # fmt: skip
        return room(prism(*corners, (9.0, 60.0)))

    for tip, excess in ((23.5, -0.5), (23.0, 0.0), (22.9, 0.1), (20.5, 2.5)):
        check = check_in(wedge(tip), None, knot)
        assert check.measured == pytest.approx(excess, abs=1e-9)
        assert check.status == ("fail" if excess > 0 else "pass")
        assert np.array(check.at[0])[:2] == pytest.approx([0.0, 20.0], abs=1e-6)
    through = check_in(wedge(10.0), None, knot)  # the line itself leaves the room
    assert through.status == "fail" and isinstance(through.measured, float)
    assert through.measured > 3.0 and np.abs(np.array(through.at[0]) - [0, 20, 0]).max() < 2


def test_the_mesh_is_moved_by_the_middle() -> None:
    knot = Curves((CURVE + [1.0, 2.0, 3.0],), ("unknot",), (True,), 3.0)
    mesh = box_mesh((87.0, 87.0, 7.0))
    assert check_in(room(mesh, (1.0, 2.0, 3.0)), None, knot).measured == pytest.approx(-0.5)
    assert check_in(room(mesh), None, knot).measured == pytest.approx(2.5)


def test_a_knot_wholly_outside_is_measured_by_its_farthest_point() -> None:
    knot = Curves((CURVE + [200.0, 0, 0],), ("unknot",), (True,), 3.0)
    check = check_in(room(box_mesh((86.0, 86.0, 10.0))), None, knot)
    assert check.measured == pytest.approx(240 - 43 + 3)


def test_a_part_without_tube_is_held_against_the_mesh() -> None:
    part = Mesh(box_mesh((20.0, 20.0, 20.0)).vertices + [0, 0, 10.0], box_mesh((1, 1, 1)).faces)
    standing = room(prism((-50, -50), (50, -50), (50, 50), (-50, 50), low=0.0, high=40.0))
    assert check_in(standing, None, None, part).status == "pass"  # its base on the floor
    lower = Mesh(part.vertices - [0, 0, 0.1], part.faces)
    check = check_in(standing, None, None, lower)
    assert check.status == "fail" and check.measured == pytest.approx(0.1)
    assert check.at[0][2] == pytest.approx(-0.1)
    ridge = room(
        prism((0, 9.0), (-9, 60), (-60, 60), (-60, -60), (60, -60), (60, 60), (9, 60), low=-5)
    )
    assert check_in(ridge, None, None, part).measured == pytest.approx(
        np.sin(np.arctan(9 / 51)), abs=1e-6
    )
