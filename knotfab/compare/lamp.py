"""Find the lamp: the displacement whose shadow of the knots is most like the one that was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize

from knotfab.base.arrays import Array, Mask
from knotfab.knots import Knots
from knotfab.picture.masks import mask_iou
from knotfab.picture.silhouette import resample_mask
from knotfab.render.frame import frame_of
from knotfab.render.silhouette import render
from knotfab.scene.camera import Camera

__all__ = ["LampFit", "cast_shadow", "find_lamp"]

_STEP_MM = (8.0, 8.0, 40.0)  # the simplex's steps, and the scale of the unknowns
_COARSER = 2  # factor to the resolution of the IoU
_FARTHEST = 1.0  # a lamp may be off by this share of its distance from the wall


@dataclass(frozen=True)
class LampFit:
    """The lamp's distance from its place, mm: to the right, up, and away from the wall.

    IoU of the shadow that was seen with that of the knots, for the lamp in its place and where it stood.
    """

    right_mm: float
    up_mm: float
    away_mm: float
    iou_in_place: float
    iou: float


def cast_shadow(knots: Knots, camera: Camera, eye: Array) -> Array:
    """Return (H, W) share of each pixel of `camera`'s frame that the knots darken for a lamp at `eye`.

    Args:
        knots: in the scene.
    """
    frame = frame_of(replace(camera, eye=eye), np.float32, stretched=True)
    points = knots.points.astype(np.float32)
    ahead = points[knots.rings.next]
    # sharpness of outlines: as steep as the share of a pixel that an edge covers
    return render(points, ahead, frame, knots.radius_mm, 4.0).astype(np.float64)


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
    for soft in (4.0, 1.5):  # blur of both pictures, first and then
        wanted = ndimage.gaussian_filter(coarse, soft)

        def unlike(unknown: Array, soft: float = soft, wanted: Array = wanted) -> float:
            eye = camera.eye + (unknown * step) @ axes
            # a shadow of something else has led lamps behind the piece, and kilometres away
            if eye @ wall + offset < front or np.linalg.norm(unknown * step) > _FARTHEST * reach:
                return np.inf
            cast = cast_shadow(knots, camera, eye)
            return float(((ndimage.gaussian_filter(cast, soft) - wanted) ** 2).sum())

        corners = np.concatenate([found[None], found + np.eye(3)])
        options = {"initial_simplex": corners, "maxfev": 90, "xatol": 0.02, "fatol": 1e-3}
        found = minimize(unlike, found, method="Nelder-Mead", options=options).x

    def likeness(at: Array) -> float:
        return mask_iou(cast_shadow(knots, full, full.eye + at @ axes) > 0.5, seen)

    right, up, away = (float(v) for v in found * step)
    return LampFit(right, up, away, likeness(np.zeros(3)), likeness(found * step))
