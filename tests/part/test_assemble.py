"""The part: what is printed larger, because it shrinks; one object for the slicer, with names and colours."""

import io
import json
import re
import zipfile
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold
from pieces import knots, ring
from PIL import Image
from reports import report_with

from knotfab.base.folder import OutputFolder
from knotfab.geometry.tube import as_manifold, as_mesh, mesh_volume, sweep
from knotfab.hold.mount import Mounted
from knotfab.knots import Knot, Knots
from knotfab.part import assemble
from knotfab.part.assemble import (
    TOLERANCES_MM,
    Part,
    _choose_pose,
    _find_crossing,
    _Surface,
    clean_body,
    enlarge_knots,
    shrink_of,
)
from knotfab.part.write import make_pose, pose_scene, write_model, write_part, write_unbuilt
from knotfab.picture.read import Change, Given, Target
from knotfab.report.supports import report_posing
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import load_scene
from knotfab_formats.piece import About, Material, Printer
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_validators.files.picture import read_mask
from knotfab_validators.files.scene import read_scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh.surface_checks import self_intersections

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0)
CAMERA = camera_of(VIEW, 60, 60)
MASK = np.ones((60, 60), dtype=bool)


@pytest.mark.parametrize("seed", [0, 171])
def test_a_body_is_rounded_without_crossings(seed: int) -> None:
    """Rounding turns slivers over where a strand leaves a plate, in the second at every tolerance."""
    random = np.random.default_rng(seed)
    plate = Manifold.cube((40.0, 40.0, 1.6)).translate((60.0, 60.0, 0.0))
    a = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    x, y = (80.0 + s * f(a) + random.normal(0.0, 0.02, 40) for s, f in ((10, np.cos), (6, np.sin)))
    z = 1.6 + random.uniform(-0.5, 0.5) + 8.0 * np.sin(a + random.uniform(0.0, 6.0))
    solid = plate + as_manifold(sweep(np.column_stack([x, y, z]), 2.05, 32))
    vertices, faces = clean_body(as_mesh(solid))
    assert (vertices == vertices.astype(np.float32)).all()
    assert not len(self_intersections(Mesh(vertices, faces.astype(np.int64))))
    assert mesh_volume(vertices, faces) == pytest.approx(solid.volume(), rel=1e-4)


# a plate's face meets a tube's at two corners .0014 mm apart: two faces cross, whatever simplifying does
SLIT = (
    [
        [73.83466339, 77.36261749, 1.2000000477],
        [74.05343627929688, 78.06514739990234, 1.2004024982452393],
        [74.05472564697266, 78.06504821777344, 1.2000000476837158],
        [74.24855041503906, 78.70536041259766, 1.4839040040969849],
        [72.7731704711914, 77.45386505126953, 1.981407880783081],
        [72.89791870117188, 78.16447448730469, 2.0510034561157227],
        [74.74144744873047, 78.41903686523438, 1.2000000476837158],
        [50.99223327636719, 83.56975555419922, 1.2000000476837158],
        [75.0, 60.0, -3.0],
    ],
    [
        *([4, 1, 0], [5, 3, 1], [2, 6, 1], [1, 3, 2], [3, 6, 2], [4, 5, 1], [1, 7, 0]),
        *([1, 6, 7], [4, 0, 8], [3, 5, 8], [6, 3, 8], [5, 4, 8], [0, 7, 8], [7, 6, 8]),
    ],
)


