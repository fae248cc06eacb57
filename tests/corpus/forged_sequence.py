"""A sequence of three frames, written without a search, and forgeries of the second."""

import re
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from knotfab.base.folder import OutputFolder
from knotfab.geometry.tube import sweep
from knotfab.knots import Knot, Knots, read_knots
from knotfab.part.assemble import clean_body, part_of
from knotfab.part.write import pose_scene, write_part
from knotfab.picture.read import Target
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene, SettledScene
from knotfab_validators import validate

from .curves import Array, torus_knot
from .files import encode
from .forging import RADIUS_MM, SIDES, ball, body_of, collar, rod, solids_of
from .parts import Body

Forge = Callable[[Path], object]
FRAMES = ((46.0, 34.0), (38.0, 44.0), (30.0, 48.0))  # semi-axes of the loops, mm


@cache
def sequence_folder() -> Path:
    """Write the frames, as `knotfab build --sequence` names their files; returns the folder."""
    folder = Path(mkdtemp()) / "sequence"
    with OutputFolder(folder) as staged:
        for number, axes in enumerate(FRAMES, start=1):
            _write_frame(staged, number, _loop(*axes))
        staged.commit()
    return folder


def _loop(wide: float, high: float, n: int = 160) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([wide * np.cos(t), high * np.sin(t), 5.0 * np.sin(3 * t)])


def _write_frame(staged: OutputFolder, number: int, points: Array) -> None:
    knots, name = Knots((Knot(points),), RADIUS_MM), f"frame-{number:02d}"
    scene = _scene(name)
    camera = camera_of(scene.views[0], 300, 300)
    drawn = np.asarray(camera.project(points))[:, :2]
    image = Image.new("L", (300, 300), 255)
    reach = RADIUS_MM * np.ptp(drawn, axis=0).max() / np.ptp(points, axis=0).max()  # px
    for x, y in drawn:
        ImageDraw.Draw(image).ellipse((x - reach, y - reach, x + reach, y + reach), fill=0)
    target = Target(name, np.asarray(image) < 128)
    made: Any = SimpleNamespace(
        scene=scene, knots=knots, settings=SimpleNamespace(mesh_sides=SIDES)
    )
    part = part_of(made, True, [target])
    write_part(staged, part, pose_scene(part), [target], suffix=f"-{number:02d}")


def _scene(name: str) -> SettledScene:
    view = {
        "name": name, "picture": f"picture-{name}.png",
        "frame_width_mm": 150.0, "frame_height_mm": 150.0, "wall_distance_mm": 40.0,
    }  # fmt: skip
    asked = {
        "schema": 1, "views": [view], "mount": {"kind": "none"},
        "piece": {"tube_radius_mm": RADIUS_MM, "knots": 1, "printed": True},
        "region": {"size_mm": [140.0, 140.0, 150.0]},
        "accuracy": {"name": "draft", "iou_floor": 0.6, "max_outline_error_px": 8.0},
    }  # fmt: skip
    resolved = resolve(Scene.model_validate(asked)).model_dump(by_alias=True)
    resolved["material"] |= {"min_bend_radius_mm": RADIUS_MM}
    return SettledScene.model_validate(resolved)


def judge_frame(folder: Path, number: int = 2) -> tuple[str, ...]:
    """Validate a frame; return the required checks that fail, or the sentence that refuses it."""
    files = (f"part-{number:02d}.stl", f"knots-{number:02d}.json", f"scene-{number:02d}.toml")
    try:
        checks = validate(*(folder / name for name in files), skip={"shadow-render"}).checks
    except ValueError as error:
        return (str(error),)
    return tuple(c.name for c in checks if c.required and c.status not in ("pass", "skipped"))


def plain_frame(number: int, folder: Path) -> Path:
    """Copy a frame's files to a folder as those of a single piece; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    of, suffix = sequence_folder(), f"-{number:02d}"
    for path in of.glob(f"*{suffix}.*"):
        alone = path.name if path.suffix == ".png" else path.name.replace(suffix, "")
        shutil.copy(path, folder / alone)
    return folder


def forge_frame(forge: Forge, folder: Path) -> Path:
    """Copy the sequence to a folder, and forge it there."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(sequence_folder(), folder)
    forge(folder)
    return folder


