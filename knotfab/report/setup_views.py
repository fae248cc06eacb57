"""The drawing from above of a piece with several views: where all lamps and walls stand about it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.lamp_frame import ROD_MM, Bar, Table
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement
from knotfab.render.pages import (
    PAPERS,
    Box,
    Scaled,
    draw_dimension,
    fit_scale,
    length,
    make_page,
    project_outlines,
)
from knotfab.report.setup_words import (
    FAINT,
    INK,
    LIGHT,
    PIECE,
    WORDS,
    cross,
    draw_lamp,
    fill,
    hatch,
    lamp_name,
    note,
)
from knotfab_formats.views import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ZONE: Box = (22.0, 40.0, 188.0, 250.0)  # the drawing's place on the page
BESIDE_MM = 12.0  # the wall reaches so far beside its frame


def plan_sheet(mounted: Mounted, places: Sequence[Placement], views: Sequence[View]) -> Figure:
    """Draw one page of A4 with everything from above, the first lamp below the piece.

    Args:
        places, views: one of each for each view, in the scene's order.
    """
    paper = PAPERS["a4"]
    figure, axes = make_page(paper)
    right, up, out = places[0].level
    above = np.stack([right, -out, up])  # axes: to the right and up the page, and to the viewer
    piece = project_outlines(mounted.solids, above)
    walls = [_wall_from_above(place, above) for place in places]
    lamps = [above[:2] @ place.lamp for place in places]
    every = np.concatenate([*piece, *walls, np.stack(lamps)])
    to = fit_scale(every, ZONE)
    fill(axes, [to(p) for p in piece], PIECE)
    for place, view, wall, lamp in zip(places, views, walls, lamps, strict=True):
        _draw_view(axes, place, view, wall, lamp, above, to)
    cross(axes, to(np.zeros(2)), 2.0, 0.4)
    left, top = 14.0, paper.height - 12
    axes.text(left, top, "Setting up", size=15, va="top", gid=WORDS)
    axes.text(
        left, top - 8.0,
        f"From above, {to.name}. Lengths in mm, from the middle of each lamp and of the piece; what counts "
        "is the figures, not the drawing.",
        size=6.5, va="top", color="0.35", gid=WORDS,
    )  # fmt: skip
    axes.text(
        left, top - 12.0,
        (f"{len(views)} pictures, each on its own wall and by its own light. " if len(views) > 1 else "")
        + ("The front of the base is below in this drawing. " if places[0].base is not None else "")
        + "The pages that follow place one view each.",
        size=6.5, va="top", color="0.35", gid=WORDS,
    )  # fmt: skip
    return figure


def _wall_from_above(place: Placement, above: Array, beside: float = BESIDE_MM) -> Array:
    """Return a wall from above, `beside` mm past its frame, at its middle's height, (n, 2)."""
    reach = place.frame_mm[0] / 2 + beside
    points = place.middle + np.array([[-reach], [reach]]) * place.wall[0]
    return np.asarray(points @ above[:2].T)


def _draw_view(
    axes: Axes, place: Placement, view: View, wall: Array, lamp: Array, above: Array, to: Scaled
) -> None:
    """Draw one view's lamp, wall, frame and rays, with how far lamp and wall are from the middle."""
    frame = _wall_from_above(place, above, 0.0)
    for end in frame[[0, -1]]:
        axes.plot(*to(np.stack([lamp, end])).T, color=LIGHT, lw=0.4)
    axis = to(np.stack([lamp, above[:2] @ place.middle]))
    axes.plot(*axis.T, color=FAINT, lw=0.3, ls="-.")
    axes.plot(*to(wall).T, color=INK, lw=0.8)
    axes.plot(*to(frame).T, color=INK, lw=1.8, solid_capstyle="butt")
    hatch(axes, to(wall))
    draw_lamp(axes, axis[0], view.light_size_mm / to.ratio)
    along = (axis[1] - axis[0]) / np.linalg.norm(axis[1] - axis[0])
    # mm of the page, from a view's axis to its dimensions
    aside = 4.0 * np.array([-along[1], along[0]])
    middle = to(np.zeros(2))
    levelled = float(np.cos(np.deg2rad(view.elevation_deg)))
    draw_dimension(axes, axis[0], middle, aside, length(view.light_distance_mm * levelled))
    draw_dimension(
        axes, middle, axis[1], aside, length(float(np.linalg.norm(axis[1] - middle)) * to.ratio)
    )
    # along the wall, read from below or from the right
    turn = (float(np.degrees(np.arctan2(aside[1], aside[0]))) + 89.9) % 180.0 - 89.9
    style = {"size": 7, "ha": "center", "va": "center", "rotation": turn}
    note(axes, axis[0] - 5.0 * along, f"{lamp_name(view)}: {view.name}", **style)
    note(axes, axis[1] + 5.0 * along, f"wall: {view.name}", **style)


