"""Candidate tube radii, the error where none is thin enough, and a guess of the print.

Previews use this before anything is searched.
"""

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
from knotfab_formats.slicer_ini import (
    FIRST_MM_S,
    SOLID_MM_S,
    TOP_MM_S,
    core_of,
    line_width_mm,
    overlap_mm,
    plan_walls,
)
from knotfab_formats.views import View

if TYPE_CHECKING:
    from knotfab.start.filling import Template

PICTURE = "the picture"  # the subject of errors that another reading of the picture may avoid
DEPTH_RATIO = 0.66  # depth over width; the contract asks for 0.6, and the flow may lose a little
# inner corners of a plate's outline are rounded by so much: narrow slits are weak and slow
FILLET_MM = 8.0
_ROOMY = 1.05  # on the size that would just do
_NOZZLES = (0.3, 0.25, 0.2, 0.15, 0.1)  # diameters on the market, mm
_UNEVEN = 0.4  # variation of a drawn line's width, px
_DRAWN = 0.9  # IoU of the opening from which a picture of lines counts as drawn


@dataclass(frozen=True)
class RadiusRange:
    """The radii to try, as shares of the frame's side, and the IoU that a thicker tube may cost.

    Several views get no tube thinner than `least`: a start takes as long as the inverse of its radius, cubed.
    """

    usual: float  # the thinnest radius that is tried at once
    thickest: float
    candidates: int | None  # radii that are tried at once; None: as the settings say
    drawn: float  # IoU below which thinner tubes are tried as well
    thinner: int  # number of radii from the printer's thinnest to the usual one
    hopeless: float  # several views: a radius this far below the best IoU is not tried
    trials: int  # several views: the number of starts to draw
    give: float  # IoU that a thicker tube may cost, unless the settings allow more
    least: float = 0.0  # the printer's thinnest, 0.8 mm, in a frame of 320 mm


# With three views or more the pictures ask so much of every strand that only a thin tube serves.
_RANGES = {
    1: RadiusRange(0.0102, 0.035, None, 0.94, 5, 0.0, 1, 0.0),
    2: RadiusRange(0.0125, 0.022, 4, 0.95, 4, 0.006, 7, 0.012, 0.0025),
    3: RadiusRange(0.01056, 0.01056, 1, 0.95, 4, 0.006, 4, 0.012, 0.0025),
}


def range_of(views: int) -> RadiusRange:
    """Return the radii to try for this number of views."""
    return _RANGES[min(views, 3)]


def line_width(view: View, radius: float) -> float:
    """Return the width on the receiver of a stroke that one tube along its centre line draws, mm.

    It is rounded up, so that `line_radius` of it is no thinner than `radius`, perhaps the printer's least.
    """
    return math.ceil(2e3 * radius * view.magnification - 1e-6) / 1e3


def line_radius(view: View) -> float:
    """Return the radius, mm, of a tube whose shadow is as wide as the view's strokes (`thicken_mm`)."""
    if not view.thicken_mm:
        raise ValueError("the width of strokes that are drawn along their middle is known")
    return math.ceil(1e4 * view.thicken_mm / (2.0 * view.magnification) - 1e-6) / 1e4


def usual_radii(
    views: Sequence[ResolvedView], thinnest: float, count: int, least: float = 1.0
) -> tuple[list[float], list[float]]:
    """Return the radii to try at once, thinnest first, and thinner ones for fine pictures, mm.

    Args:
        thinnest: the printer's thinnest radius, mm. count: number of radii for one view.
        least: smallest radius to try at once, over the usual one.
    """
    span = range_of(len(views))
    side = max(v.longer_mm for v in views)  # so that a picture that is turned keeps its tube
    usual = max(thinnest, least * span.usual * side)
    thick = max(span.thickest * side, (1.5 if len(views) == 1 else 1.2) * usual)
    radii = np.geomspace(usual, thick, span.candidates or count).round(4).tolist()
    thin: list[float] = []
    if thinnest < usual:
        thin = np.geomspace(thinnest, usual, span.thinner)[:-1].round(4).tolist()
    return radii, thin


def most_radius(asked: float | None, view: ResolvedView, thinnest: float) -> float:
    """Return the thickest radius that a build of one view may choose, mm.

    Args:
        asked: the scene's radius, if it gives one. view: with `lines` settled.
        thinnest: as for `usual_radii`.
    """
    thick = view.thicken_mm
    if asked is not None:
        return asked
    if view.lines and thick:  # a shadow is no smaller than its tube
        return 0.5 * thick
    return usual_radii([view], thinnest, 2)[0][-1]


