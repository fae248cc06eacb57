"""Read scene.toml as a validator sees it: the numbers that a finished part is measured against."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .read_mesh import BadFile

__all__ = [
    "Accuracy",
    "Material",
    "Piece",
    "Pose",
    "Printer",
    "Region",
    "Scene",
    "View",
    "parse_scene",
    "read_scene",
]

Vector = tuple[float, float, float]
Pose = tuple[tuple[float, ...], ...]  # 4 rows of 4


DEFAULT_PRINTER = "prusa-mk4"


@dataclass(frozen=True)
class Piece:
    """`tube_radius_mm` is None where the scene leaves it open ("auto")."""

    tube_radius_mm: float | None
    clearance_mm: float


@dataclass(frozen=True)
class Region:
    """What the tube must stay inside, scene coordinates; `size_mm` None: left open."""

    kind: str
    center_mm: Vector
    size_mm: Vector | None


@dataclass(frozen=True)
class Material:
    """`min_bend_radius_mm` None: the tube's radius plus half the clearance."""

    name: str
    density_g_cm3: float
    min_bend_radius_mm: float | None
    max_length_mm: float


@dataclass(frozen=True)
class Printer:
    """What the part must fit."""

    name: str
    build_volume_mm: Vector | None


@dataclass(frozen=True)
class View:
    """A light or an eye and its picture; a frame's side is None where the picture decides it."""

    name: str
    kind: str
    picture: str
    invert: bool
    frame_width_mm: float | None
    frame_height_mm: float | None
    light_distance_mm: float
    light_diameter_mm: float
    wall_distance_mm: float
    wall_tilt_deg: float
    azimuth_deg: float


@dataclass(frozen=True)
class Accuracy:
    """What the shadow must reach; `iou_floor` None: no floor is given."""

    name: str
    iou_floor: float | None
    max_outline_error_px: float


@dataclass(frozen=True)
class Scene:
    """One scene; `pose` (4 x 4 rows) takes part coordinates to scene coordinates, None: absent."""

    piece: Piece
    region: Region
    material: Material
    printer: Printer
    views: tuple[View, ...]
    accuracy: Accuracy
    pose: Pose | None


def read_scene(path: Path) -> Scene:
    """The scene of a scene.toml of schema 1; keys that are absent have their documented defaults.

    Raises:
        BadFile: the file cannot be read, or a key has an impossible value.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadFile(f"{path.name}: cannot be read ({error})") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise BadFile(f"{path.name}: is not TOML ({error})") from error
    return parse_scene(data, path.name)


def parse_scene(data: dict[str, Any], name: str = "scene.toml") -> Scene:
    """The scene in the parsed content of a scene.toml; raises BadFile as `read_scene` does."""
    if data.get("schema", 1) != 1:
        raise BadFile(f"{name}: schema is {data['schema']!r}, only 1 is known")
    piece = _Table(data.get("piece", {}), f"{name}: [piece]")
    region = _Table(data.get("region", {}), f"{name}: [region]")
    material = _Table(data.get("material", {}), f"{name}: [material]")
    printer = _Table(data.get("printer", {}), f"{name}: [printer]")
    accuracy = _Table(data.get("accuracy", {}), f"{name}: [accuracy]")
    views = data.get("views", [{}])
    if not isinstance(views, list) or not views:
        raise BadFile(f"{name}: [[views]] must name at least one view")
    kind = region.word("kind", "box", ("box", "cylinder", "sphere"))
    return Scene(
        piece=Piece(
            tube_radius_mm=piece.open_number("tube_radius_mm", None, above=0),
            clearance_mm=piece.number("clearance_mm", 0.4, least=0),
        ),
        region=Region(
            kind=kind,
            center_mm=region.vector("center_mm", (0.0, 0.0, 0.0)) or (0.0, 0.0, 0.0),
            size_mm=region.vector("size_mm", (240.0, 240.0, 180.0), above=0),
        ),
        material=Material(
            name=material.word("name", "pla"),
            density_g_cm3=material.number("density_g_cm3", 1.24, above=0),
            min_bend_radius_mm=material.open_number("min_bend_radius_mm", None, least=0),
            max_length_mm=material.number("max_length_mm", 50000.0, above=0),
        ),
        printer=Printer(
            name=printer.word("name", DEFAULT_PRINTER),
            build_volume_mm=_build_volume(printer),
        ),
        views=tuple(_view(v, f"{name}: view {i}") for i, v in enumerate(views)),
        accuracy=Accuracy(
            name=accuracy.word("name", "standard"),
            iou_floor=accuracy.open_number("iou_floor", 0.96, least=0),
            max_outline_error_px=accuracy.number("max_outline_error_px", 0.5, above=0),
        ),
        pose=_pose(data.get("pose"), name),
    )


def _build_volume(printer: _Table) -> Vector | None:
    """Of the scene, or of the default printer; None where only another printer's name is given."""
    if (
        "build_volume_mm" not in printer.data
        and printer.data.get("name", DEFAULT_PRINTER) != DEFAULT_PRINTER
    ):
        return None
    return printer.fixed_vector("build_volume_mm", (250.0, 210.0, 220.0))


