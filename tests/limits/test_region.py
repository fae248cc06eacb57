"""A region that is a closed mesh: exact signed distances with a gradient, and its way into a build."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import region_meshes
from command import knotfab
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.limits.region import beyond, outside, region_mesh, tube_outside
from knotfab.limits.terms import Limits
from knotfab.part.files import write_stl
from knotfab.scene.load import load_scene, parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.scene import SettledRegion
from knotfab_formats.verdict import KNOTS, MESH

Mesh = tuple[Array, NDArray[np.int32]]


def prism(*outline: tuple[float, float], half: float) -> Mesh:
    mesh = region_meshes.prism(*outline, low=-half, high=half)
    return mesh.vertices, mesh.faces.astype(np.int32)


BOX = prism((-30, -20), (30, -20), (30, 20), (-30, 20), half=10)
WEDGE = prism((0, 5), (-9, 60), (-60, 60), (-60, -60), (60, -60), (60, 60), (9, 60), half=30)


def region(
    folder: Path, mesh: Mesh, center: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> SettledRegion:
    path = folder / "room.stl"
    write_stl(path, [mesh])
    region_mesh.cache_clear()
    return SettledRegion(
        kind="mesh", file=str(path), center_mm=center, size_mm=(200.0, 200.0, 200.0)
    )


def test_distances_to_a_box_are_exact_at_faces_edges_and_corners(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-45, 45, (4000, 3))
    q = np.abs(points) - [30, 20, 10]
    exact = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    found = outside(points, region(tmp_path, BOX), 0.0)[0]
    assert np.abs(found - exact).max() < 1e-9
    moved = region(tmp_path, BOX, (1.0, 2.0, 3.0))
    again = outside(points + [1, 2, 3], moved, 2.5)[0]
    assert np.abs(again - 2.5 - exact).max() < 1e-9


def test_sides_are_right_about_an_edge_that_pokes_in(tmp_path: Path) -> None:
    """Points nearest to a sharp edge: the nearest faces alone would put some on the wrong side."""
    r = region(tmp_path, WEDGE)
    points = np.random.default_rng(1).uniform([-15, -5, -25], [15, 25, 25], (4000, 3))
    x, y = np.abs(points[:, 0]), points[:, 1]
    in_wedge = (y > 5) & (x < 9 / 55 * (y - 5))
    found = outside(points, r, 0.0)[0]
    assert np.array_equal(found > 0, in_wedge)


def test_the_gradient_leads_inwards(tmp_path: Path) -> None:
    mesh = region_mesh(str(region(tmp_path, WEDGE).file), (0.0, 0.0, 0.0))
    points = np.random.default_rng(2).uniform(-70, 70, (200, 3))
    value, slope = beyond(points, mesh)
    assert np.linalg.norm(slope, axis=1) == pytest.approx(np.ones(200))
    ahead, _ = beyond(points - 1e-4 * slope, mesh)
    assert value - ahead == pytest.approx(np.full(200, 1e-4), rel=1e-3)


def test_what_the_search_accepts_is_inside(tmp_path: Path) -> None:
    """The wedge's edge stands between two vertices: only the enlarged radius keeps it out."""
    r = region(tmp_path, WEDGE)
    x = np.linspace(-20.3, 20.3, 30)  # the edge at x = 0 is midway between two vertices
    for gap in np.linspace(1.95, 2.1, 16):
        line = np.column_stack([x, np.full(30, 5.0 - gap), np.zeros(30)])
        points, excess = tube_outside(line[:-1], line[1:], Limits(2.0, 0.4, 2.2, 100.0, r))
        assert len(points) == 58
        if gap < 2.0:
            assert excess.max() > 0
        if gap > 2.04:  # and not by much more than is needed
            assert excess.max() < 0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no STL file"),
        (b"solid x\nendsolid x", "no STL file"),
        (b"solid\nvertex 1 2 x\n", "not three numbers"),
        (b"solid\nvertex 0 0 0 vertex 1 0 0 vertex 0 1 nan", "not finite"),
        (b"solid\nvertex 0 0 0 vertex 1 0 0 vertex 0 1 0", "not a closed surface"),
        (b"\xff" * 84, "no STL file"),
        (None, "no such file"),
    ],
)
def test_a_mesh_that_is_no_region_is_refused(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    path = tmp_path / "bad.stl"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        region_mesh(str(path), (0.0, 0.0, 0.0))
    assert caught.value.exit_code == 2 and "bad.stl" in str(caught.value)


def test_holes_and_an_inside_out_mesh_are_refused(tmp_path: Path) -> None:
    vertices, faces = BOX
    for wrong, words in ((faces[1:], "not a closed"), (faces[:, ::-1], "inside out")):
        with pytest.raises(InputError, match=words):
            outside(np.zeros((1, 3)), region(tmp_path, (vertices, wrong)), 0.0)


def test_a_scene_names_its_mesh_beside_itself(tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text('[region]\nkind = "mesh"\nfile = "sub/room.stl"\n')
    assert load_scene(tmp_path / "my.toml").region.file == os.path.join(tmp_path, "sub", "room.stl")
    for text, words in (
        ('kind = "mesh"', "names no file"),
        ('file = "room.stl"', 'goes with kind = "mesh"'),
        ('kind = "mesh"\nfile = 3', "text in quotes"),
    ):
        with pytest.raises(InputError, match=words):
            parse_scene("[region]\n" + text)


@pytest.mark.build
def test_a_build_stays_inside_and_its_scene_names_the_copied_mesh(tmp_path: Path) -> None:
    # an edge from the right reaches 2 mm into the picture
    outline = [(63.0, 28.0), (90.0, 56.0), (90.0, 90.0), (-90.0, 90.0), (-90.0, -90.0)]
    write_stl(tmp_path / "room.stl", [prism(*outline, (90.0, -90.0), (90.0, 0.0), half=60.0)])
    scene = tmp_path / "mine.toml"
    scene.write_text(
        '[region]\nkind = "mesh"\nfile = "room.stl"\n[piece]\ntube_radius_mm = 2.5\n'
        '[accuracy]\nname = "draft"\niou_floor = 0.5\nmax_outline_error_px = 1.0\n'
        "[search]\ncoarse_px = 96\nfine_px = 160\n"
        "coarse_iterations = 25\nfine_iterations = 20\nsettle_iterations = 20\n"
        "depth_candidates = 8\n"
    )
    out = tmp_path / "out"
    call = ("build", "--skip", "shadow-render")
    # files left out whole are not measured: the region tells
    unread = [f"--skip={name}" for name in (*KNOTS, *MESH, "tube", "clearance")]
    done = knotfab(*call, *unread, "text:♥", "--scene", scene, "--out", out)
    assert done.code == 0, done
    report = json.loads((out / "report.json").read_text())
    check = next(c for c in report["checks"] if c["name"] == "region")
    assert check["status"] == "pass" and -1.0 < check["measured"] < 0  # the wall was felt
    assert (out / "region.stl").read_bytes() == (tmp_path / "room.stl").read_bytes()
    assert load_scene(out / "scene.toml").region.file == str(out / "region.stl")
