"""A plate in which a piece stands is full of matter: forged plates are told."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from manifold3d import Manifold
from validator_parts import Array, tube

from knotfab.geometry.tube import as_manifold
from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import parse_knots
from knotfab_validators.geometry.curves import Curves, Slab
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube.mount_members import Asked, check_mount

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
