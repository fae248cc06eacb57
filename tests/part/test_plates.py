"""Pieces on several plates: cuts, pins and holes, poses, and the checks that read the files again."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold, Mesh64

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import Mesh, mesh_volume, sweep
from knotfab.knots import Knot, Knots
from knotfab.part.cut import (
    CLEARANCE_MM,
    DEEPER_MM,
    KERF_MM,
    Cut,
    CutPiece,
    Line,
    cut_body,
    find_cuts,
)
from knotfab.part.files import write_3mf
from knotfab.part.plates import APART_MM, Plates, Printable, lay_on_plates
from knotfab.part.pose import PrintPose, choose_pose
from knotfab_formats.piece import Printer
from knotfab_validators.check import BadFile
from knotfab_validators.files.mesh import Plate, read_plates
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.mesh import Mesh as Surface
from knotfab_validators.geometry.mesh import merge_equal
from knotfab_validators.printing.plates import check_plates, check_plates_printable

RADIUS = 3.0
SIDES = 32
ROOM = (100.0, 90.0, 80.0)


def track(long: float = 120.0, wide: float = 60.0, step: float = 3.0) -> Array:
    """A racetrack: two straights `long`, joined by half circles; seen from above, in the plane z = 0."""
    r = wide / 2
    n = int(long / step)
    x = np.linspace(-long / 2, long / 2, n, endpoint=False)
    m = int(np.pi * r / step)
    t = np.pi * np.arange(m) / m
    bend = np.column_stack([long / 2 + r * np.sin(t), -r * np.cos(t)])
    half = np.concatenate([np.column_stack([x, np.full(n, -r)]), bend])
    flat = np.concatenate([half, -half])
    return np.column_stack([flat, np.zeros(len(flat))])


def line_of(points: Array, radius: float = RADIUS) -> Line:
    n = len(points)
    return Line(
        points,
        radius,
        np.ones(n),
        np.zeros(n, dtype=np.bool_),
        np.empty((0, 3)),
        np.empty(0, dtype=np.int64),
    )


def tube(points: Array, radius: float = RADIUS) -> Mesh:
    return sweep(points, radius, SIDES)


def solid(mesh: Mesh) -> Manifold:
    return Manifold(Mesh64(mesh[0], mesh[1].astype(np.uint64)))


def cut_track() -> tuple[list[Cut], list[CutPiece]]:
    points = track()
    cuts = find_cuts(line_of(points), ROOM, 0.4, "knot 1")
    return cuts, cut_body(tube(points), points, RADIUS, 0.4, cuts)


def laid_out(
    curves: list[Array], room: tuple[float, float, float] = ROOM, rules: Rules | None = None
) -> tuple[Plates, PrintPose]:
    tubes = [tube(c) for c in curves]
    knots = Knots(tuple(Knot(c) for c in curves), RADIUS)
    whole = choose_pose(knots, tubes, (1e6, 1e6, 1e6))
    parts = [
        Printable(f"knot {k + 1}", body, line_of(c))
        for k, (body, c) in enumerate(zip(tubes, curves, strict=True))
    ]
    return lay_on_plates(parts, whole, room, 0.4, 0.4, rules or Rules()), whole


# --- cuts ---


def test_cuts_are_few_and_where_the_tube_is_straight() -> None:
    cuts, _ = cut_track()
    assert len(cuts) == 2  # 186 mm long, and no more than 100 fit
    for cut in cuts:
        assert abs(cut.point[0]) < 60 and abs(abs(cut.point[1]) - 30) < 1e-9
        assert abs(cut.along[0]) == pytest.approx(1)
        assert cut.pin_radius == pytest.approx(0.5 * RADIUS)
        assert cut.pin_length == pytest.approx(2 * RADIUS)


def test_a_place_on_the_outline_or_at_a_peg_is_left_alone() -> None:
    line = line_of(track())
    shown = line.points[:, 1] < 0
    half = replace(line, hidden=np.where(shown, 0.0, 1.0))
    barred = replace(line, barred=np.asarray(line.points[:, 0] < 0))
    cuts = find_cuts(barred, (160.0, 160.0, 160.0), 0.4, "knot 1")
    assert all(cut.point[0] >= 0 for cut in cuts)
    # one cut must be on each side, but the better places win where they may
    tall = find_cuts(half, (160.0, 70.0, 80.0), 0.4, "knot 1")
    assert sum(cut.point[1] > 0 for cut in tall) >= len(tall) / 2


def test_a_tube_too_thin_for_a_pin_is_refused_with_the_numbers() -> None:
    thin = line_of(track(), 0.7)
    with pytest.raises(SceneError, match=r"pin of 0\.48 mm with 0\.56 mm .* tube of 1\.40 mm"):
        find_cuts(thin, ROOM, 0.4, "knot 1")


def test_a_printer_too_small_for_the_shortest_piece_is_refused() -> None:
    with pytest.raises(SceneError, match="pieces that do not fit either"):
        find_cuts(line_of(track()), (12.0, 12.0, 12.0), 0.4, "knot 1")


def test_what_hangs_on_a_piece_counts() -> None:
    """A peg of 70 mm to each side of the tube's first vertex: its piece needs a taller printer."""
    line = line_of(track())
    ends = line.points[0] + np.array([[0, 0, 70.0], [0, 70.0, 0.0], [70.0, 0.0, 0.0]])
    hung = replace(line, beside=ends, beside_of=np.zeros(3, dtype=np.int64))
    with pytest.raises(SceneError):
        find_cuts(hung, (60.0, 60.0, 60.0), 0.4, "knot 1")
    find_cuts(line, (60.0, 60.0, 60.0), 0.4, "knot 1")


