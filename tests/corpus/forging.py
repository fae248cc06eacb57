"""Pieces on every holder, written without a search; cut their solids or change what their files say."""

from __future__ import annotations

import copy
import json
import shutil
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
import tomli_w
from manifold3d import Manifold, Mesh64, OpType
from PIL import Image, ImageDraw
from shapely import MultiPolygon

from knotfab.base.folder import OutputFolder
from knotfab.effects.base import World
from knotfab.geometry.tube import as_mesh
from knotfab.knots import Knot, Knots
from knotfab.part.assemble import clean_body, part_of
from knotfab.part.write import pose_scene, write_part
from knotfab.picture.read import Target
from knotfab.problem import TargetView, brace
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene, SettledScene
from knotfab_formats.slicer_ini import PROFILE, STYLES, imply_settings
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.mesh import number_bodies

from .curves import Array
from .files import encode
from .parts import Body

ROUND = 48  # sides of a round tool
ALMOST = 1.04  # radii of a bar: a tool that takes all of it, and nothing beside
Forge = Callable[["Held"], object]


@dataclass
class Held:
    """A piece in hand: its solid in part coordinates, and what its files say.

    Its `bodies` are written as part.stl and part.3mf alike, so that they agree; those of `frame` as
    table-1.3mf. `files` are then changed by name, or taken out.
    """

    folder: Path
    bodies: list[Manifold]
    knots: dict[str, Any]
    scene: dict[str, Any]
    frame: list[Manifold]
    files: dict[str, Callable[[bytes], bytes] | None] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path) -> Self:
        frame = folder / "table-1.3mf"
        return cls(
            folder,
            solids_of(folder / "part.stl"),
            json.loads((folder / "knots.json").read_text()),
            tomllib.loads((folder / "scene.toml").read_text()),
            solids_of(frame) if frame.is_file() else [],
        )

    def copy(self) -> Held:
        said = copy.deepcopy(self.knots), copy.deepcopy(self.scene)
        return Held(self.folder, list(self.bodies), *said, list(self.frame))

    def write(self, folder: Path) -> None:
        """Write all files into a folder, which is emptied first; solids only where no file is changed."""
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.folder, folder)
        (folder / "knots.json").write_text(json.dumps(self.knots))
        (folder / "scene.toml").write_text(tomli_w.dumps(self.scene))
        for name, change in self.files.items():
            content = (folder / name).read_bytes()
            (folder / name).unlink()
            if change is not None:
                (folder / name).write_bytes(change(content))
        if self.files:
            return
        body = body_of(self.bodies)
        for form in ("stl", "3mf"):
            (folder / f"part.{form}").write_bytes(encode(body, form))
        if self.frame:
            (folder / "table-1.3mf").write_bytes(encode(body_of(self.frame), "3mf"))

    def cut(self, *tools: Manifold) -> Held:
        for tool in tools:
            cut = [body - tool if _meet(body, tool) else body for body in self.bodies]
            self.bodies = [body for body in cut if not body.is_empty()]
        return self

    def add(self, *tools: Manifold) -> Held:
        """Add matter, united with every body that it meets."""
        for tool in tools:
            met = [body for body in self.bodies if _meet(body, tool)]
            rest = [body for body in self.bodies if not _meet(body, tool)]
            self.bodies = [Manifold.batch_boolean([tool, *met], OpType.Add), *rest]
        return self


def _meet(one: Manifold, other: Manifold) -> bool:
    return not (one ^ other).is_empty()


def solids_of(path: Path) -> list[Manifold]:
    """Read the bodies of a file, in their order."""
    mesh = read_mesh(path)
    body, count = number_bodies(mesh)
    of_face = body[mesh.faces[:, 0]]
    return [
        Manifold(Mesh64(mesh.vertices, mesh.faces[of_face == k].astype(np.uint64)))
        for k in range(count)
    ]


def body_of(solids: Sequence[Manifold]) -> Body:
    """Join the meshes of solids, closed in single precision too."""
    meshes = [clean_body(as_mesh(solid)) for solid in solids]
    shift = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + k for (_, faces), k in zip(meshes, shift, strict=False)]
    return Body(np.concatenate([v for v, _ in meshes]), np.concatenate(faces).astype(np.int64))


# Tools: round bars, boxes and balls, where they are needed.


