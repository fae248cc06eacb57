"""A guess of grams and hours before anything is searched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.scene.model import ResolvedView, Scene

__all__ = ["Guess", "guess_print"]

# Fitted on builds of the project's own pictures (docs/silhouette.md has them beside the slicer's figures).
_LENGTH, _LENGTH_FLAT = 1.6, 1.12  # of the tube over area / width
_HOURS, _HOURS_FLAT, _HOURS_PLATE = 0.24, 0.10, 0.06  # to a cm3, supports included


@dataclass(frozen=True)
class Guess:
    """Grams of the part, and hours on the printer with its supports; None where nothing is known."""

    mass_g: float
    hours: float | None


def guess_print(scene: Scene, area_mm2: float, view: ResolvedView, radius_mm: float) -> Guess:
    """Guess by what builds came to.

    A tube that fills an area A with strands side by side is A / 2r long; through the depth it is longer.

    Args:
        scene: resolved. area_mm2: of the silhouette at the middle of the piece. radius_mm: of the tube.
    """
    flat = scene.piece.depth == "flat"
    length = (_LENGTH_FLAT if flat else _LENGTH) * area_mm2 / (2 * radius_mm)
    tube = np.pi * radius_mm**2 * length
    plate = 0.0
    if scene.mount.kind == "wall" and scene.mount.foot != "dowel":
        margin = 2 * scene.mount.plate_margin_mm
        plate = (view.frame_width_mm + margin) * (view.frame_height_mm + margin)
        plate *= scene.mount.plate_thickness_mm
    density = scene.material.density_g_cm3 * 1e-3
    hours = None
    if scene.material.process == "filament":
        hours = (_HOURS_FLAT if flat else _HOURS) * tube * 1e-3 + _HOURS_PLATE * plate * 1e-3
    return Guess(float((tube + plate) * density), None if hours is None else float(hours))