# --- pieces ---


def test_pieces_are_balls_and_lose_only_kerf_and_clearance() -> None:
    cuts, pieces = cut_track()
    whole = mesh_volume(*tube(track()))
    pin, long = cuts[0].pin_radius, cuts[0].pin_length
    section = SIDES / 2 * np.sin(2 * np.pi / SIDES)  # the area of a unit circle's polygon
    wide = (pin + CLEARANCE_MM) / np.cos(np.pi / SIDES)
    chamfer = 0.3 * pin
    tip = section * chamfer / 3 * (pin**2 + pin * (pin - chamfer) + (pin - chamfer) ** 2)
    pin_volume = section * pin**2 * (long - chamfer) + tip
    lost = section * wide**2 * (long + DEEPER_MM) - pin_volume + np.pi * RADIUS**2 * KERF_MM
    left = sum(mesh_volume(*p.mesh) for p in pieces)
    assert whole - left == pytest.approx(2 * lost, rel=0.02)
    for piece in pieces:
        body = solid(piece.mesh)
        assert body.genus() == 0 and len(body.decompose()) == 1


def test_the_pin_goes_into_its_hole_with_the_stated_clearance() -> None:
    cuts, pieces = cut_track()
    bodies = [solid(p.mesh) for p in pieces]
    assert (bodies[0] ^ bodies[1]).volume() == 0.0
    # moved across by less than the clearance they still do not touch, by a little more they do
    up = np.array([0.0, 0.0, 1.0])
    near, far = 0.98 * CLEARANCE_MM, 1.1 * CLEARANCE_MM
    assert (bodies[0].translate(near * up) ^ bodies[1]).volume() == 0.0
    assert (bodies[0].translate(far * up) ^ bodies[1]).volume() > 0.0
    # drawn apart by more than the pins' length they are free of each other
    assert cuts[0].side in (-1, 1)
    away = bodies[0].bounding_box()[0] < bodies[1].bounding_box()[0]
    pull = np.array([-1.0 if away else 1.0, 0.0, 0.0]) * (cuts[0].pin_length + 0.1)
    assert (bodies[0].translate(pull) ^ bodies[1]).volume() == 0.0


def test_cuts_that_do_not_part_the_body_are_refused() -> None:
    points = track()
    cuts, _ = cut_track()
    with pytest.raises(SceneError, match="came out as"):
        cut_body(tube(points), points + [0.0, 0.0, 40.0], RADIUS, 0.4, [
            replace(c, point=c.point + np.array([0.0, 0.0, 40.0])) for c in cuts
        ])  # fmt: skip