def rod(start: Array, end: Array, radius: float, end_radius: float | None = None) -> Manifold:
    """A cone from a point (3,) to another."""
    span = np.asarray(end, dtype=float) - start
    length = float(np.linalg.norm(span))
    last = radius if end_radius is None else end_radius
    return _place(Manifold.cylinder(length, radius, last, ROUND), start, span / length)


def disc(at: Array, along: Array, radius: float, thick: float) -> Manifold:
    """A flat cylinder around a point, across a direction."""
    half = thick / 2 * along / np.linalg.norm(along)
    return rod(at - half, at + half, radius)


def collar(at: Array, along: Array, inner: float, outer: float, thick: float) -> Manifold:
    """A ring of matter around a bar: cutting it necks the bar down to `inner`."""
    return disc(at, along, outer, thick) - disc(at, along, inner, 2 * thick)


def ball(at: Array, radius: float) -> Manifold:
    return Manifold.sphere(radius, ROUND).translate(np.asarray(at))


def box(at: Array, sides: tuple[float, float, float], axes: Array | None = None) -> Manifold:
    """A box around a point; `axes` (3, 3), rows: its own."""
    solid = Manifold.cube(sides, True)
    turn = np.eye(3) if axes is None else axes.T
    return solid.transform(np.column_stack([turn, at]))


def axes_of(along: Array) -> Array:
    """Return two directions across a direction, and itself, as rows (3, 3), right-handed."""
    along = along / np.linalg.norm(along)
    u = np.cross(np.eye(3)[int(np.abs(along).argmin())], along)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(along, u), along])


def _place(solid: Manifold, at: Array, along: Array) -> Manifold:
    return solid.transform(np.column_stack([axes_of(along).T, at]))


# What is forged: bars and hulls of knots.json.


@dataclass(frozen=True)
class Bar:
    start: Array
    end: Array
    radius: float

    @property
    def along(self) -> Array:
        return np.asarray((self.end - self.start) / np.linalg.norm(self.end - self.start))

    def at(self, share: float) -> Array:
        return np.asarray(self.start + share * (self.end - self.start))

    @property
    def bare(self) -> tuple[Array, Array]:
        """Its ends where it leaves the strand, and at its foot."""
        return self.start + 1.1 * RADIUS_MM * self.along, self.end


def bar_of(held: Held, key: str, number: int) -> Bar:
    one = held.knots[key][number]
    radius = np.max(one["radius_mm"])
    return Bar(np.array(one["from"]), np.array(one["to"]), float(radius))


def hull_of(one: Any) -> Manifold:
    return Manifold.hull_points(np.array(one["corners"]))


def span_of(held: Held) -> tuple[Array, Array]:
    boxes = np.array([body.bounding_box() for body in held.bodies])
    return boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)


RADIUS_MM, SIDES, WALL_MM = 2.5, 24, 40.0
HOLDERS: Mapping[str, Mapping[str, Any]] = {
    "wall pegs": {"mount": {"kind": "wall", "foot": "plate", "max_sag_mm": 0.02}},
    "roots": {"mount": {"kind": "wall", "foot": "plate", "plate": "roots"}},
    "rounded plate": {"mount": {"kind": "wall", "foot": "plate", "plate": "rounded"}},
    "full plate": {"mount": {"kind": "wall", "foot": "plate", "plate": "full"}},
    "outline plate": {"mount": {"kind": "wall", "foot": "plate", "plate": "outline"}},
    "drilled holes": {"mount": {"kind": "wall", "foot": "dowel", "max_sag_mm": 0.02}},
    "stand": {"mount": {"kind": "stand"}},
    "hang": {"mount": {"kind": "hang"}},
    "hang, no supports": {"mount": {"kind": "hang"}, "piece": {"supports": "none"}},
    "lamp frame": {"mount": {"kind": "none"}},
    "no supports": {"mount": {"kind": "none"}, "piece": {"supports": "none"}},
    "bare": {"mount": {"kind": "none"}},
}
FILLED = (
    "no supports",
    "roots",
    "hang, no supports",
)  # pictures of a disc, which hides what joins the rings
LAMPS = {"red": ([1.0, 0.0, 0.0], -90.0), "blue": ([0.0, 0.0, 1.0], 90.0)}


