"""The driver on written files: right ones pass, also shrunk; each wrong one fails the check that it must."""

import json
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from PIL import Image
from validator_parts import Array, PlainView, circle, needs_rendering, trefoil, tube

from knotfab.picture.raster import encode_mask
from knotfab_formats.libraries import list_parts, recording, took_part
from knotfab_formats.verdict import KNOTS, Verdict
from knotfab_validators.check import BadFile, skip_check
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.scene import read_knots
from knotfab_validators.service import run_beside
from knotfab_validators.shadows import part_shadows
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.validate import validate
from tests.corpus.files import encode
from tests.corpus.parts import Body

pytestmark = pytest.mark.slow  # each draws and measures a whole part

PIXELS = (900, 780)
VIEW = PlainView(frame_width_mm=150.0, frame_height_mm=130.0, wall_tilt_deg=15.0, azimuth_deg=30.0)
RADIUS = 3.0
OFF = 'penumbra = "off"\nmisplacement = "off"\n'
POSE = np.array([[0.0, 1, 0, -70], [0, 0, 1, -60], [1, 0, 0, -65], [0, 0, 0, 1]])


def to_part(points: Array) -> Array:
    return (points - POSE[:3, 3]) @ POSE[:3, :3]


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A part, its knots, its scene, and as its picture the shadow that it casts."""
    tmp_path = tmp_path_factory.mktemp("right")
    curve = trefoil(240, 16.0)
    vertices, faces = tube(curve, RADIUS, 48)
    (tmp_path / "part.stl").write_bytes(encode(Body(to_part(vertices), faces), "stl"))
    (tmp_path / "part.3mf").write_bytes(encode(Body(to_part(vertices), faces), "3mf"))
    knots = [{"closed": True, "type": "3_1", "points": to_part(curve).tolist()}]
    (tmp_path / "knots.json").write_text(
        json.dumps({"schema": 1, "unit": "mm", "radius_mm": RADIUS, "knots": knots})
    )
    geometry = view_geometry(VIEW, *PIXELS)
    shadow = shadow_mask(shadow_lines(vertices, faces, geometry), geometry)
    (tmp_path / "front.png").write_bytes(encode_mask(shadow))
    (tmp_path / "scene.toml").write_text(
        "schema = 1\n[piece]\ntube_radius_mm = 3.0\nclearance_mm = 0.4\n"
        "[material]\nmin_bend_radius_mm = 3.2\n"
        '[[views]]\nname = "front"\npicture = "front.png"\n'
        "frame_width_mm = 150.0\nframe_height_mm = 130.0\n"
        "wall_tilt_deg = 15.0\nazimuth_deg = 30.0\n"
        '[accuracy]\nname = "standard"\niou_floor = 0.96\nmax_outline_error_px = 0.5\n'
        f"[effects]\n{OFF}"
        f"[pose]\nmatrix = {POSE.tolist()}\n"
    )
    return tmp_path


@pytest.fixture
def folder(right: Path, tmp_path: Path) -> Path:
    """A copy of the right part's files, to be changed."""
    return shutil.copytree(right, tmp_path / "copy")


@pytest.fixture(scope="module")
def exact(right: Path) -> Verdict:
    """The right part's verdict by its polygons alone."""
    return run(right, skip=["shadow-render"], only="shadows")


def run(folder: Path, **options: object) -> Verdict:
    return validate(
        folder / "part.stl",
        folder / "knots.json",
        folder / "scene.toml",
        **options,  # type: ignore[arg-type]
    )


def status(verdict: Verdict) -> dict[str, str]:
    return {check.name: check.status for check in verdict.checks}


