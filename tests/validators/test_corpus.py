"""The corpus: broken parts are rejected where they are broken, good ones are not, limits hold exactly."""

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from tables import some
from validator_parts import PlainView

from knotfab_formats import verdict as names
from knotfab_formats.piece import Printer, Region
from knotfab_validators import Check, validate
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.surface_checks import check_mesh
from knotfab_validators.part_checks import part_checks
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.tube.clearance import check_clearance
from knotfab_validators.tube.region import check_build_volume, check_region
from knotfab_validators.tube.solid_matter import strand_faces
from knotfab_validators.tube.thickness import check_bend, check_length, check_thickness
from knotfab_validators.tube.tube_fit import check_tube
from tests.corpus.broken import broken, broken_parts
from tests.corpus.broken_print import arch, slab, slot
from tests.corpus.case import READ, Broken, Good, make_part, with_scene
from tests.corpus.curves import circle
from tests.corpus.files import write
from tests.corpus.good import good
from tests.corpus.judge import judge_case
from tests.corpus.parts import Body, blocks, box, join, tube


def _number(check: Check) -> float:
    assert isinstance(check.measured, float)
    return check.measured


RING = circle()
CURVES = Curves((RING,), ("unknot",), (True,), 3.0)
PART = make_part(RING)
assert PART.body is not None
MESH = Mesh(PART.body.vertices, PART.body.faces)
LAID = Curves(PART.knots, ("unknot",), (True,), 3.0)
LENGTH = 96 * 60.0 * float(np.sin(np.pi / 96))
# a regular polygon's, but for the rounding of its corners, which is above the tolerance
BEND = _number(check_bend(CURVES, None))
assert abs(BEND / (30.0 * np.cos(np.pi / 96)) - 1) < 1e-9
NO_SUPPORTS = Printer(name="any", nozzle_mm=0.4, supports=False)
LAYER = NO_SUPPORTS.layer_height_mm
GAP = 0.08  # a share of the nozzle: a gap of 0.9 nozzles must be seen


def _find_check(name: str, checks: list[Check]) -> Check:
    (found,) = (c for c in checks if c.name == name)
    return found


def _print_check(
    name: str, body: Body, printer: Printer = NO_SUPPORTS, stands: bool = False
) -> Check:
    mesh = _mesh(body)
    return _find_check(name, printability_checks(mesh, printer, seconds={}, stands=stands))


def _mesh(body: Body) -> Mesh:
    return Mesh(body.vertices, body.faces)


def _shrunk_box(beyond: float) -> Check:
    return check_region(Region(size_mm=(66.0 - 2 * beyond, 70.0, 9.0)), None, CURVES)


def _smaller_printer(beyond: float) -> Check:
    x, y, z = MESH.vertices.max(axis=0)
    return check_build_volume(MESH, (float(x) - beyond, float(y) + 1, float(z) + 1))


def _tube_of(radius: float) -> Check:
    """The ring's tube with corners exactly at `radius`, against the knot's 3 mm."""
    widened = np.sqrt(2 * np.pi / 24 / np.sin(2 * np.pi / 24))
    body = make_part(RING, radius / widened).body
    assert body is not None
    laid = body.move(PART.knots[0].mean(axis=0) - body.vertices.mean(axis=0))
    return check_tube(Mesh(laid.vertices, laid.faces), LAID)


def _volume(factor: float) -> Check:
    """The part's volume is `factor` times what its curves say."""
    corner = MESH.vertices[MESH.faces]
    volume = np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    radius = float(np.sqrt(volume / factor / (np.pi * LENGTH)))
    return _find_check("mesh_volume", check_mesh(MESH, replace(LAID, radius_mm=radius)))


def _boxes_apart(required: float) -> Check:
    """Two boxes half a millimetre apart, coordinates up to 20 mm."""
    body = join(box((0, 0, 0), (10, 10, 10)), box((10.5, 0, 0), (20, 10, 10)))
    return check_clearance(_mesh(body), None, required)


def _coarse_strands(beyond: float) -> Check:
    """Strands of eight sides, whose corners stand out of the exact tube by 5 % of its radius."""
    part = make_part([circle(), circle() + np.array([67.0, 0.0, 0.0])], sides=8)
    assert part.body is not None
    mesh, knots = Mesh(part.body.vertices, part.body.faces), part.knots
    curves = Curves(knots, ("unknot",) * 2, (True,) * 2, 3.0)
    rounding = 1e-6 * float(np.abs(mesh.vertices).max())
    gap = _number(check_clearance(mesh, curves, 0.5))
    return check_clearance(mesh, curves, gap + rounding + beyond)