def test_a_slit_that_simplifying_does_not_close_is_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def find(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        asked.append((vertices.tobytes(), faces.tobytes()))
        return _find_crossing(vertices, faces)

    body = np.float32(SLIT[0]).astype(np.float64), np.array(SLIT[1])
    solid = as_manifold(body)
    simpler = (as_mesh(solid.simplify(within)) for within in TOLERANCES_MM)
    assert not any(_Surface(*one).is_clean for one in simpler)
    monkeypatch.setattr(assemble, "_find_crossing", find)
    joined = clean_body(body)
    assert max(Counter(asked).values()) == 2  # for it is simplified twice, to no avail
    assert _Surface(*joined).is_clean
    assert as_manifold(joined).volume() == pytest.approx(solid.volume(), rel=1e-6)


def posed(shrinkage: float, room: float = 250.0) -> Part:
    """Two rings of 30 mm."""
    own = knots(*(ring(30.0, z, 60, wave=0.0) for z in (0.0, 12.0)))
    tubes = [sweep(knot.points, 2.0, 12) for knot in own.knots]
    keys: Any = {
        "views": (VIEW,),
        "material": Material(shrinkage_percent=shrinkage),
        "printer": Printer(build_volume_mm=(room, room, room)),
    }
    scene = resolve(Scene(**keys))
    mounted: Any = Mounted(tubes, ["knot 1", "knot 2"], scene, None)
    made: Any = SimpleNamespace(scene=scene, knots=own)
    mounted, pose = _choose_pose(made, mounted, True)
    return Part(list(pose.tubes), pose, mounted)


def test_what_is_printed_is_larger_and_the_pose_takes_it_back() -> None:
    as_is, part = posed(0.0), posed(4.0)
    assert part.pose.knots.radius_mm == pytest.approx(2 / 0.96) and as_is.pose.knots.radius_mm == 2
    assert part.pose.size_mm == pytest.approx(as_is.pose.size_mm / 0.96)
    own = part.pose.knots.moved(part.pose.matrix)
    assert own.radius_mm == pytest.approx(2.0)
    assert own.points == pytest.approx(as_is.pose.knots.moved(as_is.pose.matrix).points, abs=1e-9)
    turn = np.array(pose_scene(part).pose.matrix)[:3, :3]  # type: ignore[union-attr]
    assert turn @ turn.T == pytest.approx(0.96**2 * np.eye(3))
    for vertices, _ in part.bodies:
        back = vertices @ turn.T + part.pose.matrix[:3, 3]
        assert np.hypot(back[:, 0], back[:, 1]).max() == pytest.approx(32.0, abs=0.1)
    found, (note,) = report_posing(report_with().print, part, None)
    assert "4.17 % larger" in note
    assert found.pose is not None and found.pose.shrinkage_percent == 4.0


PICTURED = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0, picture="picture-front.png")


def rings(count: int) -> Any:
    """A part of which only the mesh is written: loose rings one above the other."""
    own = ring(20.0, n=40, wave=0.0) + [25.0, 25.0, 3.0]
    knots = tuple(Knot(own + np.array([0.0, 0.0, 10.0 * k])) for k in range(count))
    return SimpleNamespace(
        bodies=[sweep(knot.points, 2.0, 12) for knot in knots],
        pose=SimpleNamespace(knots=Knots(knots, 2.0), matrix=np.eye(4)),
        mounted=Mounted([], [f"knot {k + 1}" for k in range(count)], Scene(), None),
        framing=(None, ""),
        standing=None,
        names=[f"knot {k + 1}" for k in range(count)],
    )


