"""The tube inside the region, the part inside the printer: exact excess, on both sides of 0."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from manifold3d import Manifold
from validator_parts import CURVE, KNOT, Array, box_mesh, prism, tube

from knotfab.geometry.tube import as_manifold
from knotfab_formats.bounds import Matrix
from knotfab_formats.piece import Region
from knotfab_formats.verdict import Check
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_knots
from knotfab_validators.geometry.curves import Curves, Slab
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.mount_members import Asked, check_mount
from knotfab_validators.tube.region import check_build_volume, check_region, measure_excess


@pytest.mark.parametrize(
    ("kind", "size", "excess"),
    [
        ("box", (86.0, 86.0, 6.0), 0.0), ("box", (90.0, 90.0, 8.0), -1.0),
        ("box", (90.0, 84.0, 8.0), 1.0), ("box", (90.0, 90.0, 5.0), 0.5),
        ("sphere", (84.0, 84.0, 84.0), 1.0), ("sphere", (90.0, 90.0, 90.0), -2.0),
        ("cylinder", (90.0, 80.0, 90.0), 3.0), ("cylinder", (80.0, 90.0, 80.0), 3.0),
        ("cylinder", (90.0, 90.0, 90.0), -2.0),
    ],
)  # fmt: skip
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
        ((0.0, 0.0, 0.0), "pass"), ((4.0, 4.0, 4.0), "pass"), ((-0.0005, 0.0, 0.0), "pass"),
        ((-0.01, 0.0, 0.0), "fail"), ((0.0, 0.0, -20.0), "fail"), ((0.0, 14.01, 0.0), "fail"),
        ((0.0, 14.00098, 0.0), "pass"), ((0.0, 14.00102, 0.0), "fail"), ((14.1, 0.0, 0.0), "fail"),
        ((0.0, 0.0, -0.1), "fail"), ((0.0, 0.0, 44.0), "pass"), ((0.0, 0.0, 44.1), "fail"),
        ((np.nan, 0.0, 0.0), "fail"),
    ],
)  # fmt: skip
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


# How far tubes and parts stick out of a region that is a mesh.


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
        # on the curve, in the part's coordinates
        assert np.linalg.norm(place) == pytest.approx(40.0)
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


# A plate in which a piece stands is full of matter: forged plates are told.


RADIUS, THICK, SIDE = 1.5, 1.6, 50.0
CORNERS = 0.5 * SIDE * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
HOLES = np.array([[-20.0, 0, 0], [20.0, 0, 0]])
FEET = 4


ON_FEET = Asked(on_feet=True, plate_mm=(4.0, THICK))


def crown(feet: int = FEET) -> Array:
    """A ring that goes up and down: its valleys are sunk by half a radius below z = 0."""
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    height = RADIUS / 2 + 10 * (1 - np.cos(feet * t))
    return np.column_stack([14 * np.cos(t), 14 * np.sin(t), height])


PLATE = Slab(CORNERS, HOLES, 4.0, THICK, np.array([0.0, 0.0, 1.0]))
CURVES = Curves((crown(),), ("unknot",), (True,), RADIUS, plate=PLATE)


@cache
def honest() -> Manifold:
    solid = Manifold.cube((SIDE, SIDE, THICK)).translate((-SIDE / 2, -SIDE / 2, -THICK))
    for hole in HOLES:
        solid -= Manifold.cylinder(9.0, 2.0, 2.0, 64, True).translate(hole)
    return solid + as_manifold(tube(crown(), RADIUS, 24))


def as_mesh(solid: Manifold) -> Mesh:
    found = solid.to_mesh()
    vertices = np.asarray(found.vert_properties, dtype=np.float64)
    return Mesh(vertices, np.asarray(found.tri_verts, dtype=np.int64))


def box(x: float, y: float, z: float, wide: float, high: float) -> Manifold:
    return Manifold.cube((wide, wide, high), True).translate((x, y, z))


def wall(long: float, wide: float, high: float, x: float = 0.0, y: float = 0.0) -> Manifold:
    return Manifold.cube((long, wide, high), True).translate((x, y, 0))


def test_an_honest_plate_passes_wherever_it_lies() -> None:
    assert check_mount(as_mesh(honest()), CURVES, ON_FEET).status == "pass"
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([3.0, -7.0, 11.0])
    moved = honest().transform(np.column_stack([turn, shift]))
    plate = Slab(CORNERS @ turn.T + shift, HOLES @ turn.T + shift, 4.0, THICK, turn[:, 2])
    curves = replace(CURVES, polygons=(crown() @ turn.T + shift,), plate=plate)
    assert check_mount(as_mesh(moved), curves, ON_FEET).status == "pass"
    grown, asked = as_mesh(honest()), replace(ON_FEET, plate_mm=(5.0, 1.25 * THICK))
    grown = Mesh(1.25 * grown.vertices, grown.faces)
    assert check_mount(grown, CURVES.scaled(1.25), asked).status == "pass"


SLOT = np.array([[-3.0, 19, 0], [3, 19, 0], [3, 23, 0], [-3, 23, 0]])


@pytest.mark.parametrize(("listed", "status"), [((SLOT,), "pass"), ((), "fail")])
def test_an_opening_is_listed(listed: tuple[Array, ...], status: str) -> None:
    curves = replace(CURVES, plate=replace(PLATE, openings=listed))
    assert check_mount(as_mesh(honest() - wall(6, 4, 9, y=21)), curves, ON_FEET).status == status


@pytest.mark.parametrize(
    ("taped", "holes", "status"), [(True, 0, "pass"), (False, 0, "fail"), (True, 1, "fail")]
)
def test_only_a_taped_plate_does_without_holes(taped: bool, holes: int, status: str) -> None:
    solid = Manifold.cube((SIDE, SIDE, THICK)).translate((-SIDE / 2, -SIDE / 2, -THICK))
    for hole in HOLES[:holes]:
        solid -= Manifold.cylinder(9.0, 2.0, 2.0, 64, True).translate(hole)
    curves = replace(CURVES, plate=replace(PLATE, holes=HOLES[:holes]))
    mesh = as_mesh(solid + as_manifold(tube(crown(), RADIUS, 24)))
    assert check_mount(mesh, curves, replace(ON_FEET, taped=taped)).status == status


@pytest.mark.parametrize(
    ("what", "forged"),
    [
        ("a void", lambda s: s - box(10, 10, -0.8, 3, 0.6)),
        ("a flat void", lambda s: s - box(10, 10, -0.8, 3, 0.05)),
        ("a slit from side to side", lambda s: s - wall(0.1, 99, 9, x=5)),
        ("a hole that nobody listed", lambda s: s - wall(4, 4, 9, y=20)),
        ("a thinner plate", lambda s: s - box(0, 0, -THICK, 99, 0.8)),
        ("a sunken face", lambda s: s - box(0, 0, -0.1, 99, 0.4) ^ box(0, 0, 0, 99, 99)),
        ("a corner that is missing", lambda s: s - box(25, 25, 0, 20, 9)),
        ("no plate", lambda s: s.trim_by_plane((0.0, 0.0, 1.0), 0.0)),
        ("a bar between strands", lambda s: s + wall(28, 2, 2).rotate((0, 0, 45)).translate((0, 0, 20.75))),
    ],
)  # fmt: skip
def test_a_forged_plate_is_told(what: str, forged) -> None:  # type: ignore[no-untyped-def]
    found = check_mount(as_mesh(forged(honest())), CURVES, ON_FEET)
    assert found.status == "fail" and found.required, what


def test_a_plate_that_the_scene_asks_for_must_be_in_the_file_of_the_knots() -> None:
    bare = replace(CURVES, plate=None)
    assert check_mount(as_mesh(honest()), bare, ON_FEET).status == "fail"


def test_a_plate_is_read_from_the_file_and_bad_ones_are_refused() -> None:
    plate = {
        "outline": CORNERS.tolist(), "holes": HOLES.tolist(), "hole_mm": 4.0, "thickness_mm": THICK,
        "out": [0, 0, 1],
    }  # fmt: skip
    knots = [{"points": crown().tolist()}]
    read = parse_knots({"schema": 1, "radius_mm": RADIUS, "knots": knots, "plate": plate}).plate
    assert read is not None and read.outline == pytest.approx(CORNERS)
    for key, bad in (
        ("out", [0, 0, 2]), ("out", [1, 0, 0]), ("outline", [[0, 0, 0]]), ("thickness_mm", 0),
        ("holes", "none"),
    ):  # fmt: skip
        with pytest.raises(BadFile, match="plate"):
            parse_knots({"schema": 1, "knots": knots, "plate": {**plate, key: bad}})