def forged_sequence() -> Iterator[tuple[str, Forge]]:
    """List the forgeries of frame 2 by name."""
    for other in (1, 3):
        yield f"the part of frame {other}", _take(other, "part-{}.stl", "part-{}.3mf")
        yield f"the 3MF of frame {other}", _take(other, "part-{}.3mf")
        yield f"the STL of frame {other}", _take(other, "part-{}.stl")
        yield f"the knots of frame {other}", _take(other, "knots-{}.json")
        yield (
            f"part and knots of frame {other}",
            _take(other, "part-{}.stl", "part-{}.3mf", "knots-{}.json"),
        )
        yield f"the picture of frame {other}", _take(other, "picture-frame-{}.png")
        yield f"a scene that names frame {other}", _name(other)
    yield "no picture", lambda folder: (folder / "picture-frame-02.png").unlink()
    yield "a neck", _cut(lambda at, along: collar(at, along, 0.4, 1.5 * RADIUS_MM, 2.0))
    yield "a cut", _cut(lambda at, along: collar(at, along, 0.0001, 1.5 * RADIUS_MM, 1.0))
    yield "a void", _cut(lambda at, along: ball(at, 0.6 * RADIUS_MM))
    yield "a bridge across the loop", _bridge
    yield "a trefoil of the same width", _trefoil
    yield "scaled by 2 %", lambda folder: _rebuild(folder, 1.02 * np.eye(3))
    yield "mirrored", lambda folder: _rebuild(folder, np.diag([1.0, 1.0, -1.0]))
    yield "turned by 8 degrees", lambda folder: _rebuild(folder, _turn(8.0))


def _take(other: int, *names: str) -> Forge:
    def take(folder: Path) -> None:
        for name in names:
            shutil.copy(folder / name.format(f"{other:02d}"), folder / name.format("02"))

    return take


def _name(other: int) -> Forge:
    def rename(folder: Path) -> None:
        path = folder / "scene-02.toml"
        named = re.sub(r"picture-frame-02", f"picture-frame-{other:02d}", path.read_text())
        path.write_text(named)

    return rename


def _write(folder: Path, body: Body) -> None:
    for form in ("stl", "3mf"):
        (folder / f"part-02.{form}").write_bytes(encode(body, form))


def _cut(tool: Callable[[Array, Array], Any]) -> Forge:
    def cut(folder: Path) -> None:
        points = read_knots(folder / "knots-02.json").points[:160]
        (solid,) = solids_of(folder / "part-02.stl")
        _write(folder, body_of([solid - tool(points[0], points[1] - points[-1])]))

    return cut


def _bridge(folder: Path) -> None:
    points = read_knots(folder / "knots-02.json").points
    (solid,) = solids_of(folder / "part-02.stl")
    _write(folder, body_of([solid + rod(points[0], points[len(points) // 2], 1.0)]))


def _rebuild(folder: Path, matrix: Array) -> None:
    """Transform the part about its middle, and leave what the other files say."""
    (solid,) = solids_of(folder / "part-02.stl")
    body = body_of([solid])
    middle = body.vertices.mean(axis=0)
    faces = body.faces if np.linalg.det(matrix) > 0 else body.faces[:, ::-1]
    _write(folder, Body((body.vertices - middle) @ matrix.T + middle, faces))


def _turn(angle_deg: float) -> Array:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _trefoil(folder: Path) -> None:
    body = body_of(solids_of(folder / "part-02.stl"))
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    points = torus_knot(2, 3)
    points = points * (high - low)[:2].min() / np.ptp(points, axis=0)[:2].max()
    points = points - points.mean(axis=0) + (low + high) / 2
    vertices, faces = clean_body(sweep(points, RADIUS_MM, SIDES))
    _write(folder, Body(vertices, faces.astype(np.int64)))