@needs_rendering
def test_a_right_part_passes_and_its_numbers_are_whole(folder: Path, exact: Verdict) -> None:
    verdict = run(folder, pictures_dir=folder)
    others = {c.name: c.detail for c in verdict.checks if c.status != "pass"}
    assert others == {
        "centre_line": "given with the knots",
        "mount": "not given a scene with a mount",
        "slicer_ini": "there is no slicer.ini of this part",
    }
    assert verdict.status == "pass" and verdict.exit_code == 0
    (view,) = verdict.views
    assert view.iou > 0.97 and view.iou == view.iou_tube
    assert view.precision > 0.97 and view.recall > 0.97
    assert view.outline_error_px is not None and view.outline_error_mm is not None
    assert 0 < view.outline_error_px < 0.5
    pixel_mm = view.outline_error_mm / view.outline_error_px
    assert pixel_mm == pytest.approx(150 / 1024, rel=1e-3)
    assert (view.width, view.height) == PIXELS
    json.dumps(verdict.to_dict(), allow_nan=False)
    seen = np.asarray(Image.open(folder / "shadow-front.png"))
    assert seen.shape == (round(1024 * 780 / 900), 1024)
    assert (folder / "compare-front.png").exists()
    (polygons,) = exact.views  # which give the same numbers as what is rendered
    for key in ("iou", "precision", "recall"):
        assert getattr(view, key) == pytest.approx(getattr(polygons, key), abs=2e-4)


def test_a_shadow_one_pixel_off_fails_the_outline(folder: Path) -> None:
    knots = json.loads((folder / "knots.json").read_text())
    shift = 150 / 1024 * 500 / 600  # scene y is part z
    for knot in knots["knots"]:
        knot["points"] = (np.array(knot["points"]) + np.array([0, 0, shift])).tolist()
    (folder / "knots.json").write_text(json.dumps(knots))
    verdict = run(folder, skip=["shadow-render"], only="shadows")
    assert status(verdict)["outline"] == "fail" and status(verdict)["shadow"] == "pass"
    assert verdict.exit_code == 1
    measured = next(c.measured for c in verdict.checks if c.name == "outline")
    assert measured == pytest.approx(1.0, abs=0.15)


def test_a_part_behind_the_wall_throws_no_shadow_and_fails(folder: Path) -> None:
    away = POSE.copy()
    away[:3, 3] -= [5e3, 0.0, 8.66e3]
    scene = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(scene.replace(str(POSE.tolist()), str(away.tolist())))
    verdict = run(folder, skip=["shadow-render"], only="shadows")
    assert verdict.exit_code == 1 and status(verdict)["shadow"] == "fail"


def test_an_unprinted_piece_is_not_held_against_the_printer(folder: Path) -> None:
    """A scene that says `printed = false` is not; one that does not say is."""
    scene = (folder / "scene.toml").read_text()
    scene += '[printer]\nname = "toy"\nbuild_volume_mm = [9.0, 9.0, 9.0]\nnozzle_mm = 0.4\n'
    for said, expected in (("false", "skipped"), ("true", "fail"), (None, "fail")):
        key = "" if said is None else f"printed = {said}\n"
        (folder / "scene.toml").write_text(scene.replace("[piece]\n", f"[piece]\n{key}"))
        found = run(folder, skip=[*OF_SHADOWS, *KNOTS, "tube", "clearance"])
        assert status(found)["build_volume"] == expected
        assert found.exit_code == (0 if said == "false" else 1)
        (check,) = (c for c in found.checks if c.name == "gap")
        assert (check.detail == "checked with --print") == (said == "false")


