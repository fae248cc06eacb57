"""scene.toml is read with the documented defaults; test_hostile.py has impossible values."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from region_meshes import KNOT, box_mesh

from knotfab_validators.check import BadFile
from knotfab_validators.files.scene import (
    parse_knots,
    parse_scene,
    read_knots,
    read_region_mesh,
    read_scene,
)
from knotfab_validators.geometry.mesh import Mesh
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


# knots.json is read bit for bit; test_hostile.py has what is no such file.


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