# --- plates ---


@pytest.mark.slow
def test_every_plate_fits_and_its_bodies_lie_on_the_bed() -> None:
    rings = [track(20.0, 30.0) + [0.0, 0.0, 20.0], track(10.0, 20.0) + [0.0, 0.0, -20.0]]
    plates, _ = laid_out([track(), *rings])
    assert plates.cuts == [2, 0, 0]
    names = [name for plate in plates.plates for name in plate.names]
    assert sorted(names) == ["knot 1 piece 1", "knot 1 piece 2", "knot 2", "knot 3"]
    for plate in plates.plates:
        for vertices, _ in plate.bodies:
            assert vertices[:, 2].min() == 0.0
            assert (vertices >= 0).all() and (vertices <= np.array(ROOM) + 1e-6).all()
        boxes = [(v.min(axis=0)[:2], v.max(axis=0)[:2]) for v, _ in plate.bodies]
        for i, (low, high) in enumerate(boxes):
            for other_low, other_high in boxes[:i]:
                gap = np.maximum(low - other_high, other_low - high).max()
                assert gap >= APART_MM - 1e-3


def test_whole_knots_that_fit_alone_are_not_cut() -> None:
    near, away = track(40.0, 40.0), track(40.0, 40.0) + [0.0, 0.0, 300.0]
    plates, _ = laid_out([near, away])
    assert plates.cuts == [0, 0] and plates.pins == []
    report = plates.figures()
    assert [f.file for f in report.files] == [
        f"plate-{n + 1}.3mf" for n in range(len(plates.plates))
    ]


@pytest.mark.slow
def test_without_room_for_supports_the_whole_printer_is_used() -> None:
    """Bends too tight to be cut: their pieces, 30 mm wide, fit the bed, but not the bed less margins."""
    room, rules, points = (40.0, 36.0, 10.0), Rules(margin_mm=3.0), track(120.0, 24.0)
    with pytest.raises(SceneError, match="pieces that do not fit either"):
        find_cuts(line_of(points), (34.0, 30.0, 10.0), 0.4, "knot 1")
    plates, _ = laid_out([points], room, rules)
    assert plates.cuts[0] >= 4
    for plate in plates.plates:
        for vertices, _ in plate.bodies:
            assert (vertices >= 0).all() and (vertices <= np.array(room) + 1e-6).all()
    with pytest.raises(SceneError, match="does not fit 34 x 30 x 10 mm"):
        laid_out([points], (34.0, 30.0, 10.0), rules)


@pytest.mark.slow
def test_the_report_names_the_pins() -> None:
    plates, _ = laid_out([track()])
    report = plates.figures()
    assert report.cuts_of_knots == (2,)
    assert report.pin_diameter_mm == pytest.approx((RADIUS, RADIUS))
    assert report.pin_clearance_mm == CLEARANCE_MM
    assert all((pose.support_cm3_estimate or 0) >= 0 for pose in report.poses)


# --- the validators on the written files ---


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Surface, list[Plate], Path, str]:
    folder = tmp_path_factory.mktemp("plates")
    plates, whole = laid_out([track(), track(20.0, 30.0) + [0.0, 0.0, 20.0]])
    text = "schema = 1\n[pose]\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"
    for name, plate in zip(plates.files("-01"), plates.plates, strict=True):
        write_3mf(folder / name, plate.bodies)
        matrices = [m.tolist() for m in plate.to_part]
        text += f"[[pose.plates]]\nfile = '{name}'\nmatrices = {matrices}\n"
    part = merge_equal(np.concatenate([v[f] for v, f in whole.tubes]).astype(np.float32))
    return part, read_plates(folder, parse_scene(tomllib.loads(text))), folder, text


def checks_of(part: Surface, plates: list[Plate]) -> dict[str, tuple[str, object]]:
    return {c.name: (c.status, c.measured) for c in check_plates(part, plates, ROOM)}


