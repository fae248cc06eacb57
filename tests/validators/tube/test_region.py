"""The tube inside the region, the part inside the printer: exact excess, on both sides of 0."""

from __future__ import annotations

import numpy as np
import pytest
from region_meshes import CURVE, KNOT
from validator_parts import tube

from knotfab_formats.piece import Region
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.region import check_build_volume, check_region, measure_excess


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
    check = check_region(Region(kind=kind, size_mm=size), None, KNOT)
    assert check.detail.startswith(f"how far the tube sticks out of the {kind}")
    assert check.measured == pytest.approx(excess, abs=1e-9)
    assert check.status == ("fail" if excess > 0 else "pass")
    assert check.required and check.unit == "mm"


def test_the_middle_counts_and_so_does_the_pose() -> None:
    moved = Curves((CURVE[:, [2, 0, 1]] + [5.0, 6.0, 7.0],), ("unknot",), (True,), 3.0)
    region = Region(center_mm=(10.0, 20.0, 30.0), size_mm=(87.0, 87.0, 7.0))
    pose = ((0.0, 1, 0, 10 - 6.0), (0, 0, 1, 20 - 7.0), (1, 0, 0, 30 - 5.0), (0, 0, 0, 1.0))
    assert check_region(region, pose, moved).measured == pytest.approx(-0.5)
    assert check_region(region, None, moved).status == "fail"
    # the place is named in the coordinates of the part
    place = np.array(check_region(region, pose, moved).at[0])
    assert np.abs(moved.polygons[0] - place).sum(axis=1).min() < 1e-9


def test_a_mesh_is_measured_where_no_radius_is_known() -> None:
    mesh = Mesh(*tube(CURVE, 3.0, 64))
    bare = Curves((CURVE,), ("unknot",), (True,), None)
    region = Region(size_mm=(85.0, 87.0, 7.0))
    assert check_region(region, None, bare, mesh).measured == pytest.approx(0.5, abs=1e-2)
    assert check_region(region, None, None, mesh).status == "fail"
    assert check_region(region, None, bare).status == "skipped"


def test_an_open_size_cannot_be_checked() -> None:
    region = Region()
    assert check_region(region, None, KNOT).status == "skipped"
    with pytest.raises(ValueError, match="left open"):
        measure_excess(CURVE, region)


def test_the_detail_names_the_place_that_sticks_out() -> None:
    points = CURVE.copy()
    points[7] = [12.0, 34.0, 56.0]
    check = check_region(
        Region(size_mm=(100.0, 100.0, 100.0)), None, Curves((points,), ("unknot",), (True,), 3.0)
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
        ((0.0, 14.00098, 0.0), "pass"),
        ((0.0, 14.00102, 0.0), "fail"),
        ((14.1, 0.0, 0.0), "fail"),
        ((0.0, 0.0, -0.1), "fail"),
        ((0.0, 0.0, 44.0), "pass"),
        ((0.0, 0.0, 44.1), "fail"),
        ((np.nan, 0.0, 0.0), "fail"),
    ],
)
def test_the_part_lies_on_the_printers_bed(shift: tuple[float, ...], status: str) -> None:
    vertices = np.array([[0.0, 0, 0], [86, 0, 0], [0, 86, 0], [0, 0, 6]]) + shift
    mesh = Mesh(vertices, np.array([[0, 1, 2]]))
    check = check_build_volume(mesh, (100.0, 100.0, 50.0))
    assert check.status == status and check.required
    if status == "fail" and np.isfinite(shift).all():
        out = np.array(check.at[0])
        assert check.measured == pytest.approx(max((out - [100, 100, 50]).max(), -out.min()))


# --- a closed mesh as the region -------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere"])
def test_a_region_may_be_turned_as_a_view_is(kind: str) -> None:
    rng = np.random.default_rng(0)
    azimuth, elevation = 30.0, 40.0
    a, e = np.radians([azimuth, elevation])
    ahead = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    right = np.array([np.cos(a), 0.0, -np.sin(a)])
    axes = np.stack([right, np.cross(ahead, right), ahead])
    points, middle = 60 * rng.normal(size=(50, 3)), (5.0, -3.0, 8.0)
    size = (90.0, 70.0, 40.0)
    plain = measure_excess(points, Region(kind=kind, size_mm=size), 2.0)
    turned = Region(
        kind=kind, center_mm=middle, size_mm=size, azimuth_deg=azimuth, elevation_deg=elevation
    )
    assert measure_excess(points @ axes + middle, turned, 2.0) == pytest.approx(plain, abs=1e-9)
