"""Pieces on every holder, written as a build writes them but without a search: rings, and arches."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from knotfab.base.folder import OutputFolder
from knotfab.knots import Knot, Knots
from knotfab.part.assemble import part_of
from knotfab.part.write import pose_scene, write_part
from knotfab.picture.read import Target
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene, SettledScene

from .curves import Array

RADIUS_MM, SIDES, WALL_MM = 2.5, 24, 40.0
HOLDERS: Mapping[str, Mapping[str, Any]] = {
    "wall pegs": {"mount": {"kind": "wall", "foot": "plate", "max_sag_mm": 0.02}},
    "full plate": {"mount": {"kind": "wall", "foot": "plate", "plate": "full"}},
    "outline plate": {"mount": {"kind": "wall", "foot": "plate", "plate": "outline"}},
    "drilled holes": {"mount": {"kind": "wall", "foot": "dowel", "max_sag_mm": 0.02}},
    "stand": {"mount": {"kind": "stand"}},
    "hang": {"mount": {"kind": "hang"}},
    "lamp frame": {"mount": {"kind": "none"}},
    "no supports": {"mount": {"kind": "none"}, "piece": {"supports": "none"}},
    "bare": {"mount": {"kind": "none"}},
}
LAMPS = {"red": ([1.0, 0.0, 0.0], -90.0), "blue": ([0.0, 0.0, 1.0], 90.0)}


def write_held(holder: str, folder: Path) -> None:
    """Write the files of a piece on a holder (one of `HOLDERS`) into a new folder."""
    knots = _knots_for(holder)
    scene = _scene(holder)
    targets = [_target(view.name, holder == "no supports") for view in scene.views]
    made: Any = SimpleNamespace(
        scene=scene, knots=knots, settings=SimpleNamespace(mesh_sides=SIDES)
    )
    part = part_of(made, True, targets)
    with OutputFolder(folder) as staged:
        write_part(staged, part, pose_scene(part), targets)
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
    if holder == "no supports":
        return Knots((Knot(_arches(3, 46.0)), Knot(_arches(3, 40.0))), RADIUS_MM)
    rings = [_ring(48.0, 6.0), _ring(30.0, 6.0)]
    if "plate" in holder:  # the lowest points stand in it
        rings = [_arches(4, 48.0), _arches(3, 30.0)]
        rings = [r - [0.0, 0.0, WALL_MM - 0.6 * RADIUS_MM] for r in rings]
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
    buffer = io.BytesIO()
    image.save(buffer, format="PNG")
    mask = np.asarray(image) < 128
    return Target(name=name, mask=mask, png_bytes=buffer.getvalue(), width=300, height=300)


def _arches(arches: int, plan: float, flank_deg: float = 55.0) -> Array:
    """A closed chain of arches about the light's axis, as `--supports none` makes them."""
    s = 2 * np.pi * plan / (2 * arches)  # from a valley to a peak, along the ring
    high = s * np.tan(np.radians(flank_deg))
    t = 2 * np.pi * np.arange(60 * arches) / (60 * arches)
    z = high * np.abs((t * arches / np.pi) % 2 - 1)
    smooth = np.mean([np.roll(z, k) for k in range(-7, 8)], axis=0)
    found: Array = np.column_stack([plan * np.cos(t), plan * np.sin(t), smooth - smooth.min()])
    return found
