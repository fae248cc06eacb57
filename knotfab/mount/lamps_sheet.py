"""The drawing from above of several lamps before one screen, with the frame that holds all of it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.drawing.dimensions import draw_dimension, fit_scale, length, project_outlines
from knotfab.drawing.pages import PAPERS, Box, make_page
from knotfab.mount.mount import Mounted
from knotfab.mount.placement import Placement
from knotfab.mount.strokes import INK, LIGHT, PIECE, WORDS, cross, draw_lamp, fill, hatch, note
from knotfab.mount.table import ROD_MM, Bar, Table
from knotfab_formats.scene import View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["lamps_sheet"]

ZONE: Box = (26.0, 92.0, 184.0, 262.0)  # the drawing's place on the page
BESIDE_MM = 14.0  # distance on the page from the drawing to its dimensions
ROW_MM, WIDE = 4.2, 120  # between lines of words, and characters in each
BAR = "0.9"


def lamps_sheet(
    mounted: Mounted, places: Sequence[Placement], views: Sequence[View], table: Table | None
) -> Figure:
    """Return one page of A4: screen, piece, lamps and frame from above, and where each lamp stands in words.

    Args:
        places, views: places and views of the lamps, in the scene's order. table: the frame, if there is one.
    """
    paper = PAPERS["a4"]
    figure, axes = make_page(paper)
    right, up, out = places[0].level
    above = np.stack([right, -out, up])  # axes: to the right and up the page, and to the viewer
    piece = project_outlines(mounted.solids, above)
    lamps = np.stack([above[:2] @ place.lamp for place in places])
    screen = _across(places[0], above)
    bars = [] if table is None else [_outline(bar) for bar in table.bars]
    to = fit_scale(np.concatenate([*piece, *bars, screen, lamps]), ZONE)
    for bar in bars:
        axes.fill(*to(bar).T, fc=BAR, ec="0.6", lw=0.4)
    fill(axes, [to(p) for p in piece], PIECE)
    axes.plot(*to(screen).T, color=INK, lw=1.8, solid_capstyle="butt")
    hatch(axes, to(screen))
    middle, wall = to(np.zeros(2)), to(above[:2] @ places[0].middle)
    cross(axes, middle, 2.0, 0.4)
    for place, view, lamp in zip(places, views, lamps, strict=True):
        for end in screen:
            axes.plot(*to(np.stack([lamp, end])).T, color=LIGHT, lw=0.3)
        at = to(lamp)
        draw_lamp(axes, at, view.light_size_mm / to.ratio)
        side = 1.0 if lamp[0] >= 0 else -1.0
        note(axes, at + (4.0 * side, 2.0), view.name, size=7.5, ha="left" if side > 0 else "right")
        if abs(lamp[0]) > 1.0:
            low = float(to(lamps)[:, 1].min()) - 8.0 - 5.0 * (side > 0)
            draw_dimension(
                axes, (middle[0], low), (at[0], low), (0, 0), length(abs(float(lamp[0])))
            )
        assert abs(float(place.level[2] @ place.lamp) - view.light_distance_mm) < 1e-6
    left = float(to(np.concatenate([screen, lamps, *bars]))[:, 0].min()) - BESIDE_MM
    deep = sorted({round(float(-lamp[1]), 3) for lamp in lamps})
    draw_dimension(
        axes, (left, wall[1]), (left, middle[1]), (0, 0), length(views[0].wall_distance_mm)
    )
    for number, z in enumerate(deep):
        x, end = left - 6.0 * number, float(to(np.array([0.0, -z]))[1])
        draw_dimension(axes, (x, middle[1]), (x, end), (0, 0), length(z))
    note(axes, wall + (0.0, 3.0), "screen", size=7.5, ha="center")
    _words(axes, paper.height, to.name, places, views, table)
    return figure


def _words(
    axes: object,
    height: float,
    scale: str,
    places: Sequence[Placement],
    views: Sequence[View],
    table: Table | None,
) -> None:
    """Write the title and, below the drawing, where each lamp stands."""
    text = axes.text  # type: ignore[attr-defined]
    text(14.0, height - 12.0, "Setting up: the lamps", size=15, va="top", gid=WORDS)
    text(
        14.0, height - 20.0,
        f"From above, {scale}. Lengths in mm, from the middle of each lamp and of the piece. "
        "The pages that follow place one lamp each.",
        size=6.5, va="top", color="0.35", gid=WORDS,
    )  # fmt: skip
    first = places[0]
    across, high = first.frame_mm
    middle = float(first.level[1] @ first.middle)
    lines = [
        f"The screen's picture is {length(across)} × {length(high)} mm, its middle "
        f"{_above(middle)} the middle of the piece."
    ]
    for place, view in zip(places, views, strict=True):
        x, y, z = (float(value) for value in place.level @ place.lamp)
        aside = (
            f"{length(abs(x))} mm {'right' if x > 0 else 'left'}"
            if abs(x) > 0.05
            else "in the middle"
        )
        lines.append(
            f"{view.name}: {aside}, {length(z)} mm before the piece, {_above(y)} its middle"
            + ("" if table is None else f", {length(y - table.top_mm)} mm above the frame")
            + "."
        )
    if table is not None:
        files = ", ".join(sheet for sheet in _files(table))
        edge = middle - high / 2 - table.top_mm
        lines += [
            f"The picture's lower edge is {length(edge)} mm above the frame, on which its card stands.",
            f"The frame ({files}) holds all of it: press the bars together, put a card of 3 mm into its slot "
            f"and rods of {length(ROD_MM)} mm into the holes, each lamp's middle at its height.",
            "The small hole is right below the middle of the piece."
            if places[0].base is None
            else "The stand's foot goes between the low ridges.",
        ]
    rows = [row for line in lines for row in textwrap.wrap(line, WIDE)]
    for number, row in enumerate(rows):
        text(14.0, 80.0 - ROW_MM * number, row, size=7, va="top", gid=WORDS)


def _files(table: Table) -> list[str]:
    return [f"table-{number}.3mf" for number in range(1, table.beds + 1)]


def _above(value: float) -> str:
    """Say how high a point is: "12 mm above"."""
    if abs(value) < 0.05:
        return "level with"
    return f"{length(abs(value))} mm {'above' if value > 0 else 'below'}"


def _across(place: Placement, above: Array) -> Array:
    """Return (2, 2) the frame's ends on the wall, seen from above."""
    reach = np.array([[-0.5], [0.5]]) * place.frame_mm[0]
    return np.asarray((place.middle + reach * place.wall[0]) @ above[:2].T)


def _outline(bar: Bar) -> Array:
    """Return (4, 2) a bar on the page: to the right and, as it lies before the wall, down."""
    aside = 0.5 * bar.width_mm * np.array([-bar.along[1], bar.along[0]])
    end = bar.start + bar.length_mm * bar.along
    return np.stack([bar.start + aside, end + aside, end - aside, bar.start - aside]) * [1.0, -1.0]
