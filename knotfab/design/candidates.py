"""The tube radii that are tried, and what is said where none is thin enough; light, for previews too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from shapely import MultiPolygon

from knotfab.base.errors import SceneError
from knotfab.geometry.polylines import arc_lengths
from knotfab.picture.opening import thickest_radius
from knotfab_formats.piece import Printer
from knotfab_formats.scene import ResolvedScene, ResolvedView
from knotfab_formats.views import View

if TYPE_CHECKING:
    from knotfab.start.filling import Template

PICTURE = "the picture"  # the name in an error, where another reading of it may do
# depth over the extent across: the contract asks for 0.6, the flow may take a little
DEPTH_RATIO = 0.66
_NOZZLES = (0.3, 0.25, 0.2, 0.15, 0.1)  # mm, that are sold
_UNEVEN = 0.4  # px by which a line's width varies as it is drawn
_DRAWN = 0.9  # IoU of the opening that makes a picture of lines worth drawing


@dataclass(frozen=True)
class RadiusRange:
    """The radii that are tried, as shares of the frame's side, and what a thicker tube may cost in IoU."""

    usual: float  # thinner only where the picture forbids this
    thickest: float
    candidates: int | None  # None: as the settings say
    drawn: float  # score below which thinner tubes are tried as well
    thinner: int  # the number of these that are thinner
    hopeless: float  # score behind the best that nothing makes up for; of several views
    trials: int  # starts that are drawn of these
    give: float  # IoU of the start, at least; of one view's template as much as the settings say


# A start for several views is drawn already (start.views): its own pictures tell.
# With three views or more the pictures ask so much of every strand that only a thin tube serves.
_RANGES = {
    1: RadiusRange(0.0102, 0.035, None, 0.94, 5, 0.0, 1, 0.0),
    2: RadiusRange(0.0125, 0.022, 4, 0.95, 4, 0.006, 7, 0.012),
    3: RadiusRange(0.01056, 0.01056, 1, 0.95, 4, 0.006, 4, 0.012),
}


def range_of(views: int) -> RadiusRange:
    """Return the range for so many views."""
    return _RANGES[min(views, 3)]


def line_width(view: View, radius: float) -> float:
    """Return mm on the receiver of strokes that are drawn along their middle by one tube of this radius, mm.

    Rounded up, so that the radius of that width is no smaller: it may be the least that is printed.
    """
    return math.ceil(2e3 * radius * view.magnification - 1e-6) / 1e3


def line_radius(view: View) -> float:
    """Return the radius, mm, of the one tube that runs along strokes of a view's `thicken_mm`."""
    if not view.thicken_mm:
        raise ValueError("the width of strokes that are drawn along their middle is known")
    return math.ceil(1e4 * view.thicken_mm / (2.0 * view.magnification) - 1e-6) / 1e4


def usual_radii(
    views: Sequence[ResolvedView], thinnest: float, count: int, least: float = 1.0
) -> tuple[list[float], list[float]]:
    """Return the radii, mm, that are tried at once, thinnest first, and thinner ones for fine pictures.

    Args:
        thinnest: that the printer makes, mm. count: how many for one view.
        least: the smallest that is tried at once, over the usual one.
    """
    span = range_of(len(views))
    one = len(views) == 1
    side = views[0].frame_width_mm if one else max(v.longer_mm for v in views)
    usual = max(thinnest, least * span.usual * side)
    thick = max(span.thickest * side, (1.5 if one else 1.2) * usual)
    radii = np.geomspace(usual, thick, span.candidates or count).round(4).tolist()
    thin: list[float] = []
    if thinnest < usual:  # try thinner tubes as far as the printer goes
        thin = np.geomspace(thinnest, usual, span.thinner)[:-1].round(4).tolist()
    return radii, thin


def most_radius(asked: float | None, view: ResolvedView, thinnest: float) -> float:
    """Return the thickest radius, mm, that may be taken for the one view of a scene, however near its wall.

    Args:
        asked: the scene's radius, if it has one. view: with `lines` settled. thinnest: as for `usual_radii`.
    """
    thick = view.thicken_mm
    if asked is not None:
        return asked
    if view.lines and thick:  # a shadow is no smaller than its tube
        return 0.5 * thick
    return usual_radii([view], thinnest, 2)[0][-1]


def drawing_radius(polygon: MultiPolygon, least: float) -> float | None:
    """Find the thickest radius below `least`, in the polygon's unit, that draws most of it; None: dust."""
    return thickest_radius(polygon, _DRAWN, least / 64, least)


def too_fine(
    drawn: float | None,
    view: ResolvedView,
    pixels: tuple[int, int],
    printer: Printer,
    why: str,
    otherwise: str = "--lines on, or --thicken auto",
    parts: str = "lines",
) -> SceneError:
    """Return the error for a picture whose lines no printable tube draws, with remedies that each suffice.

    Args:
        drawn: the radius, px, of a tube that would draw it, its shadow's size; None: none that is known.
        pixels: width and height of the picture. why: what was found. otherwise: what else would do.
        parts: what is too thin.
    """
    width, longer = pixels[0], max(pixels)
    px = view.px_per_mm(width)
    least = printer.min_tube_radius_mm * px
    remedies = [
        f"{parts} must be at least {math.ceil(2 * least + _UNEVEN)} px of {longer} at this size"
    ]
    if drawn is not None:
        frame = math.ceil(view.frame_width_mm * least / drawn / 10) * 10
        # the widest frame that is advised: a person may hang it up
        if view.frame_width_mm < frame <= 1000.0:
            remedies.append(f"or the picture {frame} mm wide (--width {frame})")
        nozzle = printer.nozzle_mm * min(drawn / least, 0.99)
        finer = next((n for n in _NOZZLES if n <= nozzle), None)
        if finer is not None:
            radius = printer.min_tube_radius_mm * finer / printer.nozzle_mm
            remedies.append(
                f"or a {finer:g} mm nozzle (scene keys printer.nozzle_mm = {finer:g}, "
                f"printer.min_tube_radius_mm = {math.floor(1e3 * radius) / 1e3:g})"
            )
        lines = f"; most of its {parts} are about {2 * drawn:.1f} px thick"
    else:
        lines = "; it is hardly more than dust"
    if otherwise:
        remedies.append(f"or {otherwise}")
    return SceneError(PICTURE, why + lines, ", ".join(remedies).capitalize() + ".")


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
        plate *= scene.mount.thickness_mm
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
