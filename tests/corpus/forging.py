"""Forge a written piece: cut its solids, or change what its files say, and write all of them again."""

from __future__ import annotations

import copy
import json
import shutil
import tomllib
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import tomli_w
from manifold3d import Manifold, Mesh64, OpType

from knotfab.geometry.tube import as_mesh
from knotfab.part.plates import clean_body
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.geometry.mesh import number_bodies

from .curves import Array
from .files import encode
from .held import RADIUS_MM
from .parts import Body

ROUND = 48  # sides of a round tool
ALMOST = 1.04  # radii of a bar: a tool that takes all of it, and nothing beside
Forge = Callable[["Held"], object]


@dataclass
class Held:
    """A piece in hand: its solid in part coordinates, and what its files say.

    Its `bodies` are written as part.stl and part.3mf alike, so that they agree; those of `frame` as
    table-1.3mf.
    """

    folder: Path
    bodies: list[Manifold]
    knots: dict[str, Any]
    scene: dict[str, Any]
    frame: list[Manifold]

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
        """Write all files into a folder, which is emptied first."""
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.folder, folder)
        for form in ("stl", "3mf"):
            (folder / f"part.{form}").write_bytes(encode(body_of(self.bodies), form))
        if self.frame:
            (folder / "table-1.3mf").write_bytes(encode(body_of(self.frame), "3mf"))
        (folder / "knots.json").write_text(json.dumps(self.knots))
        (folder / "scene.toml").write_text(tomli_w.dumps(self.scene))

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


def rewrite_zip(path: Path, change: dict[str, bytes | None]) -> None:
    """Put entries into an archive, or others for them; None takes one out."""
    with zipfile.ZipFile(path) as file:
        entries: dict[str, bytes | None] = {n: file.read(n) for n in file.namelist()} | change
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in entries.items():
            if content is not None:
                info = zipfile.ZipInfo()
                info.filename = name  # as it is: a backslash too
                file.writestr(info, content)


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