def drawing_radius(polygon: MultiPolygon, least: float) -> float | None:
    """Return the thickest radius below `least` that draws most of a polygon; None if it is dust.

    Radii are in the polygon's unit.
    """
    return thickest_radius(polygon, _DRAWN, least / 64, least)


def too_fine(
    drawn: float | None,
    view: ResolvedView,
    pixels: tuple[int, int],
    printer: Printer,
    why: str,
    otherwise: str = "--lines on, or --thicken auto",
    parts: str = "lines",
    given_mm: float | None = None,
) -> SceneError:
    """Build the error for a picture too fine for any printable tube, with remedies that each suffice.

    Args:
        drawn: radius of the shadow of a tube that would draw the picture, px; None if none is known.
        pixels: width and height of the picture. why: the reason. otherwise: one more remedy.
        parts: the noun for what is too thin. given_mm: the radius that is asked for, if one is.
    """
    width, longer = pixels[0], max(pixels)
    px = view.px_per_mm(width)
    least = (given_mm or printer.min_tube_radius_mm) * px
    remedies = [
        f"{parts} must be at least {math.ceil(2 * least + _UNEVEN)} px of {longer} at this size"
    ]
    if drawn is not None:
        size = math.ceil(_ROOMY * view.longer_mm * least / drawn / 10) * 10
        if view.longer_mm < size <= 1000.0:  # larger pictures are not practical advice
            remedies.append(f"or the picture {size} mm long (--size {size})")
        nozzle = printer.nozzle_mm * min(drawn / least, 0.99)
        finer = next((n for n in _NOZZLES if n <= nozzle), None)
        if finer is not None and given_mm is None and printer.process == "filament":
            remedies.append(f"or a {finer:g} mm nozzle (--nozzle {finer:g})")
        lines = f"; most of its {parts} are about {2 * drawn:.1f} px thick"
    else:
        lines = "; it is hardly more than dust"
    if otherwise:
        remedies.append(f"or {otherwise}")
    return SceneError(PICTURE, why + lines, ", ".join(remedies).capitalize() + ".")


# Fitted to builds of the project's own pictures; docs/silhouette.md compares the guesses with the slicer's.
# length of a tube over that of its flat start, or over area / width: with depth, and flat
_LENGTH, _LENGTH_FLAT = 1.45, 1.12
# length of strands that print without supports over that of those with, and hours a gram (docs/prints.md)
ARCHES, PER_GRAM = 1.19, 1.06
# their length over that of the flat start: longer searches leave more of it, for they close what is light
LENGTH_ARCHED = {"sketch": 1.53, "draft": 1.62, "standard": 1.75, "fine": 1.8}
# share of the room about a piece that supports fill: the picture's longer side squared, times the depth
ROOM = 0.019
# and at most of the room behind the picture, its area times the depth: strokes alone ask for little
_BEHIND = 0.08
# share of a tube's core that infill and layers fill where it is level
_CORE_FILLED = 0.05
# printing time of a flank in layers of .2 mm: s a mm of tube and of its loops' radii, and a mm of tube for
# what else a leg takes in a layer, the way to it and back included
_LOOPS_S, _LEG_S, _LAYER_MM = 0.92, 1.66, 0.2
_HOURS_AROUND = 0.007  # of the room between the strands, which supports fill in part, h/cm³


@dataclass(frozen=True)
class Laid:
    """Strands as a search begins with them, lying as they would print, mm and mm³, and hours.

    Those along strokes follow a relief of their own: none for a straight line, a deep one for many bends.
    """

    length_mm: float
    supports_mm3: float
    hours: float  # for the supports and the layers


@dataclass(frozen=True)
class Guess:
    """A guess of the part's mass and of the printing time, None for other processes.

    Both include supports, unless the strands stand `alone`. `without` names what the guess leaves
    out because it is planned with the knots: a stand or an eyelet. The strands are `length_mm` long, and
    unlit the piece tells a share `told` of its picture, None where nobody has looked.
    """

    mass_g: float
    hours: float | None
    without: str = ""
    alone: bool = False
    length_mm: float = 0.0
    told: float | None = None


