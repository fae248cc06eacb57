"""scene.toml is read with the documented defaults; corpus/hostile.py has impossible values."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from pieces import RADIUS, bodies_of, ring, view_of
from PIL import Image, ImageDraw
from validator_parts import KNOT, box_mesh

from knotfab.knots import Knot, Knots
from knotfab.picture.raster import encode_mask
from knotfab_validators.check import BadFile
from knotfab_validators.files.picture import PictureError, read_mask, widen_strokes
from knotfab_validators.files.scene import (
    parse_knots,
    parse_scene,
    read_knots,
    read_region_mesh,
    read_scene,
)
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.tube.region import check_region
from tests.corpus.files import encode
from tests.corpus.parts import Body


def test_an_empty_scene_is_held_to_what_a_build_writes_by_default() -> None:
    empty = parse_scene({})
    assert empty.promised is None and not empty.unprinted and empty.pose is None
    assert empty.iou_floor == 0.96 and empty.outline_px == 0.5
    assert empty.region.size_mm == (240.0, 240.0, 180.0)
    said = parse_scene({"piece": {"knot": "unknot", "printed": False}})
    assert said.promised == "unknot" and said.unprinted


def test_values_are_read(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        "schema = 1\n[piece]\ntube_radius_mm = 2.5\n[region]\nkind = 'sphere'\n"
        "center_mm = [1, 2, 3]\nsize_mm = [50, 50, 50]\n[material]\nmin_bend_radius_mm = 4\n"
        "[printer]\nbuild_volume_mm = [100, 90, 80]\n"
        "[[views]]\nname='a'\nazimuth_deg = 90\n[[views]]\nname='b'\nkind='eye'\n"
        "[pose]\nmatrix = [[0,1,0,5],[-1,0,0,6],[0,0,1,7],[0,0,0,1]]\n"
    )
    scene = read_scene(tmp_path / "scene.toml")
    assert scene.piece.tube_radius_mm == 2.5
    assert scene.region.kind == "sphere" and scene.region.center_mm == (1, 2, 3)
    assert scene.region.size_mm == (50, 50, 50) and scene.material.min_bend_radius_mm == 4
    assert scene.printer.build_volume_mm == (100, 90, 80)
    assert [v.name for v in scene.views] == ["a", "b"] and scene.views[0].azimuth_deg == 90
    assert scene.pose is not None and scene.pose.matrix[1] == (-1, 0, 0, 6)


def test_auto_is_left_open() -> None:
    scene = parse_scene(
        {
            "piece": {"tube_radius_mm": "auto"},
            "region": {"size_mm": "auto"},
            "material": {"min_bend_radius_mm": "auto"},
            "accuracy": {"iou_floor": "auto"},
        }
    )
    assert scene.iou_floor is None and scene.region.size_mm is None


def test_a_view_that_shines_on_anothers_wall_has_that_wall() -> None:
    first = {"name": "a", "wall_distance_mm": 60, "azimuth_deg": 30, "frame_width_mm": 90}
    second = {"name": "b", "wall": "a", "light_up_mm": -20, "lamp_colour": [0, 0.5, 1]}
    scene = parse_scene({"views": [first, second], "lamps": {"screen": "open"}})
    _, view = scene.views
    assert (view.wall_distance_mm, view.azimuth_deg, view.frame_width_mm) == (60, 30, 90)
    assert (view.light_up_mm, view.lamp_colour) == (-20, (0, 0.5, 1)) and not scene.screen_ends
    assert parse_scene({"views": [first, second]}).screen_ends
    assert not parse_scene({"views": [first]}).screen_ends
    wrong = (
        {**second, "wall": "c"},
        {**second, "azimuth_deg": 31},
        {**second, "lamp_colour": [2, 0, 0]},
    )
    for view_keys in wrong:
        with pytest.raises(BadFile):
            parse_scene({"views": [first, view_keys]})


def test_a_scene_reads_its_mesh_and_says_what_is_wrong_with_it(tmp_path: Path) -> None:
    mesh = box_mesh((86.0, 100.0, 10.0))

    def write(used: Mesh, name: str = "room.stl") -> None:
        body = Body(used.vertices, used.faces)
        (tmp_path / name).write_bytes(encode(body, "stl"))

    scene = tmp_path / "scene.toml"
    scene.write_text('[region]\nkind = "mesh"\nfile = "room.stl"\n')
    with pytest.raises(BadFile, match=r"room\.stl: cannot be read"):
        read_scene(scene)
    write(mesh)
    found = read_scene(scene)
    assert found.region.kind == "mesh" and found.surface is not None
    assert check_region(found.region, None, KNOT, None, found.surface).measured == pytest.approx(
        0.0, abs=1e-9
    )
    write(Mesh(mesh.vertices, mesh.faces[1:]))
    with pytest.raises(BadFile, match=r"\[region\] file: room\.stl is not a closed surface"):
        read_scene(scene)
    write(Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    with pytest.raises(BadFile, match="inside out"):
        read_region_mesh(tmp_path / "room.stl", "scene.toml")
    for text in ('kind = "mesh"', 'kind = "box"\nfile = "room.stl"', 'kind = "mesh"\nfile = 3'):
        scene.write_text("[region]\n" + text)
        with pytest.raises(BadFile, match=r"\[region\] file"):
            read_scene(scene)
    bare = parse_scene({"region": {"kind": "mesh", "file": "room.stl"}}).region
    assert check_region(bare, None, KNOT).status == "skipped"


# knots.json is read bit for bit; corpus/hostile.py has what is no such file.


def test_points_come_back_bit_for_bit_without_a_radius_too(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) * 100
    knot = {"closed": True, "type": "3_1", "points": points.tolist()}
    content = {"schema": 1, "unit": "mm", "radius_mm": 0.2, "knots": [knot]}
    (tmp_path / "knots.json").write_text(json.dumps(content))
    curves = read_knots(tmp_path / "knots.json")
    assert np.array_equal(curves.polygons[0], points)
    assert curves.types == ("3_1",) and curves.closed == (True,) and curves.radius_mm == 0.2
    edges = np.roll(points, -1, axis=0) - points
    assert curves.length_mm == pytest.approx(np.linalg.norm(edges, axis=1).sum())
    del content["radius_mm"]
    assert parse_knots(content).radius_mm is None


# The mask that a build wrote is read; anything else is refused.


SHAPE = np.zeros((40, 60), dtype=bool)
SHAPE[8:30, 10:50] = True
SHAPE[15:20, 20:30] = False


def test_a_mask_is_read_pixel_by_pixel(tmp_path: Path) -> None:
    for mask in (SHAPE, ~SHAPE, SHAPE[:, :13]):
        (tmp_path / "a.png").write_bytes(encode_mask(mask))
        np.testing.assert_array_equal(read_mask(tmp_path / "a.png"), mask)


def test_what_is_no_mask_is_refused(tmp_path: Path) -> None:
    good = encode_mask(np.random.default_rng(0).random((64, 64)) < 0.5)
    (tmp_path / "cut.png").write_bytes(good[:200])
    (tmp_path / "text.png").write_text("not a picture")
    for name in ("none.png", "cut.png", "text.png", "."):
        with pytest.raises(PictureError):
            read_mask(tmp_path / name)
    for image in (Image.fromarray(~SHAPE), Image.fromarray(~SHAPE).convert("L")):
        image.save(tmp_path / "old.png")
        with pytest.raises(PictureError, match=r"knotfab 1\.x: build it again with --scene"):
            read_mask(tmp_path / "old.png")
    for key, value in (("invert", True), ("crop_px", [0, 0, 9, 9]), ("ink", "dark")):
        with pytest.raises(BadFile, match=r"knotfab 1\.x: build it again with --scene"):
            parse_scene({"views": [{key: value}]})


def test_a_pipe_is_no_picture(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "front.png")
    for path in (tmp_path / "front.png", Path("/dev/zero")):
        with pytest.raises(PictureError, match="not a plain file"):
            read_mask(path)


# A shadow of strokes that were widened is judged by them; `iou` stays that with the picture
# itself.


WIDE, HIGH = 500, 400
VIEW = view_of()


def judge(width_mm: float | None, radius: float = RADIUS) -> VerifiedView:
    """A ring whose picture is a line of 3 px, widened to so many mm on the wall."""
    knots = Knots((Knot(ring(42.0)),), radius)
    geometry = view_geometry(VIEW, WIDE, HIGH)
    seen = geometry.project(knots.knots[0].points)[0]
    image = Image.new("1", (WIDE, HIGH))
    ImageDraw.Draw(image).line([(float(u), float(v)) for u, v in [*seen, seen[0]]], 1, 3)
    line = np.asarray(image).copy()
    ((vertices, faces),) = bodies_of(knots)
    drawn = None if width_mm is None else widen_strokes(line, width_mm / geometry.pixel_mm)
    return verify_view(
        vertices,
        faces,
        line,
        geometry,
        polygons=[knots.knots[0].points],
        radius=radius,
        drawn=drawn,
    )


def status(view: VerifiedView, width_mm: float | None) -> tuple[str, str]:
    """The status of the check of the shadow, and its sentence."""
    checks = shadow_checks(
        {"front": view},
        np.zeros((9999, 3)),
        iou_floor=0.9,
        max_outline_px=0.5,
        no_rendering="there is no need to",
        polygons_decide=True,
        changed={}
        if width_mm is None
        else {"front": f"its strokes widened to {width_mm:g} mm as they are drawn"},
    )
    (shadow,) = (c for c in checks if c.name == "shadow")
    return shadow.status, shadow.detail


def test_a_line_is_judged_as_wide_as_it_is_drawn() -> None:
    width = 2 * RADIUS * VIEW.magnification
    alone, wide = judge(None), judge(width)
    assert alone.judged.iou == alone.whole.iou == wide.whole.iou < 0.5
    assert wide.judged.iou > 0.9
    assert status(alone, None)[0] == "fail"
    found, said = status(wide, width)
    assert found == "pass"
    assert f"widened to {width:g} mm" in said and f"{alone.whole.iou:.4f}" in said


@pytest.mark.parametrize("times", [0.7, 1.4])
def test_a_tube_of_another_width_than_the_strokes_is_rejected(times: float) -> None:
    width = 2 * RADIUS * VIEW.magnification
    assert status(judge(width, times * RADIUS), width)[0] == "fail"


@pytest.mark.parametrize(
    ("off", "told"), [(0.0, True), (2e-15, True), (1e-9, True), (1e-3, False), (None, False)]
)
def test_a_closing_point_is_not_repeated_but_for_rounding(off: float | None, told: bool) -> None:
    t = np.linspace(0.0, 2 * np.pi, 61)[: None if off is not None else -1]
    points = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    points[-1, 2] += off or 0.0
    knots = {"schema": 1, "radius_mm": 0.1, "knots": [{"points": points.tolist()}]}
    if not told:
        assert len(parse_knots(knots).polygons[0]) == len(points)
        return
    with pytest.raises(BadFile, match="the last point joins the first, it must not be repeated"):
        parse_knots(knots)
