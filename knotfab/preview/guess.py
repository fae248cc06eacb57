"""A guess of grams and hours before anything is searched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab.design.candidates import DEPTH_RATIO
from knotfab.geometry.sampling import arc_lengths
from knotfab.start.filling import Template
from knotfab_formats.scene import ResolvedScene, ResolvedView

__all__ = ["Guess", "guess_print"]

# Fitted on builds of the project's own pictures (docs/silhouette.md has guesses beside the slicer's figures).
# the tube's length over that of its flat start, or over area / width
_LENGTH, _LENGTH_FLAT = 1.45, 1.12
# hours to a cm3 of a tube of this radius; thin ones take longer
_HOURS, _OF_RADIUS_MM = 0.158, 1.77
_HOURS_PLATE = 0.06
_HOURS_AROUND = 0.007  # hours to a cm3 of the room between the strands, part of which supports fill


@dataclass(frozen=True)
class Guess:
    """Grams of the part, and hours on the printer with its supports; None where nothing is known.

    `without` names what it does not know: a stand, or what an eyelet hangs from, is planned with the knots.
    """

    mass_g: float
    hours: float | None
    without: str = ""


def guess_print(
    scene: ResolvedScene,
    view: ResolvedView,
    areas_mm2: Sequence[float],
    size_mm: tuple[float, float],
    radius_mm: float,
    pieces: int = 1,
    template: Template | None = None,
) -> Guess:
    """Guess by the results of builds.

    A tube that fills an area A with strands side by side is A / 2r long; through the depth it is longer.
    What fills one of several pictures is hidden in the others, so that their areas add up.

    Args:
        areas_mm2: areas of the silhouettes. size_mm: width and height of the first one,
            in the middle of the piece. radius_mm: radius of the tube. pieces: pieces of the picture, each a
            knot if that is open.
        template: the flat curves that the search starts from, where they are known.
    """
    flat = scene.piece.depth == 0
    length = sum(areas_mm2) / (2 * radius_mm)
    if template is not None:
        length = sum(float(arc_lengths(curve)[-1]) for curve in template.curves)
    length *= _LENGTH_FLAT if flat else _LENGTH
    tube, plate = np.pi * radius_mm**2 * length, 0.0
    loose = scene.hangs(scene.count_knots(pieces))  # a wall mount holds them if they are printed
    hangs = (scene.piece.printed and loose) or scene.mount.kind == "wall"
    if hangs and scene.mount.foot != "dowel":
        margin = 2 * scene.mount.plate_margin_mm
        plate = (view.frame_width_mm + margin) * (view.frame_height_mm + margin)
        plate *= scene.mount.plate_thickness_mm
    without = {"stand": "its stand", "hang": "its eyelet"}.get(scene.mount.kind, "")
    if loose and not hangs:
        without = "the wall mount that --print adds"
    mass = (tube + plate) * 1e-3 * scene.material.density_g_cm3
    if scene.material.process != "filament":
        return Guess(float(mass), None, without)
    room = 2.0 * view.reach_mm
    depth = 0.0 if flat else scene.piece.depth or min(room, DEPTH_RATIO * max(size_mm))
    hours = _HOURS * _OF_RADIUS_MM / radius_mm * tube
    hours += _HOURS_PLATE * plate + _HOURS_AROUND * sum(areas_mm2) / len(areas_mm2) * depth
    return Guess(float(mass), float(hours * 1e-3), without)