def test_where_nothing_renders_it_says_so_with_exit_code_3(
    right: Path, exact: Verdict, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KNOTFAB_NO_RENDERING", "1")
    verdict = run(right, only="shadows")
    assert verdict.exit_code == 3 and verdict.status == "fail"
    (check,) = (c for c in verdict.checks if c.name == "shadow")
    assert check.status == "skipped" and "apt-get install libegl1 libgl1" in check.detail
    assert exact.exit_code == 0 and status(exact)["shadow"] == "pass"


@pytest.mark.parametrize(("diameter", "expected"), [(0.0, None), (60.0, "fail")])
def test_a_lamp_too_wide_for_its_strands_fails_as_the_lamp_it_is(
    folder: Path, diameter: float, expected: str | None
) -> None:
    scene = (folder / "scene.toml").read_text()
    lamp = f"wall_tilt_deg = 15.0\nlight_diameter_mm = {diameter}"
    scene = scene.replace(OFF, "").replace("wall_tilt_deg = 15.0", lamp)
    (folder / "scene.toml").write_text(scene)
    verdict = run(folder, skip=["shadow-render"], only="shadows")
    assert status(verdict)["shadow"] == "pass"  # the shadow of the lamp's middle
    assert status(verdict).get("half_light") == expected


def test_a_check_may_be_left_out_by_name(right: Path) -> None:
    verdict = run(right, skip=["shadow-render", "outline"], only="shadows")
    assert status(verdict)["outline"] == "skipped" and verdict.exit_code == 0


OF_SHADOWS = [
    "shadow", "shadow_exact", "outline", "wrong_outline", "recognisable", "half_light",
    "intrusion", "colours", "lamp_colours",
]  # fmt: skip


@pytest.mark.parametrize("asked", [*OF_SHADOWS, None])
def test_the_shadow_is_measured_where_any_check_of_it_is_asked(
    right: Path, monkeypatch: pytest.MonkeyPatch, asked: str | None
) -> None:
    """Where none is asked, each of them is said to be left out."""
    measured = [skip_check("measured", "")], [], None
    monkeypatch.setattr(part_shadows, "verify_shadows", lambda *_: measured)
    skip = [name for name in OF_SHADOWS if name != asked]
    found = [(c.name, c.detail) for c in run(right, skip=skip, only="shadows").checks]
    left = [(name, "left out on request") for name in OF_SHADOWS]
    assert found == ([("measured", "")] if asked else left)


def refuse(name: str) -> NoReturn:
    raise BadFile(name)


def tell(name: str) -> str:
    took_part(name, "was here")
    return name


@pytest.mark.parametrize("beside", [True, False])
def test_work_in_a_copy_is_as_good_as_here(beside: bool) -> None:
    with recording():
        assert run_beside(partial(tell, "numpy"), partial(tell, "scipy"), beside) == (
            "numpy",
            "scipy",
        )
        assert list_parts() == {"numpy": "was here", "scipy": "was here"}
    for calls in ((tell, refuse), (refuse, tell), (refuse, refuse)):
        with pytest.raises(BadFile):
            run_beside(*(partial(call, "it") for call in calls), beside)


@pytest.mark.skipif(sys.platform != "linux", reason="no copies are made elsewhere")
@pytest.mark.parametrize(
    ("ends", "code"),
    [("os.kill(os.getpid(), 11)", -11), ("os._exit(7)", 7), ("0", 3)],  # 3: no copy is left
)
def test_a_copy_that_crashes_ends_its_process_alike(ends: str, code: int) -> None:
    call = f"import os; from knotfab_validators.service import run_beside\nrun_beside(int, lambda: {ends})"
    left = "\ntry: os.waitpid(-1, os.WNOHANG)\nexcept ChildProcessError: os._exit(3)"
    assert subprocess.run([sys.executable, "-c", call + left]).returncode == code


FACING = PlainView(frame_width_mm=120.0, frame_height_mm=120.0)
LEFT = 0.97  # the share of every length that is left
SHIFTED = np.array([[0.0, 1, 0, -5], [0, 0, 1, 7], [1, 0, 0, 3], [0, 0, 0, 1]])


def write(folder: Path, part: float, knots: float, pose: float) -> Path:
    """A ring of 30 mm and its picture; part and knots written so much larger, and a pose that shrinks so."""
    curve = circle(60, 30.0)
    vertices, faces = tube(curve, 2.0, 16)
    seen = view_geometry(FACING, 256, 256)
    dark = shadow_mask(shadow_lines(vertices, faces, seen), seen)
    (folder / "front.png").write_bytes(encode_mask(dark))
    turn, shift = SHIFTED[:3, :3], SHIFTED[:3, 3]
    body = Body(part * (vertices - shift) @ turn, faces)
    (folder / "part.stl").write_bytes(encode(body, "stl"))
    points = (knots * (curve - shift) @ turn).tolist()
    told = {"schema": 1, "unit": "mm", "radius_mm": 2.0 * knots}
    told["knots"] = [{"closed": True, "type": "unknot", "points": points}]
    (folder / "knots.json").write_text(json.dumps(told))
    matrix = SHIFTED * [[pose], [pose], [pose], [1]]
    matrix[:3, 3] = shift
    (folder / "scene.toml").write_text(
        "[piece]\ntube_radius_mm = 2.0\n[material]\nshrinkage_percent = 3.0\n"
        '[[views]]\npicture = "front.png"\nframe_width_mm = 120.0\nframe_height_mm = 120.0\n'
        '[accuracy]\niou_floor = 0.9\n[effects]\nmisplacement = "off"\n'
        f"[pose]\nmatrix = {matrix.tolist()}\n"
    )
    return folder


def fails(folder: Path) -> set[str]:
    files = [folder / name for name in ("part.stl", "knots.json", "scene.toml")]
    found = validate(*files, skip=("shadow-render",), only="shadows").checks
    return {check.name for check in found if check.status == "fail" and check.required}


@pytest.mark.slow
def test_it_is_measured_as_it_shrinks(tmp_path: Path) -> None:
    assert not fails(write(tmp_path, 1 / LEFT, 1 / LEFT, LEFT))


@pytest.mark.slow
def test_a_part_that_was_not_enlarged_is_rejected(tmp_path: Path) -> None:
    assert "outline" in fails(write(tmp_path, 1.0, 1 / LEFT, LEFT))
    assert "shadow" in fails(write(tmp_path, 1.0, 1.0, LEFT))
    with pytest.raises(BadFile, match="shrinks the part"):
        fails(write(tmp_path, 1.0, 1.0, 1.0))
    with pytest.raises(BadFile, match="shrinks the part"):
        fails(write(tmp_path, 1 / LEFT, 1 / LEFT, 0.98))


@pytest.mark.slow
def test_projection_and_receiver_take_the_files_coordinates(tmp_path: Path) -> None:
    folder = write(tmp_path, 1 / LEFT, 1 / LEFT, LEFT)
    files = [folder / name for name in ("part.stl", "knots.json", "scene.toml")]
    (view,) = validate(*files, skip=("shadow-render",), only="shadows").views
    seen = view_geometry(FACING, 256, 256)
    scene = np.random.default_rng(0).uniform(-40, 40, (30, 3))
    own = (scene - SHIFTED[:3, 3]) @ SHIFTED[:3, :3] / LEFT
    pixels, w = seen.project(scene)
    told = np.column_stack([own, np.ones(30)]) @ np.array(view.projection).T
    np.testing.assert_allclose(told, np.column_stack([pixels * w[:, None], w]), atol=1e-7)
    plane = np.array(view.receiver)
    assert np.linalg.norm(plane[:3]) == pytest.approx(1.0)
    before = scene @ seen.receiver[:3] + seen.receiver[3]
    np.testing.assert_allclose(LEFT * (own @ plane[:3] + plane[3]), before)


def test_places_are_in_the_file(tmp_path: Path) -> None:
    """The bend decides at a vertex of knots.json, the part's size at a vertex of part.stl."""
    folder = write(tmp_path, 1 / LEFT, 1 / LEFT, LEFT)
    scene = folder / "scene.toml"
    limits = '[printer]\nname = "small"\nbuild_volume_mm = [9.0, 9.0, 9.0]\n'
    told = scene.read_text().replace("[material]\n", "[material]\nmin_bend_radius_mm = 40.0\n")
    scene.write_text(limits + told)
    files = [folder / name for name in ("part.stl", "knots.json")]
    checks = validate(*files, scene, skip=("shadow-render",), only="geometry").checks
    found = {check.name: check for check in checks}
    (knot,) = read_knots(files[1]).polygons
    surface = read_mesh(files[0]).vertices
    for name, points in (("bend", knot), ("build_volume", surface)):
        assert found[name].status == "fail" and found[name].at, name
        for place in found[name].at:
            assert np.linalg.norm(points - place, axis=1).min() < 1e-4, name
    said = re.search(r"\((.*)\) mm", found["bend"].detail)  # in its sentence too
    assert said is not None
    np.testing.assert_allclose(
        [float(x) for x in said[1].split(",")], found["bend"].at[0], atol=0.011
    )