@pytest.mark.slow
def test_plates_that_make_up_the_part_pass(written: tuple[Surface, list[Plate], Path, str]) -> None:
    part, plates, _, _ = written
    found = check_plates(part, plates, ROOM)
    assert [c.name for c in found] == ["build_volume", "plate_mesh", "plates", "plates_volume"]
    assert all(c.status == "pass" and c.required for c in found)
    apart, volume = found[2].measured, found[3].measured
    assert isinstance(apart, float) and apart < 0.03
    assert isinstance(volume, float) and 0 < volume < 0.01
    printer = Printer(name="own", build_volume_mm=ROOM, nozzle_mm=0.4)
    printed = check_plates_printable(plates, printer, found, {})
    assert {c.name: c.status for c in printed}["feature"] == "pass"


def move(laid: Plate, shift: float) -> Plate:
    motion = laid.to_part.copy()
    motion[0, 2, 3] += shift
    return replace(laid, to_part=motion)


@pytest.mark.slow
def test_a_body_out_of_its_place_fails(written: tuple[Surface, list[Plate], Path, str]) -> None:
    part, plates, _, _ = written
    assert checks_of(part, [move(plates[0], 0.03), *plates[1:]])["plates"][0] == "pass"
    status, apart = checks_of(part, [move(plates[0], 0.2), *plates[1:]])["plates"]
    assert status == "fail" and apart == pytest.approx(0.2, abs=0.02)


def test_a_body_that_is_missing_or_there_twice_fails(
    written: tuple[Surface, list[Plate], Path, str],
) -> None:
    part, plates, _, _ = written
    missing = checks_of(part, plates[:-1])
    assert missing["plates"][0] == "fail" and missing["plates_volume"][0] == "fail"
    twice = checks_of(part, [*plates, plates[0]])
    assert twice["plates"][0] == "pass" and twice["plates_volume"][0] == "fail"


def test_a_plate_too_large_or_with_a_hole_fails(
    written: tuple[Surface, list[Plate], Path, str],
) -> None:
    part, plates, _, _ = written
    size = float(max(p.mesh.vertices[:, 0].max() for p in plates))
    small = {c.name: c for c in check_plates(part, plates, (size - 1.0, 90.0, 80.0))}
    assert small["build_volume"].status == "fail"
    assert small["build_volume"].detail.startswith("plate-")
    mesh = plates[0].mesh
    holed = replace(plates[0], mesh=Surface(mesh.vertices, mesh.faces[1:]))
    found = check_plates(part, [holed, *plates[1:]], ROOM)
    assert {c.name: c.status for c in found}["plate_mesh"] == "fail"
    skipped = check_plates_printable(
        [holed, *plates[1:]], Printer(name="own", build_volume_mm=ROOM, nozzle_mm=0.4), found, {}
    )
    assert all(c.status == "skipped" for c in skipped)


def test_bodies_and_motions_must_agree(written: tuple[Surface, list[Plate], Path, str]) -> None:
    part, plates, folder, text = written
    fewer = [replace(plates[0], to_part=np.repeat(plates[0].to_part, 3, axis=0)), *plates[1:]]
    assert checks_of(part, fewer)["plates"][0] == "fail"
    scene = tomllib.loads(text)
    scene["pose"]["plates"].append({"matrices": [np.eye(4).tolist()]})
    with pytest.raises(BadFile, match=f"plate-{len(plates) + 1}"):
        read_plates(folder, parse_scene(scene))


@pytest.mark.parametrize(
    "plates",
    [
        3,
        [{}],
        [{"matrices": []}],
        [{"matrices": [[1, 2]]}],
        [{"matrices": [np.diag([2.0, 1, 1, 1]).tolist()]}],
        [{"file": "../plate-1.3mf", "matrices": [np.eye(4).tolist()]}],
        [{"file": 3, "matrices": [np.eye(4).tolist()]}],
    ],
)
def test_a_scene_with_impossible_plates_is_refused(plates: object) -> None:
    with pytest.raises(BadFile, match=r"plates|\[pose\] (matrices|file)"):
        parse_scene({"pose": {"matrix": np.eye(4).tolist(), "plates": plates}})
