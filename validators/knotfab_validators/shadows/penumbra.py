"""The shadow of a lamp that has a size: the average over points of the lamp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab_formats.verdict import Penumbra
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import Check, at_least
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import WorkingFrame
from knotfab_validators.shadows.lamp import SceneLamp, lamp_points, lamp_size
from knotfab_validators.shadows.renderer import Renderer
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.scene import Switches

__all__ = ["SoftShadow", "averages_lamp", "blur_px", "check_half_light", "measure_penumbra"]


BLUR_TOLERANCES = 4.0  # a lamp that blurs the outline by fewer tolerances is taken as a point


@dataclass(frozen=True)
class SoftShadow:
    """What the lamp's size does; `soft` (H, W) is the share of the lamp that is hidden at each pixel."""

    found: Penumbra
    soft: NDArray[np.float32]

    @property
    def dark(self) -> Mask:
        """(H, W) where at least half of the lamp is hidden."""
        return np.asarray(self.soft >= 0.5)


def blur_px(vertices: Array, geometry: ViewGeometry, size_mm: float) -> float:
    """Return widest blur on the receiver by a ball of `size_mm`, pixels, of any edge at vertices (n, 3).

    An edge at height h over the receiver and distance D from a lamp at height H: the rays through it that
    touch the ball, a cone, meet the receiver in an ellipse that is d h D / ((H - h)² - d²/4) long. Of a
    curved receiver that is the plane which touches it where the edge's shadow falls.
    """
    at, normal = geometry.touching(geometry.project(vertices)[0])
    height = ((vertices - at) * normal).sum(axis=1)
    above = ((geometry.light - at) * normal).sum(axis=1)
    below = np.maximum(above - height, 0.501 * size_mm + 1e-9)
    away = np.linalg.norm(vertices - geometry.light, axis=1)
    blur = size_mm * height * away / (below**2 - size_mm**2 / 4)
    return max(float(blur.max()), 0.0) / geometry.pixel_mm


def averages_lamp(
    effects: Switches,
    vertices: Array,
    geometry: ViewGeometry,
    lamp: SceneLamp,
    tolerance_px: float = 0.25,
) -> bool:
    """Tell whether the lamp is averaged over: the scene says so, or the blur exceeds the threshold."""
    size = lamp_size(lamp)
    if effects.penumbra is not None or size == 0:
        return bool(effects.penumbra) and size > 0
    return blur_px(vertices, geometry, size) > BLUR_TOLERANCES * tolerance_px


def measure_penumbra(
    renderer: Renderer,
    vertices: Array,
    geometry: ViewGeometry,
    target: Mask,
    sharp: Mask,
    frame: WorkingFrame,
    lamp: SceneLamp,
    tolerance_px: float,
    within: Mask | None = None,
) -> SoftShadow:
    """Average the shadows of points of the lamp, which faces the piece.

    Args:
        renderer: renderer of the mesh whose `vertices` (n, 3) these are, scene coordinates (mm).
        geometry: the view on the pixels of `target` (H, W), the padded `frame`.
        sharp: (H, W) the shadow that the lamp's middle throws.
        within: (H, W) where shadow counts, of a wall that ends; None: everywhere.
    """
    widest = blur_px(vertices, geometry, lamp_size(lamp))
    points = lamp_points(lamp, widest, tolerance_px)
    hidden = np.zeros(target.shape, dtype=np.int32)
    for right, up in points:
        light = geometry.light + right * geometry.right + up * geometry.up
        # coarser pixels do on a round wall: they lose as much to either side, which averages out
        hidden += renderer.render(replace(geometry, light=light), finer=1)
    if within is not None:
        hidden *= within
    soft = (hidden / len(points)).astype(np.float32)
    size = frame.width * frame.height
    error = float(np.abs(soft - target).sum(dtype=np.float64)) / size
    hard = float(np.count_nonzero(sharp != target)) / size
    dark = 2 * hidden >= len(points)
    found = Penumbra(
        widest_px=widest,
        iou=overlap(dark, target).iou,
        brightness_error=error,
        hard_error=hard,
        samples=len(points),
    )
    return SoftShadow(found, soft)


def check_half_light(ious: Mapping[str, float], iou_floor: float | None) -> Check:
    """Check `half_light`: of what a lamp leaves dark as wide as it is as much is asked as of its middle's.

    Args:
        ious: IoU of the picture with the places where half of the lamp is hidden, by the view's name.
        iou_floor: the least; None: nothing is asked.
    """
    name = min(ious, key=lambda view: ious[view])
    detail = f"IoU of the picture with where at least half of the lamp is hidden, view {name}"
    return at_least("half_light", ious[name], iou_floor, "", detail, required=iou_floor is not None)
