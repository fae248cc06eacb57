"""The tube radii that are tried, and what is said where none is thin enough; light, for previews too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import MultiPolygon

from knotfab.base.errors import SceneError
from knotfab.picture.opening import thickest_radius
from knotfab_formats.piece import Printer
from knotfab_formats.scene import ResolvedView
from knotfab_formats.views import View

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
