"""Where the lamp stood: the displacement whose shadow of the knots is most like the one that was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage
from scipy.optimize import minimize

from knotfab.base.arrays import Array, Mask
from knotfab.knots import Knots
from knotfab.picture.masks import mask_iou
from knotfab.picture.silhouette import resample_mask
from knotfab.scene.camera import Camera

__all__ = ["LampFit", "cast_shadow", "find_lamp"]

_STEP_MM = (8.0, 8.0, 40.0)  # of the simplex, and the scale of the unknowns
_COARSER = 2  # than what the IoU is measured on
_SOFT_PX = (4.0, 1.5)  # by which both pictures are blurred, first and then
_MOST_TURNS = 90
_FARTHEST = 1.0  # of its distance from the wall by which a lamp may be off
_FINER = 2  # drawn so many times as large, and brought down


@dataclass(frozen=True)
class LampFit:
    """How far the lamp stood from its place, mm: to the right, up, and away from the wall.

    IoU of the shadow that was seen with that of the knots, for the lamp in its place and where it stood.
    """

    right_mm: float
    up_mm: float
    away_mm: float
    iou_in_place: float
    iou: float


def cast_shadow(knots: Knots, camera: Camera, eye: Array) -> Array:
    """(H, W) share of each pixel of `camera`'s frame that the knots darken for a lamp at `eye`.

    Args:
        knots: in the scene.
    """
    size = (camera.width * _FINER, camera.height * _FINER)
    sheet = Image.new("L", size)
    draw = ImageDraw.Draw(sheet)
    moved = replace(camera, eye=eye)
    px = 1.0 / float(np.linalg.norm(camera.du))
    for knot in knots.knots:
        points = knot.points
        at = _FINER * (moved.project(points) + 0.5)
        half = _FINER * px * knots.radius_mm * moved.magnify(points)
        ends = np.roll(at, -1, axis=0)
        for (a, b, c, d), wide in zip(np.concatenate([at, ends], axis=1), half, strict=True):
            draw.line((a, b, c, d), fill=255, width=max(1, round(2 * wide)))
            draw.ellipse((a - wide, b - wide, a + wide, b + wide), fill=255)
    small = sheet.resize((camera.width, camera.height), Image.Resampling.BOX)
    return np.asarray(small, dtype=np.float64) / 255.0


def find_lamp(knots: Knots, camera: Camera, seen: Mask) -> LampFit:
    """Fit the lamp's displacement to the shadow that was seen, on `camera`'s frame.

    Nelder and Mead's simplex on the squared difference of both pictures, blurred: much first, then less.
    """
    full = camera
    camera = camera.resized(camera.width // _COARSER, camera.height // _COARSER)
    coarse = resample_mask(seen, camera.width, camera.height).astype(np.float64)
    axes = np.stack([camera.du / np.linalg.norm(camera.du), -camera.dv / np.linalg.norm(camera.dv)])
    axes = np.concatenate([axes, np.cross(axes[0], axes[1])[None]])
    if axes[2] @ camera.receiver[:3] < 0:
        axes[2] = -axes[2]
    step = np.array(_STEP_MM)
    wall, offset = camera.receiver[:3], float(camera.receiver[3])
    reach = float(camera.eye @ wall) + offset
    front = float((knots.points @ wall).max()) + offset + knots.radius_mm
    found = np.zeros(3)
    for soft in _SOFT_PX:
        wanted = ndimage.gaussian_filter(coarse, soft)

        def unlike(unknown: Array, soft: float = soft, wanted: Array = wanted) -> float:
            eye = camera.eye + (unknown * step) @ axes
            # a shadow of something else has led lamps behind the piece, and kilometres away
            if eye @ wall + offset < front or np.linalg.norm(unknown * step) > _FARTHEST * reach:
                return np.inf
            cast = cast_shadow(knots, camera, eye)
            return float(((ndimage.gaussian_filter(cast, soft) - wanted) ** 2).sum())

        corners = np.concatenate([found[None], found + np.eye(3)])
        options = {"initial_simplex": corners, "maxfev": _MOST_TURNS, "xatol": 0.02, "fatol": 1e-3}
        found = minimize(unlike, found, method="Nelder-Mead", options=options).x

    def likeness(at: Array) -> float:
        return mask_iou(cast_shadow(knots, full, full.eye + at @ axes) > 0.5, seen)

    right, up, away = (float(v) for v in found * step)
    return LampFit(right, up, away, likeness(np.zeros(3)), likeness(found * step))
