"""The scene as frozen models: every key of scene.toml, with its default, unit and bounds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, Strict, StrictInt, StrictStr

__all__ = ["Accuracy", "Material", "Piece", "Pose", "Printer", "Region", "Scene", "View"]

# Strict: a number is a number (whole ones too), never a text or a truth value that looks like one.
Number = Annotated[float, Strict()]
Positive = Annotated[float, Strict(), Field(gt=0)]
NotNegative = Annotated[float, Strict(), Field(ge=0)]
Vector = tuple[Number, Number, Number]
Extent = tuple[Positive, Positive, Positive]
Row = tuple[Number, Number, Number, Number]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Piece(_Table):
    """What is asked of the tube."""

    tube_radius_mm: Positive | Literal["auto"] = "auto"
    knots: Annotated[int, Strict(), Field(ge=1)] | Literal["auto"] = "auto"
    depth: Positive | Literal["auto", "flat"] = "auto"
    clearance_mm: NotNegative = 0.4


class Region(_Table):
    """What the whole tube must stay inside (scene coordinates)."""

    kind: Literal["box", "cylinder", "sphere"] = "box"
    center_mm: Vector = (0.0, 0.0, 0.0)
    size_mm: Extent | Literal["auto"] = "auto"


class Material(_Table):
    """What the tube is made of; named materials are data files."""

    name: StrictStr = "pla"
    density_g_cm3: Positive = 1.24
    min_bend_radius_mm: Positive | Literal["auto"] = "auto"
    max_length_mm: Positive = 50000.0


class Printer(_Table):
    """What prints it; named printers are data files."""

    name: StrictStr = "prusa-mk4"
    build_volume_mm: Extent = (250.0, 210.0, 220.0)
    nozzle_mm: Positive = 0.4
    min_tube_radius_mm: Positive = 0.8


class View(_Table):
    """A light or an eye, the wall it looks at, and the picture that is to be there."""

    name: Annotated[str, Strict(), Field(pattern=r"^[A-Za-z0-9_-]+$")] = "front"
    kind: Literal["shadow", "eye"] = "shadow"
    picture: StrictStr = ""
    invert: Annotated[bool, Strict()] = False
    frame_width_mm: Positive | None = None
    frame_height_mm: Positive | None = None
    light_distance_mm: Positive = 500.0
    light_diameter_mm: NotNegative = 5.0
    wall_distance_mm: Positive = 100.0
    wall_tilt_deg: Annotated[float, Strict(), Field(gt=-80, lt=80)] = 0.0
    azimuth_deg: Number = 0.0


class Accuracy(_Table):
    """What the verified part must reach."""

    name: Literal["draft", "standard", "fine"] = "standard"
    iou_floor: Annotated[float, Strict(), Field(gt=0, lt=1)] | Literal["auto"] = "auto"
    max_outline_error_px: Positive = 0.5


class Pose(_Table):
    """Rigid motion from print coordinates to the scene."""

    matrix: tuple[Row, Row, Row, Row]


class Scene(_Table):
    """One scene. `search` is checked by `knotfab.search.settings`."""

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    piece: Piece = Piece()
    region: Region = Region()
    material: Material = Material()
    printer: Printer = Printer()
    views: Annotated[tuple[View, ...], Field(min_length=1)] = (View(),)
    accuracy: Accuracy = Accuracy()
    search: dict[str, Annotated[bool, Strict()] | StrictInt | Number | StrictStr] = {}
    pose: Pose | None = None
