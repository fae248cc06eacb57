"""The scene as frozen models: every key of scene.toml, with its default, unit and bounds."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["Accuracy", "Material", "Piece", "Pose", "Printer", "Region", "Scene", "View"]

Positive = Field(gt=0, allow_inf_nan=False)
Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=False, allow_inf_nan=False)


class Piece(_Table):
    """What is asked of the tube."""

    tube_radius_mm: float | Literal["auto"] = "auto"
    knots: int | Literal["auto"] = "auto"
    depth: float | Literal["auto", "flat"] = "auto"
    clearance_mm: float = Field(0.4, ge=0)


class Region(_Table):
    """What the whole tube must stay inside (scene coordinates)."""

    kind: Literal["box", "cylinder", "sphere"] = "box"
    center_mm: Vector = (0.0, 0.0, 0.0)
    size_mm: Vector | Literal["auto"] = "auto"


class Material(_Table):
    """What the tube is made of; named materials are data files."""

    name: str = "pla"
    density_g_cm3: float = Field(1.24, gt=0)
    min_bend_radius_mm: float | Literal["auto"] = "auto"
    max_length_mm: float = Field(50000.0, gt=0)


class Printer(_Table):
    """What prints it; named printers are data files."""

    name: str = "prusa-mk4"
    build_volume_mm: Vector = (250.0, 210.0, 220.0)
    nozzle_mm: float = Field(0.4, gt=0)
    min_tube_radius_mm: float = Field(0.8, gt=0)


class View(_Table):
    """A light or an eye, the wall it looks at, and the picture that is to be there."""

    name: str = Field("front", pattern=r"^[A-Za-z0-9_-]+$")
    kind: Literal["shadow", "eye"] = "shadow"
    picture: str = ""
    invert: bool = False
    frame_width_mm: float | None = Field(None, gt=0)
    frame_height_mm: float | None = Field(None, gt=0)
    light_distance_mm: float = Field(500.0, gt=0)
    light_diameter_mm: float = Field(5.0, ge=0)
    wall_distance_mm: float = Field(100.0, gt=0)
    wall_tilt_deg: float = Field(0.0, gt=-80, lt=80)
    azimuth_deg: float = 0.0


class Accuracy(_Table):
    """What the verified part must reach."""

    name: Literal["draft", "standard", "fine"] = "standard"
    iou_floor: float | Literal["auto"] = "auto"
    max_outline_error_px: float = Field(0.5, gt=0)


class Pose(_Table):
    """Rigid motion from print coordinates to the scene."""

    matrix: tuple[Row, Row, Row, Row]


class Scene(_Table):
    """One scene. `search` is checked by `knotfab.search.settings`."""

    schema_: Literal[1] = Field(1, alias="schema")
    piece: Piece = Piece()
    region: Region = Region()
    material: Material = Material()
    printer: Printer = Printer()
    views: tuple[View, ...] = (View(),)
    accuracy: Accuracy = Accuracy()
    search: dict[str, float | int | str | bool] = {}
    pose: Pose | None = None
