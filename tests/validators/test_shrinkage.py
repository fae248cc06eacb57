"""Parts that are written larger, for their material shrinks: measured as they will be."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from validator_parts import PlainView, circle, tube

from knotfab_validators.check import BadFile
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.scene import read_knots
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.validate import validate
from tests.corpus.files import encode
from tests.corpus.parts import Body

VIEW = PlainView(frame_width_mm=120.0, frame_height_mm=120.0)
LEFT = 0.97  # the share of every length that is left
POSE = np.array([[0.0, 1, 0, -5], [0, 0, 1, 7], [1, 0, 0, 3], [0, 0, 0, 1]])


def write(folder: Path, part: float, knots: float, pose: float) -> Path:
    """A ring of 30 mm and its picture; part and knots written so much larger, and a pose that shrinks so."""
    curve = circle(120, 30.0)
    vertices, faces = tube(curve, 2.0, 24)
    seen = view_geometry(VIEW, 256, 256)
    dark = shadow_mask(shadow_lines(vertices, faces, seen), seen)
    Image.fromarray(np.where(dark, 0, 255).astype(np.uint8)).save(folder / "front.png")
    turn, shift = POSE[:3, :3], POSE[:3, 3]
    body = Body(part * (vertices - shift) @ turn, faces)
    (folder / "part.stl").write_bytes(encode(body, "stl"))
    points = (knots * (curve - shift) @ turn).tolist()
    told = {"schema": 1, "unit": "mm", "radius_mm": 2.0 * knots}
    told["knots"] = [{"closed": True, "type": "unknot", "points": points}]
    (folder / "knots.json").write_text(json.dumps(told))
    matrix = POSE * [[pose], [pose], [pose], [1]]
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
    seen = view_geometry(VIEW, 256, 256)
    scene = np.random.default_rng(0).uniform(-40, 40, (30, 3))
    own = (scene - POSE[:3, 3]) @ POSE[:3, :3] / LEFT
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
