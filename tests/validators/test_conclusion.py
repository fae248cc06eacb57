"""The one line that concludes, and what is asked about a part's unit."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from validator_parts import circle, trefoil, tube

from knotfab.base.pool import Workers
from knotfab.pipeline.verifier import Files, Verifier
from knotfab_formats.errors import plain
from knotfab_formats.verdict import Check, knot_in_words
from knotfab_validators.check import at_least, at_most, skip_check
from knotfab_validators.conclusion import MARK, PANEL_PX, ask_unit, conclude, draw_failures
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.validate import validate
from tests.corpus.files import encode
from tests.corpus.parts import Body

CURVE = trefoil(120, 16.0)
TUBE = Mesh(*tube(CURVE, 3.0, 24))
KNOTS = Curves((CURVE,), ("3_1",), (True,), 3.0)
KIND = Check("knot_type", "pass", True, "left-handed 3_1, proved", None, "", "")


def test_a_tube_is_told_with_its_radius_its_knot_and_its_size() -> None:
    said = conclude([KIND], TUBE, KNOTS)
    assert said.startswith(
        "One closed tube, 3 mm radius, a left-handed trefoil; every required check"
    )
    assert said.endswith(" mm.") and said.count(" × ") == 2
    two = replace(KNOTS, polygons=(CURVE, CURVE + 100), types=("", ""), closed=(True, True))
    unknots = [replace(KIND, measured="unknot, proved")]
    assert conclude(unknots, None, two).startswith(
        "Two closed curves, 3 mm radius, each an unknot;"
    )


MEASURED = {
    "no knot": (", no knot;", 1.0, []),
    "not a knot of the table (determinant 35)": (", not a knot of the table (", 1.0, []),
    "unknot, proved": (", each an unknot, linked with each other;", 1.0, ["linked"]),
    "left-handed 3_1, proved": ("Is the file in another unit?", 1e-3, []),
}


@pytest.mark.parametrize("measured", MEASURED)
def test_the_headline_hides_nothing(measured: str) -> None:
    words, scale, linked = MEASURED[measured]
    curves, checks = KNOTS, [replace(KIND, measured=measured)]
    if linked:
        curves = replace(KNOTS, polygons=(CURVE,) * 2, types=("", ""), closed=(True, True))
        checks.append(Check("linking", "fail", True, 1.0, 0.0, "", ""))
    mesh = Mesh(TUBE.vertices * scale, TUBE.faces)
    said = conclude(checks, mesh, curves)
    assert words in said and " a no" not in said


LOWERED = {  # name, status, required, limit; what is said of it
    "a floor that asks nothing": (("shadow", "pass", True, 0.01), "no more than an IoU of 0.01"),
    "a usual floor": (("shadow", "pass", True, 0.95), ""),
    "no floor": (("shadow", "pass", False, None), ""),
    "accepted and known": (("recognisable", "pass", False, None), "accepts any shadow"),
    "accepted, unknown": (("recognisable", "fail", False, None), "this one is not recognisable"),
    "asked for": (("recognisable", "pass", True, None), ""),
    "without knots": (("recognisable", "skipped", False, None), ""),
}


@pytest.mark.parametrize("kind", LOWERED)
def test_a_scene_that_asks_for_little_is_told(kind: str) -> None:
    (name, status, required, limit), words = LOWERED[kind]
    check = Check(name, status, required, 0.5, limit, "", "")  # type: ignore[arg-type]
    said = conclude([check], None, KNOTS)
    assert words in said and ("the scene" in said) == bool(words)


def test_what_failed_is_named_where_it_is_asked_for() -> None:
    checks = [
        at_least("tube", 1.0, 2.0, "mm", ""),
        at_least("gap", 1.0, 2.0, "mm", "", required=False),
        skip_check("shadow", "", required=True),
        skip_check("region", ""),
    ]
    said = conclude(checks, None, KNOTS)
    assert "1 required check failed: tube; 1 required check could not run: shadow." in said


def test_other_parts_are_told_as_such() -> None:
    bodies = Check("mesh_bodies", "pass", False, 2, None, "", "")
    lines = Check("centre_line", "fail", False, "no tube", None, "", "no closed tube: a ball")
    assert conclude([bodies, lines], None, None).startswith("Two bodies, no closed tube;")
    assert conclude([], None, None).startswith("No closed tube;")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("left-handed 3_1", "left-handed trefoil"),
        ("4_1, unknot", "figure-eight knot, unknot"),
        ("13_1", "13_1"),
        ("3_1#m3_1", "3_1#m3_1"),
    ],
)
def test_knots_that_have_a_word_are_told_by_it(name: str, words: str) -> None:
    assert knot_in_words(name) == words


@pytest.mark.parametrize(("scale", "asked"), [(1e-3, "--unit m"), (1.0, ""), (100.0, "than mm")])
def test_a_part_too_small_or_too_large_is_asked_for_its_unit(scale: float, asked: str) -> None:
    question = ask_unit(Mesh(scale * TUBE.vertices, TUBE.faces), "part.stl")
    assert (question is None) == (not asked)
    assert asked in (question or "")


@pytest.mark.slow
def test_a_part_in_metres_is_measured_in_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(encode(Body(1e-3 * TUBE.vertices, TUBE.faces), "stl"))
    found = validate(path, unit="m")
    assert found.size_mm == pytest.approx(np.ptp(TUBE.vertices, axis=0), rel=1e-4)
    assert "2.98 mm radius, a left-handed trefoil;" in found.conclusion
    assert found.to_dict()["notes"] == [] and validate(path).notes != ()
    with Verifier() as verifier:
        told = verifier.submit(Files(path), unit="m").result()
    assert told.conclusion == found.conclusion


# The picture of what failed: drawn when something required failed, marked where the checks say.


RING = circle(60, 20.0)
MESH = Mesh(*tube(RING, 3.0, 24))


def fail_at(at: tuple[float, float, float] = (23.0, 0.0, 0.0), *, required: bool = True) -> Check:
    return at_most("hole", 3, 0, "edges", "an open edge", required=required, at=[at])


def size(path: Path) -> tuple[int, int]:
    with Image.open(path) as sheet:
        return sheet.size


def red(path: Path) -> np.ndarray:
    """(n, 2) pixels (u, v) of the marks, above the sentences."""
    with Image.open(path) as opened:
        sheet = np.asarray(opened.convert("RGB"))[: PANEL_PX + 14]
    rows, columns = np.nonzero((sheet == MARK).all(axis=2))
    return np.column_stack([columns, rows])


def test_nothing_is_drawn_unless_something_required_failed(tmp_path: Path) -> None:
    path = tmp_path / "f.png"
    passed = at_most("hole", 0, 0, "edges", "")
    assert not draw_failures(path, [passed, fail_at(required=False)], MESH, None)
    assert not draw_failures(path, [fail_at()], None, None)
    assert not path.exists()


@pytest.mark.slow
def test_the_marks_lie_where_the_place_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "f.png"
    assert draw_failures(path, [fail_at()], MESH, None)
    marks = red(path)
    # from above +x is on the right; from the front too; from the right it is in the middle
    scale, pitch = (PANEL_PX - 48) / 46.0, PANEL_PX + 14
    for panel, x in enumerate((23.0, 23.0, 0.0)):
        u = 14 + panel * pitch + PANEL_PX / 2 + x * scale
        ring = np.hypot(marks[:, 0] - u, marks[:, 1] - (14 + PANEL_PX / 2))
        assert np.count_nonzero(np.abs(ring - 6.5) < 1.5) > 20, panel
    far = tmp_path / "far.png"
    assert draw_failures(far, [fail_at((1e9, 0, 0))], MESH, None)  # at the edge, not outside
    assert len(red(far)) > 50


@pytest.mark.slow
def test_meshes_that_are_broken_and_curves_alone_are_drawn_too(tmp_path: Path) -> None:
    broken = Mesh(MESH.vertices.copy(), np.vstack([MESH.faces[::7], [[0, 0, 0]]]))
    broken.vertices[5] = np.nan
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    curves = Curves((RING,), ("unknot",), (True,), 3.0)
    for number, (mesh, lines) in enumerate([(broken, None), (flat, None), (None, curves)]):
        path = tmp_path / f"{number}.png"
        assert draw_failures(path, [fail_at()], mesh, lines)
        assert size(path)[0] > 3 * PANEL_PX


@pytest.mark.slow
def test_every_failure_has_its_sentence(tmp_path: Path) -> None:
    few, many = tmp_path / "few.png", tmp_path / "many.png"
    draw_failures(few, [fail_at()], MESH, None)
    draw_failures(many, [fail_at(), fail_at((0, 23, 0)), fail_at((0, 0, 3))], MESH, None)
    assert size(many)[1] == size(few)[1] + 2 * 19


# Checks pass on the right side of their limit, and never on NaN.


@pytest.mark.parametrize(
    ("measured", "limit", "low", "high"),
    [
        (1.0, 2.0, "fail", "pass"), (2.0, 2.0, "pass", "pass"), (3.0, 2.0, "pass", "fail"),
        (math.nan, 2.0, "fail", "fail"), (1.0, math.nan, "fail", "fail"), (1.0, None, "pass", "pass"),
        (math.nan, None, "fail", "fail"),
    ],
)  # fmt: skip
def test_a_limit_is_kept_or_not(measured: float, limit: float | None, low: str, high: str) -> None:
    assert at_least("x", measured, limit, "mm", "").status == low
    assert at_most("x", measured, limit, "mm", "").status == high


def test_a_tolerance_is_no_part_of_the_limit() -> None:
    check = at_most("x", 1.0005, 1.0, "mm", "", tolerance=1e-3)
    assert check.status == "pass" and check.limit == 1.0
    assert at_most("x", 1.002, 1.0, "mm", "", tolerance=1e-3).status == "fail"
    assert at_least("x", 0.998, 1.0, "mm", "", tolerance=1e-3).status == "fail"


def test_a_check_is_plain_data() -> None:
    check = at_least("x", 1, 2, "mm", "why", required=False, at=[(0, 1, 2)])
    assert json.loads(json.dumps(plain(check))) == {
        "name": "x",
        "status": "fail",
        "required": False,
        "measured": 1.0,
        "limit": 2.0,
        "unit": "mm",
        "detail": "why",
        "at": [[0.0, 1.0, 2.0]],
    }
    assert not skip_check("x", "nothing to measure").required


# What the worker of the validators answers: verdicts.


EMPTY = {k: None for k in ("part", "knots", "scene", "pictures_dir", "failures")} | {"skip": []}


@pytest.fixture(scope="module")
def validators() -> Iterator[Workers]:
    with Workers("knotfab_validators.service", "geometry") as workers:
        yield workers


@pytest.mark.slow
def test_verdicts_are_validates_and_a_bad_file_is_one_sentence(
    validators: Workers, tmp_path: Path
) -> None:
    asked = [("pass", 0, 3.0), ("fail", 1, 41.0)]
    for status, _, radius in asked:
        knot = {"closed": True, "type": "unknot", "points": circle(90, 40.0).tolist()}
        content = {"schema": 1, "unit": "mm", "radius_mm": radius, "knots": [knot]}
        (tmp_path / f"{status}.json").write_text(json.dumps(content))
    (tmp_path / "part.stl").write_bytes(b"no mesh")
    files = [{"knots": str(tmp_path / f"{status}.json")} for status, *_ in asked]
    files += [{"part": str(tmp_path / "part.stl")}, {"knots": str(tmp_path / "absent.json")}]
    *found, part, absent = (validators.answer({**EMPTY, **named}) for named in files)
    for (status, code, _), verdict in zip(asked, found, strict=True):
        assert (verdict["status"], verdict["exit_code"]) == (status, code)
        here = json.loads(json.dumps(validate(None, tmp_path / f"{status}.json").to_dict()))
        assert verdict["checks"] == here["checks"] and verdict["views"] == here["views"] == []
        assert all(value >= 0 for value in verdict["seconds"].values())
    assert "part.stl" in part["error"] and "absent.json" in absent["error"]