def _leaning(slope: float) -> Body:
    """A box of which one side leans outwards: the z of its normal is -`slope`."""
    body = box((10, 10, 0), (20, 20, 10))
    top = body.vertices[:, 2] > 5
    by = np.array([10 * slope / np.sqrt(1 - slope**2), 0.0, 0.0])
    return Body(body.vertices + np.where(top[:, None], by, 0.0), body.faces)


def _ledge(height: float) -> Body:
    """A block with a ledge that begins at a height."""
    cells = np.ones((2, 1, 2), dtype=bool)
    cells[1, :, 0] = False
    return blocks(cells, (2.0, 12.0, 16.0), (2.0, 12.0), (0.0, height, 10.0))


def _arm(reach: float) -> Body:
    """A post with an arm: its middle of mass is over the edge of its foot at a reach of 16 mm."""
    cells = np.ones((2, 1, 2), dtype=bool)
    cells[1, :, 0] = False
    return blocks(cells, (2.0, 10.0, 10.0 + reach), (2.0, 12.0), (0.0, 21.0, 28.0))


# the verdict of a check on a part that is beyond its limit by so many of its tolerances
TOLERATED: dict[str, Callable[[float], Check]] = {
    "thickness": lambda f: check_thickness(CURVES, BEND / (1 - 1e-12 * f)),
    "bend": lambda f: check_bend(CURVES, BEND / (1 - 1e-12 * f)),
    "length": lambda f: check_length(CURVES, LENGTH / (1 + 1e-12 * f)),
    "region": lambda f: _shrunk_box(1e-6 * f),
    "build_volume": lambda f: _smaller_printer(1e-3 * f),
    "tube": lambda f: _tube_of(3.0 * (1 + 0.04 * f)),
    "clearance": lambda f: _boxes_apart(0.5 + 20e-6 * f),
    "clearance of facets": lambda f: _coarse_strands(2 * 0.0235 * 3.0 * f),
    "mesh_volume, too much": lambda f: _volume(1 + 0.005 * f),
    "mesh_volume, too little": lambda f: _volume(1 - 0.005 * f),
    "feature": lambda f: _print_check("feature", slab(0.4 - 1e-4 * f)),
    "gap": lambda f: _print_check("gap", slot(0.4 * (1 - GAP * f))),
    "overhang": lambda f: _print_check("overhang", _leaning(np.sqrt(0.5) + 1e-5 * f)),
    "standing": lambda f: _print_check("standing", _arm(16 + 3e-6 * f), stands=True),
}
# the same, and nothing is rounded: by exactly one tolerance is not beyond
EXACT: dict[str, Callable[[float], Check]] = {
    "overhang off the bed": lambda f: _print_check("overhang", _ledge(LAYER + 1e-3 * f)),
    "support off the bed": lambda f: _print_check("support_volume", _ledge(LAYER + 1e-3 * f),
     NO_SUPPORTS.model_copy(update={"supports": True, "max_support_cm3": 0.0})),
    "floating": lambda f: _print_check("floating", box((2, 2, LAYER + 1e-3 * f), (9, 9, 9))),
    "standing in the air": lambda f: _print_check("standing", box((2, 2, LAYER + 1e-3 * f), (9, 9, 9)),
     stands=True),
}  # fmt: skip


@pytest.mark.parametrize("name", [*TOLERATED, *EXACT])
def test_a_limit_holds_to_half_a_percent_of_its_tolerance(name: str) -> None:
    twin = {**TOLERATED, **EXACT}[name]
    assert twin(0.0).status == "pass"
    assert twin(0.995).status == "pass", twin(0.995)
    assert twin(1.005).status == "fail", twin(1.005)
    assert twin(1.005).required
    if name in EXACT:
        assert twin(1.0).status == "pass"


def test_a_body_without_a_volume_is_turned_neither_way() -> None:
    flat = box((0, 0, 0), (10, 10, 0))
    check = _find_check("mesh_volume", check_mesh(Mesh(flat.vertices, flat.faces)))
    assert check.status == "fail" and check.required


