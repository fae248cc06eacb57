"""What is printed at full size: the holes of a piece on dowels, and the marks for a photograph."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement, placement_of
from knotfab.render.pages import (
    MARGIN_MM,
    PAGE_MM,
    RULER_MM,
    draw_foot,
    draw_ruler,
    draw_tile,
    lay_tiles,
    length,
    make_page,
    write_pages,
)
from knotfab.scene.camera import Camera

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

SPARE_DEPTH_MM = 1.0  # a hole is so much deeper than its dowel
FULL_SIZE = "print at 100 %, not fitted to the page"


def write_drill_template(
    folder: Path, mounted: Mounted, camera: Camera, suffix: str = ""
) -> list[str]:
    """Write drill-template.pdf of a wall mount on dowels.

    It prints at full size, on A4 and Letter, and shows the frame from the lamp's side, each hole a circle of
    its drill's diameter with cross hairs, its number and its drill. The same piece gives the same bytes.

    Args:
        suffix: of the file's name.

    Returns:
        The name of the file in a list, which is empty for any other mount.
    """
    if mounted.wall is None or mounted.wall.settings.foot != "dowel":
        return []
    place = placement_of(mounted, camera)
    across = np.array([peg.drill_mm for peg in mounted.wall.pegs])
    deep = length(mounted.wall.settings.dowel_depth_mm + SPARE_DEPTH_MM)
    reach = np.abs(place.holes).max(axis=0) + across.max()
    x, y = (float(v) for v in np.maximum(np.array(place.frame_mm) / 2 + 4.0, reach))
    tiles = lay_tiles((-x, -y, x, y))
    pages: list[Figure] = []
    said = f"{len(across)} holes, each with the drill beside its number (mm), {deep} mm deep, "
    said += "square to the wall. Arrow up, dashed line level."
    if len(tiles) > 1:
        said += " Lay the crosses of neighbouring pages on each other."
    for number, tile in enumerate(tiles, start=1):
        figure, axes, shift, window = draw_tile(tile)
        _draw_holes(place, across, axes, shift, window)
        axes.text(MARGIN_MM, MARGIN_MM + 14.5, said, size=6.5, va="top")
        draw_ruler(axes, "drill")
        where = f", row {tile.row + 1}, column {tile.column + 1}" if len(tiles) > 1 else ""
        draw_foot(axes, f"page {number} of {len(tiles)}", f"drill template{where}", FULL_SIZE)
        pages.append(figure)
    name = f"drill-template{suffix}.pdf"
    write_pages(folder / name, "Drill template at full size", pages)
    return [name]


def _draw_holes(place: Placement, across: Array, axes: Axes, off: Array, window: Rectangle) -> None:
    """Draw frame, holes and arrows on a page, moved by `off` (2,), mm, and clipped to the window."""
    from matplotlib.patches import Circle, Rectangle

    x, y = place.frame_mm[0] / 2, place.frame_mm[1] / 2
    corner = off - (x, y)
    frame = Rectangle((float(corner[0]), float(corner[1])), 2 * x, 2 * y, fill=False, lw=0.5)
    drawn: list[Artist] = [axes.add_patch(frame)]
    for ends in ([[-x, 0], [x, 0]], [[0, -y], [0, y]]):
        drawn += axes.plot(*(np.array(ends) + off).T, color="0.5", lw=0.25, ls=(0, (12, 6)))
    left, top = window.get_x(), window.get_y() + window.get_height()
    for number, ((u, v), wide) in enumerate(zip(place.holes + off, across, strict=True), start=1):
        drawn.append(axes.add_patch(Circle((u, v), wide / 2, fill=False, lw=0.4)))
        arm = wide / 2 + 1.5
        drawn += axes.plot([u - arm, u + arm], [v, v], color="black", lw=0.2)
        drawn += axes.plot([u, u], [v - arm, v + arm], color="black", lw=0.2)
        if left <= u <= left + window.get_width() - 4 and window.get_y() <= v <= top - 4:
            axes.text(u + wide / 2 + 0.4, v + 0.8, str(number), size=7, color="#a00")
            bit = length(ceil(10 * wide - 1e-6) / 10)  # bits are sold with no more digits
            axes.text(u + wide / 2 + 0.4, v - 0.8, bit, size=5, va="top", color="0.4")
    # the arrow: at the frame's upper edge and, so that each page has one, at the window's
    for at in ((float(off[0]) + 12.0, float(off[1]) + y - 18.0), (left + 14.0, top - 18.0)):
        drawn += axes.plot([at[0]] * 2, [at[1], at[1] + 9.0], color="#c00", lw=1.0)
        drawn += axes.plot(at[0], at[1] + 9.0, "^", ms=6, color="#c00", mew=0)
    for one in drawn:
        one.set_clip_path(window)
    axes.text(left + 16.0, top - 13.0, "up", size=8, color="#c00")


# Four cards to cut out, whose marks set a photograph of the shadow straight.

CARD_MM = 30.0
# a dot, a light ring and a dark one: of the disc that the dark ring bounds, 4/9 lie in it and 1/9 are dot
MARK_RADII_MM = (4.0, 8.0, 12.0)
_NAMES = ("top left", "top right", "bottom right", "bottom left")
# the corner of each card that is laid on, right and up
_INNER = ((1, -1), (-1, -1), (-1, 1), (1, 1))


def card_middles(frame_mm: tuple[float, float], margin_mm: float) -> Array:
    """Return the marks' middles (4, 2), mm right and down from the frame's first corner.

    Args:
        margin_mm: of the plate around the frame, whose corners the cards touch; 0 without a plate.
    """
    (w, h), off = frame_mm, margin_mm + CARD_MM / 2
    return np.array([[-off, -off], [w + off, -off], [w + off, h + off], [-off, h + off]])


def draw_marks_page(plate: bool) -> Figure:
    """Draw the page with the four cards that are cut out."""
    from matplotlib.patches import Circle, Rectangle

    figure, axes = make_page()
    left, top = MARGIN_MM + 4, PAGE_MM[1] - MARGIN_MM
    touched = "the plate" if plate else "the frame"
    axes.text(left, top, "Marks for a photograph", size=14, va="top")
    lines = (
        "Not needed to hang the piece: knotfab compare finds the frame by them in a photograph.",
        f"Print this page at 100 %, measure the ruler ({RULER_MM:.0f} mm), and cut the four cards out.",
        f"Tape them flat to the wall about {touched}, upright, the black corner of each on its corner.",
        "Photograph the shadow so that all four are seen, then: knotfab compare PHOTO FOLDER",
    )
    for k, line in enumerate(lines):
        axes.text(left, top - 11 - 5.0 * k, line, size=8, va="top")
    for k, (name, inner) in enumerate(zip(_NAMES, _INNER, strict=True)):
        column, row = (0, 1, 1, 0)[k], (0, 0, 1, 1)[k]
        x = PAGE_MM[0] / 2 + (column - 0.5) * 70.0
        y = PAGE_MM[1] / 2 + 30.0 - row * 70.0
        axes.add_patch(
            Rectangle(
                (x - CARD_MM / 2, y - CARD_MM / 2), CARD_MM, CARD_MM, fill=False, lw=0.3, ec="0.6"
            )
        )
        for radius, ink in zip(reversed(MARK_RADII_MM), ("black", "white", "black"), strict=True):
            axes.add_patch(Circle((x, y), radius, fc=ink, lw=0))
        corner = np.array([x, y]) + np.array(inner) * CARD_MM / 2
        for arm in np.diag(-4.0 * np.array(inner)):
            axes.plot(*np.stack([corner, corner + arm]).T, color="black", lw=1.2)
        axes.text(x, y - CARD_MM / 2 - 2, name, size=8, ha="center", va="top")
    draw_ruler(axes, "cut")
    draw_foot(axes, "last page", "marks for a photograph", "print at 100 %, not fitted")
    return figure