# The drawing from above of several lamps before one screen, with the frame that holds all of it.

FRAME_ZONE: Box = (26.0, 92.0, 184.0, 262.0)  # the drawing's place on the page
FRAME_BESIDE_MM = 14.0  # distance on the page from the drawing to its dimensions
ROW_MM, WIDE = 4.2, 120  # between lines of words, and characters in each
BAR = "0.9"


def lamps_sheet(
    mounted: Mounted, places: Sequence[Placement], views: Sequence[View], table: Table | None
) -> Figure:
    """Draw one page of A4: screen, piece, lamps and frame from above, and where lamps stand.

    Args:
        places, views: of the lamps, in the scene's order. table: the frame, if there is one.
    """
    paper = PAPERS["a4"]
    figure, axes = make_page(paper)
    right, up, out = places[0].level
    above = np.stack([right, -out, up])  # axes: to the right and up the page, and to the viewer
    piece = project_outlines(mounted.solids, above)
    lamps = np.stack([above[:2] @ place.lamp for place in places])
    screen = _wall_from_above(places[0], above, 0.0)
    bars = [] if table is None else [_bar_outline(bar) for bar in table.bars]
    to = fit_scale(np.concatenate([*piece, *bars, screen, lamps]), FRAME_ZONE)
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
    left = float(to(np.concatenate([screen, lamps, *bars]))[:, 0].min()) - FRAME_BESIDE_MM
    deep = sorted({round(float(-lamp[1]), 3) for lamp in lamps})
    draw_dimension(
        axes, (left, wall[1]), (left, middle[1]), (0, 0), length(views[0].wall_distance_mm)
    )
    for number, z in enumerate(deep):
        x, end = left - 6.0 * number, float(to(np.array([0.0, -z]))[1])
        draw_dimension(axes, (x, middle[1]), (x, end), (0, 0), length(z))
    note(axes, wall + (0.0, 3.0), "screen", size=7.5, ha="center")
    _write_words(axes, paper.height, to.name, places, views, table)
    return figure


def _write_words(
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
        f"{_tell_height(middle)} the middle of the piece."
    ]
    for place, view in zip(places, views, strict=True):
        x, y, z = (float(value) for value in place.level @ place.lamp)
        aside = (
            f"{length(abs(x))} mm {'right' if x > 0 else 'left'}"
            if abs(x) > 0.05
            else "in the middle"
        )
        lines.append(
            f"{view.name}: {aside}, {length(z)} mm before the piece, {_tell_height(y)} its middle"
            + ("" if table is None else f", {length(y - table.top_mm)} mm above the frame")
            + "."
        )
    if table is not None:
        files = ", ".join(f"table-{number}.3mf" for number in range(1, table.beds + 1))
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


def _tell_height(value: float) -> str:
    """Say how high a point is, as "12 mm above"."""
    if abs(value) < 0.05:
        return "level with"
    return f"{length(abs(value))} mm {'above' if value > 0 else 'below'}"


def _bar_outline(bar: Bar) -> Array:
    """Return a bar's corners on the page (4, 2), right and down; down leads away from the wall."""
    aside = 0.5 * bar.width_mm * np.array([-bar.along[1], bar.along[0]])
    end = bar.start + bar.length_mm * bar.along
    return np.stack([bar.start + aside, end + aside, end - aside, bar.start - aside]) * [1.0, -1.0]