@pytest.mark.parametrize(
    ("name", "body", "limited", "stricter"),
    [
        (
            "support_volume",
            arch(9.0),
            lambda x: NO_SUPPORTS.model_copy(update={"supports": True, "max_support_cm3": x}),
            0.99,
        ),
        ("bridge", arch(9.0), lambda x: NO_SUPPORTS.model_copy(update={"max_bridge_mm": x}), 0.99),
        ("feature", slab(0.9), lambda x: NO_SUPPORTS.model_copy(update={"nozzle_mm": x}), 1.01),
    ],
)
def test_a_printers_limit_may_be_met_exactly(
    name: str, body: Body, limited: Callable[[float], Printer], stricter: float
) -> None:
    value = _number(_print_check(name, body))
    assert value > 0
    assert _print_check(name, body, limited(value)).status == "pass"
    beyond = _print_check(name, body, limited(stricter * value))
    assert beyond.status == "fail" and beyond.required


@pytest.mark.parametrize(("degrees", "seen"), [(29.5, True), (30.5, False)])
def test_sides_within_30_degrees_are_a_wall(degrees: float, seen: bool) -> None:
    """A wedge with its edge upwards, 20 mm long: its sides or its ends are what is measured."""
    body = box((0, 0, 0), (20, 20, 20))
    top = body.vertices[:, 2] > 10
    half = 20 * np.tan(np.radians(degrees / 2))
    y = np.where(body.vertices[:, 1] > 10, half + 0.01, -half - 0.01)
    y = np.where(top, np.sign(y) * 0.01, y)
    vertices = np.column_stack([body.vertices[:, 0], y, body.vertices[:, 2]])
    measured = _number(_print_check("feature", Body(vertices, body.faces)))
    assert measured < 8 if seen else measured > 10


@pytest.mark.parametrize(("size", "measured"), [(10_000.0, True), (10_000.5, False)])
def test_a_part_of_ten_metres_is_measured(size: float, measured: bool) -> None:
    check = _print_check("overhang", box((0, 0, 0), (size, 5, 5)))
    assert (check.status != "skipped") == measured


@pytest.mark.parametrize(("holes", "status"), [(4, "fail"), (5, "pass"), (6, "fail")])
def test_a_wall_plate_has_two_holes_for_screws(holes: int, status: str) -> None:
    """Three pegs between one knot and its plate make three loops."""
    cells = np.ones((2 * holes + 1, 3, 1), dtype=bool)
    cells[1::2, 1, 0] = False
    body = blocks(cells, [4.0 * i for i in range(2 * holes + 2)], (0, 4, 8, 12), (0, 4))
    scene = parse_scene({"mount": {"kind": "wall", "foot": "plate", "pegs": [3]}})
    checks = part_checks(_mesh(body), LAID, scene, {})
    assert _find_check("mesh_genus", checks).status == status


@pytest.mark.parametrize(("radii", "own"), [(1.015, True), (1.025, False)])
def test_what_stands_out_by_a_fiftieth_is_no_facet_of_a_tube(radii: float, own: bool) -> None:
    curve = circle(30.0, 400)
    widened = np.sqrt(2 * np.pi / 16 / np.sin(2 * np.pi / 16))
    body = tube(curve, 3.0 * radii / widened, 16)
    finer = Curves((circle(30.0, 4000),), ("unknot",), (True,), 3.0)
    found = strand_faces(_mesh(body), finer)
    assert found.all() if own else not found.any()


@pytest.mark.parametrize(("above_mm", "seen"), [(1.99e-2, False), (2.01e-2, True)])
def test_what_lies_on_the_receiver_casts_no_shadow(above_mm: float, seen: bool) -> None:
    geometry = view_geometry(PlainView(), 64, 64)
    plate = box((-40, -40, -110), (40, 40, above_mm - 100))
    lines = shadow_lines(plate.vertices, plate.faces, geometry)
    assert shadow_mask(lines, geometry).any() == seen


def test_a_frame_without_a_size_is_180_mm_wide() -> None:
    view = parse_scene({"views": [{}]}).views[0]
    assert view.frame_width_mm is None and view.frame_height_mm is None
    geometry = view_geometry(view, 60, 30)
    assert np.linalg.norm(geometry.du) * 60 == pytest.approx(180.0)
    assert np.linalg.norm(geometry.dv) * 30 == pytest.approx(90.0)


