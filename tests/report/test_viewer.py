"""What the viewer is handed: packing that can be undone, the mount alone, supports where they are needed."""

import base64
import hashlib
import io
import json
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from pieces import RADIUS, bodies_of, post, ring, scene_of, view_of, wavy_knots
from PIL import Image

from knotfab.geometry.overhang import Rules
from knotfab.knots import Knot, Knots
from knotfab.part.write import write_glb
from knotfab.render.part_picture import turn_upright
from knotfab.report import viewer
from knotfab.report.page import VIEWER, encode_for_script
from knotfab.report.pictures import turns_of
from knotfab.report.viewer import (
    HISTORY_VERTICES,
    HistoryFrame,
    find_supports,
    pack_rows,
    viewer_data,
)
from knotfab.scene.camera import camera_of
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedView, SettledScene

WEB = Path(__file__).parents[2] / "web"
MASK = np.zeros((120, 150), dtype=bool)
MASK[30:90, 40:110] = True
TURN = np.array([[0.0, 0, 1, 20], [1, 0, 0, -5], [0, 1, 0, 7], [0, 0, 0, 1]])  # part to scene


def unpacked(packed: dict[str, Any], columns: int = 3) -> np.ndarray:
    q = np.frombuffer(base64.b64decode(packed["q"]), dtype="<u2").reshape(-1, columns)
    return np.array(packed["low"]) + packed["step"] * q


def part_knots() -> Knots:
    """The knots as a file has them, which TURN takes to the scene."""
    return wavy_knots().moved(np.linalg.inv(TURN))


def test_packed_rows_are_as_near_as_half_a_step() -> None:
    rows = np.random.default_rng(1).normal(size=(200, 4)) * [100.0, 1.0, 0.0, 30.0] + 12.3456789
    packed = pack_rows(rows)
    assert np.abs(unpacked(packed, 4) - rows).max() <= 0.5001 * packed["step"] + 1e-4
    assert packed["step"] < 0.02
    assert unpacked(pack_rows(np.ones((1, 3)))) == pytest.approx(np.ones((1, 3)))


def test_a_piece_is_shown_in_the_scene_its_mount_apart() -> None:
    view, knots = view_of(), part_knots()
    back = np.linalg.inv(TURN)
    corners, faces = post(view)
    held = (corners @ back[:3, :3].T + back[:3, 3], faces)
    scene = scene_of([view], matrix=TURN)
    data = viewer_data(scene, knots, bodies_of(knots, held), [MASK])
    for curve, knot in zip(data["curves"], wavy_knots().knots, strict=True):
        assert unpacked(curve) == pytest.approx(knot.points, abs=2e-3)
    (mesh,) = data["meshes"]
    assert unpacked(mesh["positions"]) == pytest.approx(corners, abs=2e-3)
    assert len(base64.b64decode(mesh["faces"])) == 4 * 3 * len(faces)
    assert data["wall_mounted"] is True and data["print"]["matrix"] == TURN.tolist()
    picture = Image.open(io.BytesIO(base64.b64decode(data["views"][0]["picture"].split(",")[1])))
    assert np.array_equal(~np.asarray(picture.convert("1")), MASK)
    assert "history" not in data
    bare = viewer_data(scene_of([view], "none", TURN), knots, bodies_of(knots), [MASK])
    assert "meshes" not in bare and bare["wall_mounted"] is False


def test_the_states_of_a_large_piece_stay_small_together() -> None:
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t]) * 40.0
    many = Knots(tuple(Knot(circle + [0.0, 0.0, 3.0 * k]) for k in range(40)), 0.5)
    frames = [HistoryFrame(f"{k} %", many) for k in range(24)]
    data = viewer_data(scene_of([view_of()], "none"), many, [], [MASK], history=frames)
    shown = [[len(unpacked(curve)) for curve in frame["curves"]] for frame in data["history"]]
    assert sum(map(sum, shown)) < 1.25 * HISTORY_VERTICES
    assert min(map(min, shown)) >= 8 and all(len(frame) == 40 for frame in shown)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux makes limited copies")
