"""How much of the picture is lost when the lamp or the piece is not quite where the scene says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.compare import overlap, turn_view
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import ViewGeometry

__all__ = ["measure_misplacement"]


LAMP_MM = 5.0
TURN_DEG = 1.0


def measure_misplacement(
    renderer: SilhouetteRenderer,
    middle: Array,
    geometry: ViewGeometry,
    target: Mask,
    *,
    lamp_mm: float = LAMP_MM,
    turn_deg: float = TURN_DEG,
    turns: bool = True,
) -> dict[str, dict[str, float]]:
    """Loss of IoU per mm that the lamp is off, and per degree that the piece is turned.

    Over a move of `lamp_mm` or a turn of `turn_deg` in one sense. The picture stays where it is on the
    wall, so that a shadow which merely moves counts as lost too.

    Args:
        renderer: of the part, in the coordinates of `geometry`. middle: (3,) mm, what the piece
            turns about. target: (H, W), the picture's silhouette on the grid of `geometry`.
        turns: whether the piece can turn against the wall: not one that is mounted on it.

    Returns:
        {"lamp_iou_per_mm": {"right", "up", "towards"}, "turn_iou_per_deg": {"right", "up", "axis"}};
        the turns are named by their axes, and left out where nothing can turn.
    """
    best = overlap(renderer.render(geometry), target).iou
    axes = {"right": geometry.right, "up": geometry.up, "towards": geometry.axis}

    def loss(moved: ViewGeometry, step: float) -> float:
        return max(0.0, best - overlap(renderer.render(moved), target).iou) / step

    lamp = {
        name: loss(replace(geometry, light=geometry.light + lamp_mm * axis), lamp_mm)
        for name, axis in axes.items()
    }
    if not turns:
        return {"lamp_iou_per_mm": lamp}
    turn = {
        "axis" if name == "towards" else name: loss(
            turn_view(geometry, middle, axis, np.radians(turn_deg)), turn_deg
        )
        for name, axis in axes.items()
    }
    return {"lamp_iou_per_mm": lamp, "turn_iou_per_deg": turn}