def _view(data: Any, where: str) -> View:
    table = _Table(data, where)
    return View(
        name=table.word("name", "front"),
        kind=table.word("kind", "shadow", ("shadow", "eye")),
        picture=table.word("picture", ""),
        invert=bool(data.get("invert", False)),
        frame_width_mm=table.open_number("frame_width_mm", None, above=0),
        frame_height_mm=table.open_number("frame_height_mm", None, above=0),
        light_distance_mm=table.number("light_distance_mm", 500.0, above=0),
        light_diameter_mm=table.number("light_diameter_mm", 5.0, least=0),
        wall_distance_mm=table.number("wall_distance_mm", 100.0, above=0),
        wall_tilt_deg=table.number("wall_tilt_deg", 0.0),
        azimuth_deg=table.number("azimuth_deg", 0.0),
    )


def _pose(data: Any, name: str) -> Pose | None:
    """The rigid motion in [pose], None without one."""
    if data is None:
        return None
    try:
        matrix = np.array(data["matrix"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise BadFile(f"{name}: [pose] matrix must be 4 rows of 4 numbers") from error
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise BadFile(f"{name}: [pose] matrix must be 4 rows of 4 numbers")
    turn = matrix[:3, :3]
    rigid = (
        np.abs(turn @ turn.T - np.eye(3)).max() < 1e-6
        and np.linalg.det(turn) > 0
        and np.array_equal(matrix[3], [0, 0, 0, 1])
    )
    if not rigid:
        raise BadFile(f"{name}: [pose] matrix is not a rigid motion")
    return tuple(tuple(float(x) for x in row) for row in matrix)


class _Table:
    """A table's values, each checked for its kind and range."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise BadFile(f"{where} must be a table")
        self.data, self.where = data, where

    def word(self, key: str, default: str, allowed: tuple[str, ...] = ()) -> str:
        value = self.data.get(key, default)
        if not isinstance(value, str) or (allowed and value not in allowed):
            wanted = f"one of {', '.join(allowed)}" if allowed else "a text"
            raise BadFile(f"{self.where} {key} must be {wanted}, got {value!r}")
        return value

    def number(
        self, key: str, default: float, *, least: float = -math.inf, above: float = -math.inf
    ) -> float:
        value = self.data.get(key, default)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
            or value < least
            or value <= above
        ):
            raise BadFile(f"{self.where} {key} has an impossible value, {value!r}")
        return float(value)

    def open_number(
        self,
        key: str,
        default: float | None,
        *,
        least: float = -math.inf,
        above: float = -math.inf,
    ) -> float | None:
        """None where the scene says "auto", or says nothing and there is no default."""
        value = self.data.get(key, default)
        if value is None or value == "auto":
            return None
        return self.number(key, 0.0, least=least, above=above) if key in self.data else default

    def vector(self, key: str, default: Vector, *, above: float = -math.inf) -> Vector | None:
        """Three numbers, or None where the scene says "auto"."""
        if self.data.get(key) == "auto":
            return None
        return self.fixed_vector(key, default, above=above)

    def fixed_vector(self, key: str, default: Vector, *, above: float = -math.inf) -> Vector:
        value = self.data.get(key, default)
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise BadFile(f"{self.where} {key} must be three numbers, got {value!r}")
        x, y, z = (_Table({key: item}, self.where).number(key, 0.0, above=above) for item in value)
        return (x, y, z)
