"""Every member of a mount is full of matter, and nothing else joins strands: forged parts are told."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from manifold3d import Manifold
from validator_parts import Array, circle, tube

from knotfab.geometry.tube import as_manifold
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_knots
from knotfab_validators.geometry.curves import Curves, Member, Slab
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.mount_members import Asked, check_mount
from knotfab_validators.tube.solid_matter import Hole, Solid, find_hollow
from knotfab_validators.tube.tube_fit import check_tube

RADIUS, PEG, HIGH = 2.0, 1.2, 20.0  # mm; the rings lie so high above the plate's top at z = 0
RINGS = [circle(120, 30.0) + [0, 0, HIGH], circle(90, 30.0 - 2 * RADIUS - 0.4) + [0, 0, HIGH]]
UP = np.array([0.0, 0.0, 1.0])
PEGS = [
    Member(ring[k], ring[k] * [1, 1, 0], (PEG, 1.1 * PEG), UP)
    for ring, k in ((RINGS[0], 0), (RINGS[0], 60), (RINGS[1], 20))
]
STRUT = Member(RINGS[1][0], RINGS[1][45], (PEG, PEG))
CURVES = Curves(tuple(RINGS), ("unknot",) * 2, (True,) * 2, RADIUS, (*PEGS, STRUT))
COUNT = (3, 1)
PLATE = Solid(
    "plate", np.array([(x, y, z) for x in (-45, 45) for y in (-45, 45) for z in (-3, 0.0)])
)
WHOLE = Asked(COUNT, (PLATE,))
MIDDLE = (PEGS[0].start + PEGS[0].end) / 2
Made = Callable[[], Manifold]  # solids are made when they are asked for: none outlives the modeller


def bar(at: Array, along: Array, height: float, low: float, high: float) -> Manifold:
    """A cone about a line through `at`, evenly on both sides of it."""
    along = along / np.linalg.norm(along)
    u = np.cross(np.eye(3)[int(np.abs(along).argmin())], along)
    u /= np.linalg.norm(u)
    solid = Manifold.cylinder(height, low, high, 48, True)
    return solid.transform(np.column_stack([u, np.cross(along, u), along, at]))


@cache
def honest() -> Manifold:
    solid = Manifold.cube((90.0, 90.0, 3.0)).translate((-45.0, -45.0, -3.0))
    for ring in RINGS:
        solid += as_manifold(tube(ring, RADIUS, 24))
    for m in CURVES.members:
        span = m.start - m.end
        solid += bar((m.start + m.end) / 2, span, float(np.linalg.norm(span)), *m.radius_mm[::-1])
    return solid


def as_mesh(solid: Manifold) -> Mesh:
    found = solid.to_mesh()
    return Mesh(
        np.asarray(found.vert_properties, dtype=np.float64),
        np.asarray(found.tri_verts, dtype=np.int64),
    )


def neck(at: Array, along: Array, wide: float, inner: float) -> Manifold:
    return bar(at, along, 0.4, wide, wide) - bar(at, along, 1.0, inner, inner)


def test_a_whole_mount_passes_and_so_does_its_tube() -> None:
    mesh = as_mesh(honest())
    for curves in (CURVES, CURVES.scaled(1.0)):
        found = check_mount(mesh, curves, WHOLE)
        assert found.status == "pass" and found.required, found.detail
    assert check_tube(mesh, CURVES, mounted=True).status == "pass"
    shrunk = Mesh(0.98 * mesh.vertices, mesh.faces)
    smaller = Asked(COUNT, (Solid("plate", 0.98 * PLATE.corners),))
    assert check_mount(shrunk, CURVES.scaled(0.98), smaller).status == "pass"
    assert check_mount(shrunk, CURVES, WHOLE).status == "fail"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cut", "place"),
    [
        (lambda: bar(MIDDLE, UP, 0.3, 2 * PEG, 2 * PEG), MIDDLE),
        (lambda: neck(MIDDLE, UP, 2 * PEG, 0.4), MIDDLE),
        (lambda: Manifold.sphere(0.3, 24).translate(MIDDLE), MIDDLE),
        (lambda: bar(PEGS[0].end + 0.15 * UP, UP, 0.3, 2 * PEG, 2 * PEG), PEGS[0].end),
        (
            lambda: bar((STRUT.start + STRUT.end) / 2, STRUT.end - STRUT.start, 0.2, 3.0, 3.0),
            HIGH * UP,
        ),
        (
            lambda: bar(PEGS[1].end, UP, 2 * (HIGH - RADIUS), 3.0, 3.0),
            (PEGS[1].start + PEGS[1].end) / 2,
        ),
    ],
    ids=["cut", "neck", "void", "cut at its foot", "strut cut", "peg left out"],
)
def test_a_member_that_is_not_full_is_told_with_its_place(cut: Made, place: Array) -> None:
    mesh = as_mesh(honest() - cut())
    found = check_mount(mesh, CURVES, WHOLE)
    assert found.status == "fail" and found.required
    assert np.linalg.norm(found.at[0] - place) < HIGH
    assert check_tube(mesh, CURVES, mounted=True).status == "pass"


def test_fused_strands_are_told_where_a_cut_mends_the_genus() -> None:
    between = (RINGS[0][15] + RINGS[1][11]) / 2
    fused = honest() + bar(between, RINGS[0][15] - RINGS[1][11], 0.8, 0.3, 0.3)
    both = fused - bar(MIDDLE, UP, 0.3, 2 * PEG, 2 * PEG)
    assert both.genus() == honest().genus()
    for solid in (fused, both):
        for curves in (CURVES, replace(CURVES, members=())):
            found = check_mount(as_mesh(solid), curves, WHOLE)
            assert found.status == "fail" and np.linalg.norm(found.at[0] - between) < 1.0


def test_matter_from_strand_to_plate_that_is_no_member_is_told() -> None:
    solid = honest() + bar(RINGS[1][60] * [1, 1, 0.5], UP, HIGH, 0.5, 0.5)
    found = check_mount(as_mesh(solid), CURVES, WHOLE)
    assert found.status == "fail" and "touches a strand" in found.detail


def test_a_strand_cut_all_round_or_through_is_told_by_the_tube() -> None:
    at, along = RINGS[0][45], RINGS[0][46] - RINGS[0][44]
    for cut in (neck(at, along, 1.2 * RADIUS, 0.4), bar(at, along, 0.4, 2.5, 2.5)):
        hole = bar(np.array([0.0, 0.0, -1.5]), UP, 9.0, 1.0, 1.0)
        found = check_tube(as_mesh(honest() - cut - hole), CURVES, mounted=True)
        assert found.status == "fail" and np.linalg.norm(found.at[0] - at) < 2 * RADIUS


def test_members_must_be_named_counted_and_end_in_strands() -> None:
    mesh = as_mesh(honest())
    bare = replace(CURVES, members=())
    missing = check_mount(mesh, bare, WHOLE)
    assert missing.status == "fail" and missing.required and "build the part anew" in missing.detail
    unknown = check_mount(mesh, bare)
    assert unknown.status == "fail" and unknown.required
    assert check_mount(mesh, CURVES, Asked((4, 1), (PLATE,))).status == "fail"
    loose = replace(PEGS[0], start=PEGS[0].start + 5 * UP)
    found = check_mount(mesh, replace(CURVES, members=(loose, *CURVES.members[1:])), WHOLE)
    assert found.status == "fail" and "in no strand" in found.detail


def test_members_are_read_from_the_knots_and_checked() -> None:
    points = RINGS[0].tolist()
    knots = {"schema": 1, "radius_mm": 2.0, "knots": [{"points": points}]}
    member = {"from": [0, 0, 0], "to": [0, 0, -5], "radius_mm": [1, 1.2], "foot": [0, 0, 1]}
    (read,) = parse_knots({**knots, "members": [member]}).members
    assert read.radius_mm == (1.0, 1.2) and read.foot is not None
    for change in (
        {"from": [0, 0]},
        {"to": [0, 0, 0]},
        {"to": [0, 0, 1e9]},
        {"radius_mm": [0, 1]},
        {"radius_mm": 1},
        {"foot": [0, 0, 2]},
        {"foot": "up"},
    ):
        with pytest.raises(BadFile, match="members: number 0"):
            parse_knots({**knots, "members": [{**member, **change}]})
    for wrong in (5, [5], {"from": [0, 0, 0]}):
        with pytest.raises(BadFile, match="members"):
            parse_knots({**knots, "members": wrong})


def hollowed(cut: Manifold) -> Manifold:
    return honest() - cut


@pytest.mark.parametrize(
    "cut",
    [
        lambda: Manifold.cylinder(2.2, 2.0, 2.0, 24).translate((30.0, 0.0, -2.8)),
        lambda: Manifold.cube((0.4, 200.0, 2.5), True).translate((10.0, 0.0, -1.0)),
        lambda: Manifold.cube((0.4, 200.0, 20.0), True).translate((10.0, 0.0, 0.0)),
        lambda: Manifold.cube((200.0, 1.0, 2.0), True).translate((0.0, 10.0, -3.0)),
        lambda: Manifold.cube((20.0, 200.0, 20.0), True).translate((45.0, 0.0, 0.0)),
        lambda: Manifold.cylinder(20.0, 1.0, 1.0, 24, True),
    ],
    ids=["void under a peg", "slit", "sawn", "groove behind", "edge sawn off", "hole"],
)
def test_a_plate_that_is_not_full_is_told(cut: Made) -> None:
    assert find_hollow(as_mesh(honest()), PLATE) is None
    found = check_mount(as_mesh(hollowed(cut())), CURVES, WHOLE)
    assert found.status == "fail" and found.required


@pytest.mark.parametrize(
    ("curves", "asked", "said"),
    [
        (replace(CURVES, members=()), WHOLE, "names no members"),
        (replace(CURVES, members=()), Asked(), "names no members"),
        (CURVES, Asked(COUNT, hulls=("base", 3.0)), "names no base"),
        (CURVES, Asked(COUNT, threads=UP[None]), "names no rods"),
        (
            replace(CURVES, hulls=(("base", PLATE.corners),)),
            Asked(COUNT, hulls=("base", 4.0)),
            "thick",
        ),
        (
            replace(CURVES, hulls=(("base", PLATE.corners + 200.0),)),
            Asked(COUNT, hulls=("base", 3.0)),
            "stands on no",
        ),
    ],
)
def test_what_is_left_out_of_a_mount_is_told(curves: Curves, asked: Asked, said: str) -> None:
    found = check_mount(as_mesh(honest()), curves, asked)
    assert found.status == "fail" and found.required and said in found.detail


@pytest.mark.parametrize(
    "matter",
    [
        lambda: Manifold.cylinder(6.0, 1.0, 1.0, 24).translate((12.0, 0.0, -0.1)),
        lambda: (
            Manifold.cube((9.0, 1.0, 3.5), True).rotate((0, 0, 45.0)).translate((0.0, 0.0, 1.7))
        ),
        lambda: Manifold.cube((0.4, 6.0, 3.0), True).translate(MIDDLE + [0, 3.0, 0]),
        lambda: bar(MIDDLE, UP, 1.0, PEG + 1.0, PEG + 1.0),
        lambda: Manifold.cube((6.0, 6.0, 6.0)).translate((44.9, 0.0, -3.0)),
        lambda: Manifold.cube((4.0, 4.0, 4.0)).translate((60.0, 0.0, -3.0)),
    ],
    ids=["post", "letter", "flag on a peg", "collar", "block at the edge", "block beside"],
)
def test_matter_that_belongs_to_nothing_is_told(matter: Made) -> None:
    found = check_mount(as_mesh(honest() + matter()), CURVES, WHOLE)
    assert found.status == "fail" and "neither strand nor plate" in found.detail


@pytest.mark.parametrize(
    ("plug", "told"),
    [
        (None, False),
        (lambda: Manifold.cylinder(3.0, 2.0, 2.0, 64) - Manifold.cylinder(3.0, 0.5, 0.5, 64), True),
        (lambda: Manifold.cylinder(0.3, 2.0, 2.0, 64).translate((0, 0, 1.2)), True),
        (lambda: Manifold.cylinder(3.0, 2.1, 2.1, 64), True),
        (lambda: Manifold.cube((0.4, 5.0, 1.0), True).translate((0, 0, 2.0)), True),
        (
            lambda: Manifold.cylinder(3.0, 2.2, 2.2, 64) - Manifold.cylinder(3.0, 1.95, 1.95, 64),
            False,
        ),
    ],
    ids=["open", "narrowed", "a skin", "filled", "a bar across", "a film of paint"],
)
def test_a_screw_hole_is_open_all_through(plug: Made | None, told: bool) -> None:
    solid = honest() - Manifold.cylinder(9.0, 2.0, 2.0, 64, True).translate((20.0, 5.0, -1.5))
    solid = solid if plug is None else solid + plug().translate((20.0, 5.0, -3.0))
    opening = Solid(
        "hole", np.array([(x, y, z) for x in (17, 23) for y in (2, 8) for z in (-4, 1)])
    )
    plate = replace(PLATE, openings=(opening.hull,))
    hole = Hole(np.array([20.0, 5.0, 0.0]), UP, 2.0, 3.0)
    found = check_mount(as_mesh(solid), CURVES, Asked(COUNT, (plate,), holes=(hole,)))
    assert ("screw hole of 4 mm" in found.detail) == told and (found.status == "fail") == told


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"holes": np.empty((0, 3))}, "lists 0 holes"),
        ({"hole_mm": 1.0}, "holes of 1 mm"),
        ({"thickness_mm": 2.0}, "2 mm thick"),
    ],
)
def test_a_plates_listing_is_the_scenes(change: dict[str, object], said: str) -> None:
    outline = np.array([(-45.0, -45, 0), (45, -45, 0), (45, 45, 0), (-45, 45, 0)])
    plate = Slab(outline, np.array([[20.0, 5, 0], [-20, 5, 0]]), 4.0, 3.0, UP)
    curves = replace(CURVES, members=(), plate=replace(plate, **change))  # type: ignore[arg-type]
    found = check_mount(as_mesh(honest()), curves, Asked(on_feet=True, plate_mm=(4.0, 3.0)))
    assert found.status == "fail" and said in found.detail


@pytest.mark.parametrize("corners", [8, 200, 2000])
def test_points_lie_in_a_solid_by_all_planes_of_its_hull(corners: int) -> None:
    rng = np.random.default_rng(corners)
    solid = Solid("a base", rng.normal(size=(corners, 3)) * [30.0, 20.0, 4.0])
    points = rng.normal(size=(5000, 3)) * [30.0, 20.0, 4.0]
    near = solid.corners + rng.normal(0, 0.05, (corners, 3))
    for asked in (points, near, solid.corners):
        assert (solid.covers(asked) == (solid.hull.depth(asked) >= -0.035)).all()
    assert solid.covers(points).mean() > 0.1 and solid.covers(solid.corners).all()
