"""The shadow of a lamp that has a diameter: the average over points of the lamp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.files.scene import Effects
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import ViewGeometry

__all__ = ["Penumbra", "averages_lamp", "blur_px", "measure_penumbra"]


SAMPLES = 9
BLUR_TOLERANCES = 4.0  # a lamp that blurs the outline by fewer tolerances is taken as a point
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True)
class Penumbra:
    """What the lamp's size does to the shadow.

    `widest_px` is the widest blur; `iou` compares the picture with where at least half of the lamp is
    hidden; `soft` (H, W) is the share of the lamp that is hidden at each pixel.
    """

    widest_px: float
    iou: float
    soft: NDArray[np.float32]
    samples: int


def blur_px(vertices: Array, geometry: ViewGeometry, diameter_mm: float) -> float:
    """Widest blur on the receiver: diameter x (strand to receiver) / (lamp to strand), pixels."""
    height = (vertices - geometry.origin) @ geometry.normal
    nearest = min(float(height.max()), 0.999 * geometry.light_height)
    return diameter_mm * nearest / (geometry.light_height - nearest) / geometry.pixel_mm


def averages_lamp(
    effects: Effects, vertices: Array, geometry: ViewGeometry, diameter_mm: float
) -> bool:
    """Whether the lamp is averaged over: the scene says so, or the blur exceeds the threshold."""
    if effects.penumbra != "auto" or diameter_mm == 0:
        return effects.penumbra == "on" and diameter_mm > 0
    return blur_px(vertices, geometry, diameter_mm) > BLUR_TOLERANCES * effects.tolerance_px


def measure_penumbra(
    renderer: SilhouetteRenderer,
    vertices: Array,
    geometry: ViewGeometry,
    target: Mask,
    diameter_mm: float,
) -> Penumbra:
    """Average the shadows of points spread evenly over the lamp's disc (Vogel's spiral).

    Args:
        renderer: of the mesh whose `vertices` (n, 3) these are, scene coordinates (mm).
        geometry: the view on the pixels of `target` (H, W).
    """
    soft = np.zeros(target.shape, dtype=np.float32)
    for n in range(SAMPLES):
        reach = 0.5 * diameter_mm * np.sqrt((n + 0.5) / SAMPLES)
        across = np.cos(n * GOLDEN_ANGLE) * geometry.right + np.sin(n * GOLDEN_ANGLE) * geometry.up
        lamp = replace(geometry, light=geometry.light + reach * across)
        soft += renderer.render(lamp)
    soft /= SAMPLES
    return Penumbra(
        blur_px(vertices, geometry, diameter_mm), overlap(soft >= 0.5, target).iou, soft, SAMPLES
    )
