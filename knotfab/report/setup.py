"""The setting-up sheet: one page that puts lamp, piece and wall where the scene says, with dimensions."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knotfab.hold.lamp_frame import ROD_MM, Table, frame_or_reason
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement, placement_of
from knotfab.render.pages import length, make_page, write_pages
from knotfab.report.drill_template import draw_marks_page
from knotfab.report.setup_views import draw_from_above, draw_front, draw_side
from knotfab.report.setup_words import lamp_facts, steps_of, tell_height, tell_lamp
from knotfab.scene.camera import Camera
from knotfab_formats.scene import SettledScene
from knotfab_formats.views import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WORDS = "words"  # the name, in the SVG, of parts beside the drawing that are told with it
LEFT, TOP = 14.0, 270.0  # of the page's title
WORDS_X, WORDS_Y, WORDS_WIDE = 118.0, 160.0, 58  # column of words: left, top, characters
FIGURES = (
    "Lengths in mm, from the middle of the lamp and of the piece. What counts is the figures, "
)


def write_setup(
    folder: Path, mounted: Mounted, scene: SettledScene, cameras: Sequence[Camera], suffix: str = ""
) -> list[str]:
    """Write setup.pdf and setup.svg, reproducible to the byte; return their names.

    With one view that is one page. With several, the first page, which is the SVG, shows all lamps and
    walls from above, and one page for each view follows. The last page of the PDF has the marks for a
    photograph.

    Args:
        mounted: in scene coordinates. scene: with its frames resolved. cameras: of its views.
        suffix: of the files' names.
    """
    from matplotlib import rc_context

    places = [placement_of(mounted, camera) for camera in cameras]
    several = len(places) > 1
    pages = [
        _draw_view_page(
            mounted, place, view, f"Setting up: {view.name}" if several else "Setting up"
        )
        for place, view in zip(places, scene.views, strict=True)
    ]
    if several:
        table = frame_or_reason(mounted)[0] if scene.share_wall else None
        pages.insert(0, _draw_first_page(mounted, places, scene, table))
    names = [f"setup{suffix}.pdf", f"setup{suffix}.svg"]
    marks = draw_marks_page(places[0].plate_mm is not None)
    write_pages(folder / names[0], "Setting up", [*pages, marks])
    settings: Any = {"svg.hashsalt": "knotfab", "path.simplify": False}
    about = {"Date": None, "Creator": "knotfab", "Title": "Setting up"}
    with rc_context(settings):
        pages[0].savefig(folder / names[1], metadata=about)
    return names


def _draw_view_page(mounted: Mounted, place: Placement, view: View, title: str) -> Figure:
    figure, axes = make_page()
    side = draw_side(axes, mounted, place, view)
    front = draw_front(axes, mounted, place)
    scales = f"Side view {side.name}, front view {front.name}."
    _write_head(axes, title, [f"{FIGURES}not the drawing. {scales}"])
    y = _write_column(axes, WORDS_Y, "What to do", steps_of(mounted, place, view), numbered=True)
    _write_column(axes, y - 3.0, "The lamp", lamp_facts(view))
    return figure


def _draw_first_page(
    mounted: Mounted, places: Sequence[Placement], scene: SettledScene, table: Table | None
) -> Figure:
    """Draw the page of several views: all of it from above, and where lamps of one screen stand."""
    figure, axes = make_page()
    views, shared = scene.views, scene.share_wall
    to = draw_from_above(axes, mounted, places, views, table, shared=shared)
    follow = "The pages that follow place one view each."
    if places[0].base is not None:
        follow = f"The front of the base is below in this drawing. {follow}"
    if not shared:
        follow = f"{len(views)} pictures, each on its own wall and by its own light. {follow}"
    _write_head(axes, "Setting up", [f"{FIGURES}not the drawing. From above, {to.name}.", follow])
    if shared:
        lines = _tell_screen(places, views, table)
        rows = [row for line in lines for row in textwrap.wrap(line, 120)]
        for number, row in enumerate(rows):
            axes.text(LEFT, 80.0 - 4.2 * number, row, size=7, va="top", gid=WORDS)
    return figure


def _tell_screen(
    places: Sequence[Placement], views: Sequence[View], table: Table | None
) -> list[str]:
    """Say how large a picture lamps throw on one screen, where they stand, and what holds all of it."""
    first, top = places[0], None if table is None else table.top_mm
    across, high = first.frame_mm
    middle = float(first.level[1] @ first.middle)
    lines = [
        f"The screen's picture is {length(across)} × {length(high)} mm, its middle "
        f"{tell_height(middle)} the middle of the piece.",
        *(tell_lamp(place, view, top) for place, view in zip(places, views, strict=True)),
    ]
    if table is None:
        return lines
    files = ", ".join(f"table-{number}.3mf" for number in range(1, table.beds + 1))
    return [
        *lines,
        f"The picture's lower edge is {length(middle - high / 2 - table.top_mm)} mm above the frame, on "
        "which its card stands.",
        f"The frame ({files}) holds all of it: press the bars together, put a card of 3 mm into its slot "
        f"and rods of {length(ROD_MM)} mm into the holes, each lamp's middle at its height.",
        "The small hole is right below the middle of the piece."
        if first.base is None
        else "The stand's foot goes between the low ridges.",
    ]


def _write_head(axes: Axes, title: str, lines: Sequence[str]) -> None:
    axes.text(LEFT, TOP, title, size=15, va="top", gid=WORDS)
    for k, line in enumerate(lines):
        axes.text(LEFT, TOP - 8.0 - 4.0 * k, line, size=6.5, va="top", gid=WORDS, color="0.35")


def _write_column(
    axes: Axes, top: float, title: str, lines: Sequence[str], *, numbered: bool = False
) -> float:
    """Write lines down the right-hand column from `top`; return the height where they end."""
    axes.text(WORDS_X, top, title, size=9, va="top", gid=WORDS, weight="bold")
    y, indent = top - 6.0, 3.5 if numbered else 0.0
    for number, line in enumerate(lines, start=1):
        if numbered:
            axes.text(WORDS_X, y, f"{number}. ", size=6.5, va="top", gid=WORDS)
        for row in textwrap.wrap(line, WORDS_WIDE - (3 if numbered else 0)):
            axes.text(WORDS_X + indent, y, row, size=6.5, va="top", gid=WORDS)
            y -= 3.2
        y -= 1.4
    return y