def guess_print(
    scene: ResolvedScene,
    view: ResolvedView,
    areas_mm2: Sequence[float],
    size_mm: tuple[float, float],
    radius_mm: float,
    pieces: int = 1,
    template: Template | None = None,
    outlined_mm2: float = np.inf,
    laid: Laid | None = None,
) -> Guess:
    """Guess mass and printing time from a picture's area, by factors fitted to builds.

    A tube that fills an area A with adjacent strands is A / 2r long, and longer if it moves in depth. The
    areas of several pictures add up, because strands that fill one are hidden in the others.

    Args:
        areas_mm2: areas of the silhouettes. size_mm: width and height of the first one.
        pieces: pieces of the picture, each drawn by a knot if the scene gives no number of knots.
        template: flat curves that the search starts from, if they are known.
        outlined_mm2: area of a plate of the picture's outline, if that is the mount's.
        laid: the strands along strokes, where these are known; nothing of them is guessed.
    """
    flat, alone = scene.piece.depth == 0, scene.piece.supports == "none"
    length = sum(areas_mm2) / (2 * radius_mm)
    if template is not None:
        length = sum(float(arc_lengths(curve)[-1]) for curve in template.curves)
    arched = LENGTH_ARCHED[scene.accuracy.name]
    length *= _LENGTH_FLAT if flat else arched if alone else _LENGTH
    length = length if laid is None else laid.length_mm
    tube, plate = np.pi * radius_mm**2 * length, 0.0
    on_wall = scene.mount.kind == "wall" or scene.mount.on_feet
    if on_wall and scene.mount.foot != "dowel":
        margin = 2 * scene.mount.plate_margin_mm
        plate = (view.frame_width_mm + margin) * (view.frame_height_mm + margin)
        plate = min(plate, outlined_mm2) * scene.mount.thickness_mm
    without = {"stand": "its stand", "hang": "its eyelet"}.get(scene.mount.kind, "")
    if scene.mount.kind == "auto" and not (on_wall or alone):
        without = "its holder" if scene.piece.printed else "the holder that --print adds"
    per_mm3 = 1e-3 * scene.material.density_g_cm3
    if scene.material.process != "filament":
        return Guess(float((tube + plate) * per_mm3), None, without, length_mm=float(length))
    room = 2.0 * view.reach_mm
    depth = 0.0 if flat else scene.piece.depth or min(room, DEPTH_RATIO * max(size_mm))
    around = 0.0 if alone else 1e-3 * sum(areas_mm2) / len(areas_mm2) * depth
    supports = min(ROOM * max(size_mm) ** 2 * depth, 1e3 * _BEHIND * around)
    hours = hours_of_tube(tube, radius_mm, scene.printer) / (1.0 if alone else PER_GRAM)
    hours += _HOURS_AROUND * around
    if laid is not None:
        supports = laid.supports_mm3
        hours = hours_of_tube(tube, radius_mm, scene.printer, 0.0) + laid.hours
    hours += hours_of_plate(plate, scene.mount.thickness_mm, scene.printer)
    filament = share_laid(scene.printer, radius_mm) * tube + plate + supports
    return Guess(float(filament * per_mm3), float(hours), without, alone, float(length))


# One price for all that a choice costs, in hours of printing (docs/prints.md).
GRAMS_PER_HOUR, TOLD_PER_HOUR = 20.0, 0.1
WORD_HOURS = {"faithful": 0.0, "good": 3.0, "coarse": 30.0, "not recognisable": 100.0}


def price_of(hours: float, grams: float, told: float = 0.0, word: str = "faithful") -> float:
    """Return the price of a piece that tells so much of its picture unlit, and of its verdict's word, h.

    Hours that nobody can tell, NaN, cost nothing.
    """
    took = float(np.nan_to_num(hours)) + grams / GRAMS_PER_HOUR
    return took + told / TOLD_PER_HOUR + WORD_HOURS[word]


def share_laid(printer: Printer, radius_mm: float) -> float:
    """Guess the share of a tube's volume that is filament."""
    beside, above = core_of(printer, radius_mm)
    return 1 - (1 - _CORE_FILLED) * beside * above


def hours_of_tube(
    volume_mm3: float, radius_mm: float, printer: Printer, leg_s: float = _LEG_S
) -> float:
    """Guess how long a tube takes to print in arches, from the loops and the number of its layers.

    Args:
        leg_s: for a mm of tube in a layer, beside its loops; a tube that lies has no legs.
    """
    length = volume_mm3 / (np.pi * radius_mm**2)
    loops = sum(max(radius_mm - at, 0.0) for at in plan_walls(printer, radius_mm).at_mm)
    each = _LOOPS_S * loops + leg_s
    return float(length * each * _LAYER_MM / printer.layer_height_mm / 3600)


def hours_of_plate(volume_mm3: float, thickness_mm: float, printer: Printer) -> float:
    """Guess how long a plate takes to print: its lines at the speeds of the first, the last, other layers."""
    layer = printer.layer_height_mm
    between = max(thickness_mm / layer - 2.0, 0.0)
    along = volume_mm3 / thickness_mm / (line_width_mm(printer.nozzle_mm) - overlap_mm(layer))
    return along * (1 / FIRST_MM_S + between / SOLID_MM_S + 1 / TOP_MM_S) / 3600
