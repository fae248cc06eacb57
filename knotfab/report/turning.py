"""A piece of several views that turns under one fixed lamp: at which angles it shows its pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array
from knotfab.drawing.dimensions import length
from knotfab.drawing.gif import write_gif
from knotfab.drawing.part_picture import turn_upright
from knotfab.geometry.polylines import polylines_of
from knotfab.knots import Knots
from knotfab.mount.mount import Mounted
from knotfab.render.picture import image_at
from knotfab.scene.camera import view_axes
from knotfab_formats.report import Turning
from knotfab_formats.scene import SettledScene

__all__ = ["TURN_FILE", "turn_piece", "turns_of"]

TURN_FILE = "turn.gif"
STEP_DEG, PIXELS = 5.0, 240
FRAME_MS, HOLD_MS = 60, 900  # while it turns, and where it shows a picture
WALL, SHADOW = (250, 248, 244), (52, 49, 45)
_LEAST_MM = 1.0  # the least shift to the side that is told
# keys that must be the same in all views for one lamp to serve them
_SHARED = (
    *("kind", "light_distance_mm", "wall_distance_mm", "wall_tilt_deg", "wall_radius_mm"),
    *("elevation_deg", "light_right_mm", "light_up_mm"),
)


def turns_of(scene: SettledScene) -> dict[str, float]:
    """Give the angle, 0 to 360 degrees, by which the piece is turned for each view before the first's lamp.

    The turn is about the vertical, anticlockwise from above. Views with lamps or walls of their own heights
    and distances share no lamp, and have no angles; nor has an eye, nor one view alone.
    """
    first = scene.views[0]
    alike = all(getattr(v, key) == getattr(first, key) for v in scene.views for key in _SHARED)
    if len(scene.views) < 2 or not alike or first.kind != "shadow" or first.elevation_deg != 0:
        return {}
    angles = {}
    for view in scene.views:
        turn = view_axes(first).T @ view_axes(view)
        angles[view.name] = float(np.degrees(np.arctan2(turn[0, 2], turn[0, 0]))) % 360.0
    return angles


def turn_piece(folder: Path, mounted: Mounted, knots: Knots) -> tuple[Turning | None, list[str]]:
    """Tell how a piece on a stand or thread shows its pictures in turn, with a note; write turn.gif."""
    angles = turns_of(mounted.scene)
    if not angles or (mounted.stand is None and mounted.hang is None):
        return None, []
    axis = np.zeros(3) if mounted.hang is None else mounted.hang.eyelet.thread
    view = mounted.scene.views[0]
    aside = {}
    for name, angle in angles.items():
        moved = (axis - turn_upright(axis, angle)) @ view_axes(view)[0]
        aside[name] = float(moved) * view.magnification
    words = [f"{name} at {angle:.0f}°{_beside(aside[name])}" for name, angle in angles.items()]
    about = (
        "its thread" if mounted.stand is None else "the vertical through the middle of the scene"
    )
    note = f"Turned about {about} under the first lamp alone, it shows {', '.join(words)} ({TURN_FILE})."
    _write_turn(folder / TURN_FILE, mounted.scene, knots, axis, list(angles.values()))
    return Turning(angles, aside), [note]


def _beside(aside_mm: float) -> str:
    if abs(aside_mm) < _LEAST_MM:
        return ""
    return f" ({length(abs(aside_mm))} mm to the {'right' if aside_mm > 0 else 'left'})"


def _write_turn(
    path: Path, scene: SettledScene, knots: Knots, axis: Array, shown: list[float]
) -> None:
    view, curves = scene.views[0], [knot.points for knot in knots.knots]
    points, rings = np.concatenate(curves), polylines_of(curves)
    reach = float(np.hypot(*(points - axis)[:, [0, 2]].T).max() + np.hypot(axis[0], axis[2]))
    near = view.light_distance_mm / max(view.light_distance_mm - reach, 1.0)
    wide = 2.2 * (reach + knots.radius_mm) * near * view.magnification
    high = 2.2 * (np.abs(points[:, 1]).max() + knots.radius_mm) * near * view.magnification
    frame = {
        "frame_width_mm": max(wide, view.frame_width_mm),
        "frame_height_mm": max(high, view.frame_height_mm),
        "frame_up_mm": 0.0,
    }
    image = image_at(view.but(**frame), np.zeros((8, 8), dtype=bool), knots.radius_mm, PIXELS)
    turns = sorted({*np.arange(0.0, 360.0, STEP_DEG), *shown})
    frames = []
    for angle in turns:
        dark = image.seen(turn_upright(points - axis, angle) + axis, rings, knots.radius_mm)
        frames.append(Image.fromarray(np.where(dark[..., None], SHADOW, WALL).astype(np.uint8)))
    write_gif(path, frames, [HOLD_MS if angle in shown else FRAME_MS for angle in turns])