@pytest.fixture(scope="module")
def seen() -> VerifiedView:
    """A ring's shadow, whose picture lacks a corner."""
    part = with_scene(PART)
    assert part.scene is not None
    (keys,) = part.scene["views"]
    view = PlainView(**{f.name: keys[f.name] for f in fields(PlainView) if f.name in keys})
    (picture,) = part.pictures.values()
    lacking = picture.copy()
    lacking[:100, :100] = False
    pose = np.array(part.scene["pose"]["matrix"])
    return verify_view(
        MESH.vertices + pose[:3, 3],
        MESH.faces,
        lacking,
        view_geometry(view, *picture.shape[::-1]),
        polygons=[PART.knots[0] + pose[:3, 3]],
        radius=3.0,
    )


def _judge(name: str, seen: VerifiedView, floor: float = 0.0, px: float = 9.0) -> Check:
    checks = shadow_checks(
        {"front": seen},
        MESH.vertices,
        iou_floor=floor,
        max_outline_px=px,
        no_rendering="left out",
        polygons_decide=True,
        mount="wall",
    )
    return _find_check(name, checks)


def test_a_shadow_may_be_exactly_as_good_as_asked(seen: VerifiedView) -> None:
    iou, off = seen.whole.iou, seen.outline_px
    assert 0.5 < iou < 1 and off is not None and off > 0
    assert _judge("shadow", seen, floor=iou).status == "pass"
    assert _judge("shadow", seen, floor=float(np.nextafter(iou, 1))).status == "fail"
    assert _judge("outline", seen, px=off).status == "pass"
    assert _judge("outline", seen, px=float(np.nextafter(off, 0))).status == "fail"


def test_a_mount_may_darken_a_thousandth_of_the_frame(seen: VerifiedView) -> None:
    for share, status in ((0.001, "pass"), (0.000995, "pass"), (0.001005, "fail")):
        assert _judge("intrusion", replace(seen, intrusion=share)).status == status


BROKEN, GOOD = broken_parts(), good()


def of_each_check(cases: list[Broken]) -> Iterator[object]:
    """The first case of each check, every fourth as a study; test_threemf reads files made by hand."""
    seen: set[str] = set()
    for number, case in enumerate(cases):
        first = case.meant not in seen
        seen.add(case.meant)
        if first or number % 4 == 0:
            yield pytest.param(
                case, id=f"{case.meant}: {case.name}", marks=[] if first else [pytest.mark.study]
            )


def list_others(meant: str) -> list[str]:
    """All checks but this one, which rejects the part alone; none where the files are to be refused.

    The surface is measured for printability all the same: of a broken one that would be skipped.
    """
    groups = (names.SHADOWS, names.MESH, names.TUBE, names.KNOTS, names.PRINTING)
    others = [n for group in groups for n in group if meant not in (n, READ)]
    return ["shadow-render", *others]


@pytest.mark.slow
@pytest.mark.parametrize("case", list(of_each_check(BROKEN)))
def test_a_broken_part_is_rejected_where_it_is_broken(case: Broken, tmp_path: Path) -> None:
    row = judge_case(case, tmp_path, list_others(case.meant))
    assert row.right, row.said
    assert row.placed is not False, (row.away_mm, row.within_mm, row.said)


@pytest.mark.slow
@pytest.mark.parametrize("case", some(GOOD[::4], 4), ids=lambda case: case.name)
def test_a_good_part_is_not_rejected(case: Good, tmp_path: Path) -> None:
    row = judge_case(case, tmp_path)
    assert row.right, row.said


@pytest.mark.slow
def test_the_corpus_is_as_large_as_promised() -> None:
    assert len(broken()) >= 200 and len(GOOD) >= 100
    assert sum(case.meant != READ for case in BROKEN) >= 140


@pytest.mark.slow
def test_every_required_check_has_a_part_that_it_must_reject(tmp_path: Path) -> None:
    """`shadow_exact` compares two pictures that we draw: a file cannot make them differ."""
    asked: set[str] = set()
    for mount, supports, only in (
        ("none", True, "geometry"),
        ("wall", False, None),
        ("stand", True, "geometry"),
    ):
        printer = {"supports": supports, "max_support_cm3": 100.0}
        part = with_scene(make_part(circle()), printer=printer, mount={"kind": mount})
        files = write(part, tmp_path)
        given = files.part, files.knots, files.scene
        checks = validate(*given, skip=["shadow-render"], only=only).checks
        asked |= {c.name for c in checks if c.required} - {"shadow_exact"}
    assert asked <= {case.meant for case in BROKEN}