def model_of(path: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        return archive.read("3D/3dmodel.model").decode()


def written(tmp_path: Path, count: int, colours: bool, suffix: str) -> Path:
    asked, drawn = np.eye(4, dtype=bool), np.ones((4, 4), dtype=bool)  # as it was read, and wider
    given, change = Given(b"picture", ".jpg"), Change(asked, drawn)
    target = Target("heart", drawn, given=given, change=change)
    about = About(title="Heart & co", licence="CC0") if suffix else About()
    keys: Any = {"views": (PICTURED,), "pose": make_pose(np.eye(4)), "about": about}
    scene: Any = resolve(Scene(**keys))
    with OutputFolder(tmp_path / "out") as folder:
        write_part(folder, rings(count), scene, [target], colours, suffix)
        write_model(folder, rings(count), scene, suffix)
        folder.commit()
    return tmp_path / "out"


@pytest.mark.parametrize("suffix", ["", "-01"])
def test_the_files_of_a_piece(tmp_path: Path, suffix: str) -> None:
    out = written(tmp_path, 3, False, suffix)
    names = {f"part{suffix}.{kind}" for kind in ("stl", "3mf", "glb")}
    names |= {f"knots{suffix}.json", f"scene{suffix}.toml"}
    assert {p.name for p in out.iterdir()} == {*names, "picture-front.png", "given-front.jpg"}
    assert read_mask(out / "picture-front.png").tolist() == np.eye(4, dtype=bool).tolist()
    assert (out / "given-front.jpg").read_bytes() == b"picture"
    assert load_scene(out / f"scene{suffix}.toml").pose == make_pose(np.eye(4))
    model = model_of(out / f"part{suffix}.3mf")
    assert model.count("<object ") == model.count("<item ") == 1
    assert model.count("<triangle ") == 3 * 2 * 40 * 12
    assert f'name="{"Heart &amp; co" if suffix else "heart"}"' in model
    told = dict(re.findall('<metadata name="([A-Za-z]+)"[^>]*>([^<]*)<', model))
    assert told["Designer"] == "knotfab" and ("LicenseTerms" in told) == bool(suffix)
    assert told["Description"] == (
        "3 knots of a tube 4 mm thick whose shadow is heart: 120 × 120 mm on the wall 100 mm behind, "
        "by a lamp 5 mm wide, 500 mm from its middle."
    )
    with zipfile.ZipFile(out / f"part{suffix}.3mf") as archive:
        (png,) = (archive.read(n) for n in archive.namelist() if n.endswith(".png"))
    wide, high = Image.open(io.BytesIO(png)).size
    assert wide == high >= 300


def test_colours_are_written_beside_where_they_are_asked_for(tmp_path: Path) -> None:
    """Every body has its name, and each of up to eight a colour of its own."""
    out = written(tmp_path, 8, True, "")
    assert model_of(out / "part.3mf").count("<object ") == 1
    model = model_of(out / "part-colours.3mf")
    assert model.count("<item ") == 1 and model.count("<component ") == 8
    assert re.findall('name="(knot [0-9])"', model) == [f"knot {k}" for k in range(1, 9)]
    colours = re.findall('<base [^>]*displaycolor="(#[0-9A-Fa-f]+)"', model)
    assert len(colours) == len(set(colours)) == 8
    assert colours[0].lower().startswith(Scene().material.color)


@pytest.mark.parametrize("percent", [0.0, 3.0, 12.5])
def test_knots_without_a_part_are_as_large_as_their_pose_says(
    tmp_path: Path, percent: float
) -> None:
    keys: Any = {"views": (PICTURED,), "material": Material(shrinkage_percent=percent)}
    own = Knots((Knot(20 * np.random.default_rng(0).normal(size=(30, 3))),), 2.0)
    made: Any = SimpleNamespace(scene=resolve(Scene(**keys)), knots=own)
    target = Target("heart", np.eye(4, dtype=bool), given=Given(b"picture", ".jpg"))
    with OutputFolder(tmp_path / "out") as folder:
        write_unbuilt(folder, made, [target])
        folder.commit()
    pose = read_scene(tmp_path / "out" / "scene.toml").pose  # rigid, less what shrinks
    assert pose is not None and np.array(pose.matrix) == pytest.approx(np.eye(4))
    told = json.loads((tmp_path / "out" / "knots.json").read_text())
    left = 1 - percent / 100
    assert left * np.array(told["knots"][0]["points"]) == pytest.approx(own.points)
    assert left * told["radius_mm"] == pytest.approx(2.0)
    alike = enlarge_knots(made).moved(shrink_of(made.scene))
    assert alike.knots[0].length_mm == pytest.approx(own.knots[0].length_mm)