def test_a_folders_part_is_read_in_a_limited_copy(
    copies: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("knots.json", "part.stl"):
        (tmp_path / name).touch()
    scene = SimpleNamespace(piece=SimpleNamespace(printed=True))
    monkeypatch.setattr(viewer, "_read_piece", lambda *_: (scene, None, [MASK]))

    def refuse(*_: object) -> None:
        raise InputError("part.stl", f"process {os.getpid()} reads it", "Nothing helps.")

    monkeypatch.setattr(viewer, "corners_stl", refuse)
    with pytest.raises(InputError, match="reads it") as caught:
        viewer.read_viewer_data(tmp_path)
    assert str(os.getpid()) not in caught.value.why


def test_a_history_is_thinned_and_keeps_its_curves() -> None:
    view, knots = view_of(), Knots((Knot(ring(42.0, n=900)), Knot(ring(25.0, n=500))), RADIUS)
    frames = [HistoryFrame("template", knots), HistoryFrame("", knots, MASK)]
    data = viewer_data(scene_of([view], "none"), knots, [], [MASK], history=frames)
    first, second = data["history"]
    assert first["label"] == "template" and "picture" not in first and "picture" in second
    for curve, knot in zip(first["curves"], knots.knots, strict=True):
        few = unpacked(curve)
        assert 8 <= len(few) < len(knot.points)
        assert np.linalg.norm(np.roll(few, -1, axis=0) - few, axis=1).max() <= 2 * RADIUS


def test_supports_stand_between_overhangs_and_what_is_below() -> None:
    """A shelf of 30 x 30 at 20 mm lies half over a plate of 60 x 60 at 2 mm, half over the bed."""
    from solids import box

    shelf, plate = (
        box((50.0, 0.0, 20.0), (80.0, 30.0, 22.0)),
        box((5.0, 0.0, 0.0), (65.0, 60.0, 2.0)),
    )
    bodies = [
        trimesh.Trimesh(m.vertices, m.faces, process=False).subdivide_to_size(1.5)
        for m in (shelf, plate)
    ]
    meshes = [(np.asarray(m.vertices), np.asarray(m.faces).astype(np.int32)) for m in bodies]
    columns = find_supports(meshes, Rules())
    assert columns[:, 3] == pytest.approx(20.0)
    over = columns[:, 0] < 65.0 - 1.5
    beside = columns[:, 0] > 65.0 + 1.5
    assert columns[over, 2] == pytest.approx(2.0) and columns[beside, 2] == pytest.approx(0.0)
    assert len(columns) * 9.0 == pytest.approx(900.0, rel=0.25)
    assert len(find_supports(meshes, Rules(max_overhang_deg=90.0))) == 0


def test_nothing_in_the_data_ends_its_script() -> None:
    evil = {"name": "</script><!--<script>&\u2028", "list": [1.5, None, True]}
    text = encode_for_script(evil)
    assert not set("<>&\u2028") & set(text) and json.loads(text) == evil
    with pytest.raises(ValueError):
        encode_for_script({"a": float("nan")})


def test_the_bundle_is_built_from_the_sources_and_can_be_inlined() -> None:
    """Run `make viewer` after every change of web/."""
    names = [
        "package-lock.json",
        "build.mjs",
        *sorted(f"src/{p.name}" for p in (WEB / "src").iterdir()),
    ]
    hashed = hashlib.sha256()
    for name in names:
        hashed.update(f"{name}\n".encode() + (WEB / name).read_bytes())
    bundle = VIEWER.read_text(encoding="utf-8")
    found = re.search(r"sources sha256:([0-9a-f]{64})", bundle.splitlines()[0])
    assert found is not None and found[1] == hashed.hexdigest()
    assert not re.search(r"</script|<!--", bundle, re.IGNORECASE)
    notice = (VIEWER.parent / "three-LICENSE.txt").read_text(encoding="utf-8")
    for text in (notice, bundle):
        assert "three.js authors" in text and "Permission is hereby granted" in text
    lock = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    assert f"three.js {lock['node_modules/three']['version']}" in bundle


def test_the_glb_is_the_piece_in_metres_as_it_stands(tmp_path: Path) -> None:
    bodies = bodies_of(part_knots())
    write_glb(tmp_path / "part.glb", bodies, TURN, ["knot 1", "knot 2"], "#d9d4c7")
    scene: Any = trimesh.load_scene(tmp_path / "part.glb")
    assert set(scene.geometry) == {"knot 1", "knot 2"}
    for name, (vertices, faces) in zip(("knot 1", "knot 2"), bodies, strict=True):
        mesh = scene.geometry[name]
        assert len(mesh.faces) == len(faces) and mesh.volume > 0
        placed = 1e-3 * (vertices @ TURN[:3, :3].T + TURN[:3, 3])
        assert mesh.bounds == pytest.approx(np.array([placed.min(0), placed.max(0)]), abs=1e-6)
        color = mesh.visual.material.baseColorFactor
        assert list(color[:3]) == [0xD9, 0xD4, 0xC7]


# A piece that turns under one lamp: the angles are those at which the other lamps' shadows
# appear.


def scene(*views: dict[str, float]) -> SettledScene:
    size = {"frame_width_mm": 100.0, "frame_height_mm": 100.0}
    made = [ResolvedView(name=f"v{n}", **size, **view) for n, view in enumerate(views)]
    return SettledScene.model_construct(views=tuple(made))


@pytest.mark.parametrize("azimuth", [90.0, -60.0, 17.0])
def test_the_turned_piece_throws_the_other_shadow(azimuth: float) -> None:
    views = scene({}, {"azimuth_deg": azimuth}).views
    angle = turns_of(scene({}, {"azimuth_deg": azimuth}))["v1"]
    points = np.random.default_rng(3).normal(size=(40, 3)) * 20.0
    first, other = (camera_of(view, 64, 64) for view in views)
    turned = turn_upright(points, angle)
    assert first.project(turned) == pytest.approx(other.project(points), abs=1e-9)


@pytest.mark.parametrize(
    "other",
    [
        {"azimuth_deg": 90.0, "elevation_deg": 20.0},
        {"azimuth_deg": 90.0, "light_distance_mm": 400.0},
    ],
)
def test_lamps_of_their_own_places_share_no_lamp(other: dict[str, float]) -> None:
    assert turns_of(scene({}, other)) == {}


def test_one_view_has_no_angles() -> None:
    assert turns_of(scene({})) == {}