def write_held(holder: str, folder: Path) -> None:
    """Write the files of a piece on a holder (one of `HOLDERS`) into a new folder."""
    knots = _knots_for(holder)
    scene = _scene(holder)
    targets = [_target(view.name, holder in FILLED) for view in scene.views]
    seen = TargetView(scene.views[0], targets[0].mask, MultiPolygon())
    result = SimpleNamespace(braced=brace(knots, seen, World.from_scene(scene)))
    settings = SimpleNamespace(mesh_sides=SIDES)
    made: Any = SimpleNamespace(scene=scene, knots=knots, settings=settings, result=result)
    part = part_of(made, True, targets)
    with OutputFolder(folder) as staged:
        write_part(staged, part, pose_scene(part), targets)
        asked = scene.printer, scene.material, scene.mount, scene.piece.tube_radius_mm
        profile = imply_settings(*asked, scene.piece.supports == "none", STYLES[0])
        staged.write(PROFILE, "".join(f"{k} = {v}\n" for k, v in profile.items()))
        staged.commit()


def _scene(holder: str) -> SettledScene:
    view = {
        "name": "front", "picture": "picture-front.png",
        "frame_width_mm": 150.0, "frame_height_mm": 150.0, "wall_distance_mm": WALL_MM,
    }  # fmt: skip
    views = [view]
    if holder == "lamp frame":
        own = {"light_distance_mm": 400.0, "light_up_mm": 0.0}
        views = [
            {**view, **own, "name": name, "picture": f"picture-{name}.png", "lamp_colour": colour,
             "light_right_mm": right}
            for name, (colour, right) in LAMPS.items()
        ]  # fmt: skip
        views[1]["wall"] = views[0]["name"]
    asked = dict(HOLDERS[holder])
    piece = {"tube_radius_mm": RADIUS_MM, "knots": 2, "printed": True, **asked.pop("piece", {})}
    asked |= {"views": views, "piece": piece, "region": {"size_mm": [140.0, 140.0, 150.0]}}
    asked |= {"accuracy": {"name": "draft", "iou_floor": 0.01, "max_outline_error_px": 1.0}}
    resolved = resolve(Scene.model_validate({"schema": 1, **asked})).model_dump(by_alias=True)
    resolved["material"] |= {"min_bend_radius_mm": RADIUS_MM}
    return SettledScene.model_validate(resolved)


def _knots_for(holder: str) -> Knots:
    if holder == "hang, no supports":
        return Knots((Knot(_arches(4, 46.0, 60.0)), Knot(_arches(4, 40.0, 60.0))), RADIUS_MM)
    if holder == "no supports":
        return Knots((Knot(_arches(3, 46.0, 60.0)), Knot(_arches(3, 40.0, 60.0))), RADIUS_MM)
    rings = [_ring(48.0, 6.0), _ring(30.0, 6.0)]
    if "plate" in holder or holder == "roots":  # the lowest points stand in it, or on the wall
        rings = [_arches(4, 48.0), _arches(3, 30.0)]
        high = 1.1 * RADIUS_MM if holder == "roots" else 0.6 * RADIUS_MM
        rings = [r - [0.0, 0.0, WALL_MM - high] for r in rings]
    return Knots(tuple(Knot(r) for r in rings), RADIUS_MM)


def _ring(radius: float, wave: float, n: int = 160) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    found: Array = np.column_stack([radius * np.cos(t), radius * np.sin(t), wave * np.sin(3 * t)])
    return found


def _target(name: str, filled: bool) -> Target:
    """Draw both rings; `filled`: a disc, which hides bars between them."""
    image = Image.new("L", (300, 300), 255)
    draw = ImageDraw.Draw(image)
    for radius in (48.0, 30.0):  # of the rings, in a frame of 150 mm: 2 px for each mm
        reach = 2 * 1.08 * radius
        box = (150 - reach, 150 - reach, 150 + reach, 150 + reach)
        draw.ellipse(box, outline=0, width=12, fill=0 if filled else None)
    return Target(name, np.asarray(image) < 128)


def _arches(arches: int, plan: float, flank_deg: float = 55.0) -> Array:
    """A closed chain of arches about the light's axis, as `--supports none` makes them."""
    s = 2 * np.pi * plan / (2 * arches)  # from a valley to a peak, along the ring
    high = s * np.tan(np.radians(flank_deg))
    t = 2 * np.pi * np.arange(60 * arches) / (60 * arches)
    z = high * np.abs((t * arches / np.pi) % 2 - 1)
    smooth = np.mean([np.roll(z, k) for k in range(-7, 8)], axis=0)
    found: Array = np.column_stack([plan * np.cos(t), plan * np.sin(t), smooth - smooth.min()])
    return found
