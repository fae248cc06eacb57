"""The tube inside the region, the part inside the printer: exact excess, on both sides of 0."""

from __future__ import annotations

import numpy as np
import pytest
from validator_parts import circle, tube

from knotfab_validators.read_knots import Curves
from knotfab_validators.read_mesh import Mesh
from knotfab_validators.read_scene import Region
from knotfab_validators.region import check_build_volume, check_region, sticks_out

CURVE = circle(360, 40.0)  # in the plane z = 0
KNOT = Curves((CURVE,), ("unknot",), (True,), 3.0)


@pytest.mark.parametrize(
    ("kind", "size", "excess"),
    [
        ("box", (86.0, 86.0, 6.0), 0.0),
        ("box", (90.0, 90.0, 8.0), -1.0),
        ("box", (90.0, 84.0, 8.0), 1.0),
        ("box", (90.0, 90.0, 5.0), 0.5),
        ("sphere", (84.0, 84.0, 84.0), 1.0),
        ("sphere", (90.0, 90.0, 90.0), -2.0),
        ("cylinder", (90.0, 80.0, 90.0), 3.0),
        ("cylinder", (80.0, 90.0, 80.0), 3.0),
        ("cylinder", (90.0, 90.0, 90.0), -2.0),
    ],
)
def test_the_excess_is_exact(kind: str, size: tuple[float, float, float], excess: float) -> None:
    check = check_region(Region(kind, (0.0, 0.0, 0.0), size), None, KNOT)
    assert check.measured == pytest.approx(excess, abs=1e-9)
    assert check.status == ("fail" if excess > 0 else "pass")
    assert check.required and check.unit == "mm"


def test_the_middle_counts_and_so_does_the_pose() -> None:
    moved = Curves((CURVE[:, [2, 0, 1]] + [5.0, 6.0, 7.0],), ("unknot",), (True,), 3.0)
    region = Region("box", (10.0, 20.0, 30.0), (87.0, 87.0, 7.0))
    pose = ((0.0, 1, 0, 10 - 6.0), (0, 0, 1, 20 - 7.0), (1, 0, 0, 30 - 5.0), (0, 0, 0, 1.0))
    assert check_region(region, pose, moved).measured == pytest.approx(-0.5)
    assert check_region(region, None, moved).status == "fail"


def test_a_mesh_is_measured_where_no_radius_is_known() -> None:
    mesh = Mesh(*tube(CURVE, 3.0, 64))
    bare = Curves((CURVE,), ("unknot",), (True,), None)
    region = Region("box", (0.0, 0.0, 0.0), (85.0, 87.0, 7.0))
    assert check_region(region, None, bare, mesh).measured == pytest.approx(0.5, abs=1e-2)
    assert check_region(region, None, None, mesh).status == "fail"
    assert check_region(region, None, bare).status == "skipped"


def test_an_open_size_cannot_be_checked() -> None:
    region = Region("box", (0.0, 0.0, 0.0), None)
    assert check_region(region, None, KNOT).status == "skipped"
    with pytest.raises(ValueError, match="left open"):
        sticks_out(CURVE, region)


def test_the_detail_names_the_place_that_sticks_out() -> None:
    points = CURVE.copy()
    points[7] = [12.0, 34.0, 56.0]
    check = check_region(
        Region("box", (0.0, 0.0, 0.0), (100.0, 100.0, 100.0)),
        None,
        Curves((points,), ("unknot",), (True,), 3.0),
    )
    assert check.measured == pytest.approx(9.0) and "(12.00, 34.00, 56.00)" in check.detail


@pytest.mark.parametrize(
    ("shift", "status"),
    [
        ((0.0, 0.0, 0.0), "pass"),
        ((4.0, 4.0, 4.0), "pass"),
        ((-0.0005, 0.0, 0.0), "pass"),
        ((-0.01, 0.0, 0.0), "fail"),
        ((0.0, 0.0, -20.0), "fail"),
        ((0.0, 14.01, 0.0), "fail"),
        ((np.nan, 0.0, 0.0), "fail"),
    ],
)
def test_the_part_lies_on_the_printers_bed(shift: tuple[float, ...], status: str) -> None:
    vertices = np.array([[0.0, 0, 0], [86, 0, 0], [0, 86, 0], [0, 0, 6]]) + shift
    mesh = Mesh(vertices, np.array([[0, 1, 2]]))
    check = check_build_volume(mesh, (100.0, 100.0, 50.0))
    assert check.status == status and check.required
