"""The setting-up sheet: one page that puts lamp, piece and wall where the scene says, with dimensions."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.lamp_frame import frame_or_reason
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement, placement_of
from knotfab.hold.wall import mark_depth_mm
from knotfab.render.pages import (
    PAPERS,
    Box,
    Scaled,
    choose_fonts,
    draw_dimension,
    fit_scale,
    length,
    make_page,
    project_outlines,
    write_pages,
)
from knotfab.report.drill_template import draw_marks_page
from knotfab.report.setup_views import lamps_sheet, plan_sheet
from knotfab.report.setup_words import (
    FAINT,
    INK,
    LIGHT,
    PIECE,
    WORDS,
    costs_of,
    cross,
    draw_lamp,
    fill,
    hatch,
    lamp_facts,
    lamp_name,
    level_wall,
    note,
    steps_of,
)
from knotfab.scene.camera import Camera
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Misplacement
from knotfab_formats.views import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIDE: Box = (14.0, 176.0, 196.0, 268.0)  # the place on the page of each view's drawing
FRONT: Box = (20.0, 62.0, 108.0, 152.0)
WORDS_X, WORDS_Y, WORDS_WIDE = 118.0, 160.0, 58  # column of words: left, top, characters
LEFT, COSTS_Y = 14.0, 42.0
SHADOW = "0.82"


@dataclass(frozen=True)
class Sheets:
    """The pages on setting a piece up, one for each view, still without the costs of misplacement.

    `plan` shows everything from above, `marks` has the cards for a photograph. `threads_apart_mm`: distance
    of the two threads that the piece hangs on.
    """

    pages: list[Figure]
    plan: Figure | None
    marks: Figure
    views: tuple[View, ...]
    on_wall: bool
    threads_apart_mm: float | None = None


def draw_sheets(mounted: Mounted, scene: SettledScene, cameras: Sequence[Camera]) -> Sheets:
    """Draw the pages that set a piece up.

    Args:
        mounted: in scene coordinates. scene: with its frames resolved. cameras: of its views.
    """
    places = [placement_of(mounted, camera) for camera in cameras]
    each = zip(places, scene.views, strict=True)
    pages = [_draw_sheet(mounted, *view, alone=len(cameras) == 1) for view in each]
    plan = None
    if scene.share_wall:
        plan = lamps_sheet(mounted, places, scene.views, frame_or_reason(mounted)[0])
    elif len(pages) > 1:
        plan = plan_sheet(mounted, places, scene.views)
    plate = places[0].plate_mm is not None
    marks = draw_marks_page(PAPERS["a4"], plate)
    apart = None if mounted.hang is None else mounted.figures.threads_apart_mm
    return Sheets(pages, plan, marks, scene.views, mounted.wall is not None, apart)


def write_setup(
    folder: Path, sheets: Sheets, misplacements: Sequence[Misplacement | None], suffix: str = ""
) -> list[str]:
    """Write setup.pdf and setup.svg, A4, reproducible to the byte; return their names.

    With one view that is one page. With several, the first
    page, which is the SVG, shows all lamps and walls from above, and one page for each view
    follows. The last page of the PDF has the marks for a photograph.

    Args:
        sheets: from `draw_sheets`, which this call uses up. misplacements: each view's, as verified
            (`views[].misplacement` of the report), or None. suffix: of the files' names.
    """
    from matplotlib import rc_context

    for page, view, found in zip(sheets.pages, sheets.views, misplacements, strict=True):
        told = costs_of(
            found, view, on_wall=sheets.on_wall, threads_apart_mm=sheets.threads_apart_mm
        )
        _write_costs(page.axes[0], LEFT, told)
    pages = [*([] if sheets.plan is None else [sheets.plan]), *sheets.pages]
    names = [f"setup{suffix}.pdf", f"setup{suffix}.svg"]
    write_pages(folder / names[0], "Setting up", [*pages, sheets.marks])
    settings: Any = {"svg.hashsalt": "knotfab", "path.simplify": False}
    about = {"Date": None, "Creator": "knotfab", "Title": "Setting up"}
    choose_fonts(pages[0])
    with rc_context(settings):
        pages[0].savefig(folder / names[1], metadata=about)
    return names


def _draw_sheet(mounted: Mounted, place: Placement, view: View, *, alone: bool) -> Figure:
    paper = PAPERS["a4"]
    figure, axes = make_page(paper)
    side = _side_view(axes, mounted, place, view)
    front = _front_view(axes, mounted, place)
    left, top = LEFT, paper.height - 12
    title = "Setting up" if alone else f"Setting up: {view.name}"
    axes.text(left, top, title, size=15, va="top", gid=WORDS)
    axes.text(
        left, top - 8.0,
        "Lengths in mm, from the middle of the lamp and of the piece. What counts is the figures, "
        f"not the drawing. Side view {side.name}, front view {front.name}.",
        size=6.5, va="top", gid=WORDS, color="0.35",
    )  # fmt: skip
    y = _write_column(axes, WORDS_Y, "What to do", steps_of(mounted, place, view), numbered=True)
    _write_column(axes, y - 3.0, "The lamp", lamp_facts(view))
    return figure


def _write_column(
    axes: Axes, top: float, title: str, lines: Sequence[str], *, numbered: bool = False
) -> float:
    """Write lines down the right-hand column from `top`; return the height where they end."""
    axes.text(WORDS_X, top, title, size=9, va="top", gid=WORDS, weight="bold")
    y = top - 6.0
    for number, line in enumerate(lines, start=1):
        head = f"{number}. " if numbered else ""
        for k, row in enumerate(textwrap.wrap(line, WORDS_WIDE - len(head))):
            axes.text(WORDS_X + (3.5 if head else 0.0), y, row, size=6.5, va="top", gid=WORDS)
            if head and k == 0:
                axes.text(WORDS_X, y, head, size=6.5, va="top", gid=WORDS)
            y -= 3.2
        y -= 1.4
    return y


def _write_costs(axes: Axes, left: float, lines: Sequence[str]) -> None:
    axes.text(left, COSTS_Y, "What it costs to be off", size=9, va="top", gid=WORDS, weight="bold")
    half = (len(lines) + 1) // 2
    for k, line in enumerate(lines):
        x = left if k < half else left + 94.0
        axes.text(x, COSTS_Y - 6.0 - 3.6 * (k % half), line, size=6.5, va="top", gid=WORDS)
    axes.text(
        left, COSTS_Y - 8.5 - 3.6 * half,
        "Measured on the written file, over 5 mm and 1°, against the picture where it should be on the "
        "wall: a shadow that merely moves counts as lost too.",
        size=6, va="top", gid=WORDS, color="0.35",
    )  # fmt: skip


def _side_view(axes: Axes, mounted: Mounted, place: Placement, view: View) -> Scaled:
    """Draw lamp, piece and wall from the left of someone at the lamp, which is at the right."""
    # axes to the right of the page: level towards the lamp; the viewer is at the piece's left
    seen = np.stack([place.level[2], place.level[1], -place.level[0]])
    piece = project_outlines(mounted.solids, seen)
    lamp = seen[:2] @ place.lamp
    frame, wall = _wall_lines(place, seen)
    ends = np.concatenate([*piece, frame, wall, lamp[None]])
    base = place.base
    desk = base.bottom if base is not None else None
    zone = (SIDE[0] + 6, SIDE[1] + 20, SIDE[2] - 12, SIDE[3] - 8)
    to = fit_scale(ends, zone)
    bottom = float(to(ends)[:, 1].min())
    for end in frame:
        axes.plot(*to(np.stack([lamp, end])).T, color=LIGHT, lw=0.4)
    axes.plot(*to(np.stack([lamp, seen[:2] @ place.middle])).T, color=FAINT, lw=0.3, ls="-.")
    fill(axes, [to(p) for p in piece], PIECE)
    axes.plot(*to(wall).T, color=INK, lw=0.8)
    axes.plot(*to(frame).T, color=INK, lw=1.8, solid_capstyle="butt")
    draw_lamp(axes, to(lamp), view.light_size_mm / to.ratio)
    hatch(axes, to(wall))
    note(axes, to(lamp) + (0, 3.2), lamp_name(view), size=7, ha="center")
    note(axes, to(wall[1]) + (1.0, 1.5), "wall", size=7, ha="left")
    middle = to(np.zeros(2))
    cross(axes, middle, 2.0, 0.4)
    on_wall, at_lamp = to(seen[:2] @ place.middle), to(lamp)
    for a, b, row, value in (
        (on_wall, middle, 5.0, view.wall_distance_mm),
        (middle, at_lamp, 5.0, view.light_distance_mm),
        (on_wall, at_lamp, 11.0, view.wall_distance_mm + view.light_distance_mm),
    ):
        down = bottom - row
        draw_dimension(axes, (a[0], down), (b[0], down), (0, 0), length(value))
        for p in (a, b):
            axes.plot([p[0], p[0]], [p[1] - 3, down - 1], color="#06c", lw=0.2)
    if abs(view.wall_tilt_deg) > 1e-9:
        _draw_tilt(axes, place, seen, to, view.wall_tilt_deg)
    if desk is not None and base is not None:
        _draw_desk(axes, place, seen, to, desk)
    axes.text(SIDE[0], bottom - 17.0, f"Side view, from the left, {to.name}", size=7.5, va="top")
    return to


def _wall_lines(place: Placement, seen: Array) -> tuple[Array, Array]:
    """Return frame and wall as lines seen from the side, from below, (2, 2) each."""
    middle, up = seen[:2] @ place.middle, seen[:2] @ place.wall[1]
    half = place.frame_mm[1] / 2
    shown = (half if place.plate_mm is None else place.plate_mm[1] / 2) + 12.0
    top = max(shown, place.up_mm + 12.0)
    low = max(shown, 12.0 - place.up_mm)
    if place.base is not None:
        low = max(low, (float(middle[1]) - place.base.bottom) / float(up[1]))
    frame = np.stack([middle - half * up, middle + half * up])
    return frame, np.stack([middle - low * up, middle + top * up])


def _draw_tilt(axes: Axes, place: Placement, seen: Array, to: Scaled, tilt: float) -> None:
    """Draw a tilted wall's angle, and the lamp's distance square to it."""
    foot = place.lamp - place.off_wall_mm * place.wall[2]
    a, b = to(np.stack([foot, place.lamp]) @ seen[:2].T)
    axes.plot(*np.stack([a, b]).T, color="#06c", lw=0.3, ls=":")
    draw_dimension(axes, a, b, (0, 0), f"{length(place.off_wall_mm)} square to the wall")
    x, y = to(seen[:2] @ place.middle)
    lean = "towards" if tilt > 0 else "away from"
    axes.text(
        x - 9.0, y, f"top leans {abs(tilt):g}° {lean} the lamp", size=6.5, rotation=90 - tilt,
        ha="right", va="center", rotation_mode="anchor", color="#06c",
    )  # fmt: skip


def _draw_desk(axes: Axes, place: Placement, seen: Array, to: Scaled, desk: float) -> None:
    """Draw the desk, the lamp's height above it, and where the base stands."""
    assert place.base is not None
    lamp = seen[:2] @ place.lamp
    gap = level_wall(place, desk)
    ends = to(np.array([[gap, desk], [lamp[0] + 20.0, desk]]))
    axes.plot(*ends.T, color=INK, lw=0.8)
    foot = to(np.array([lamp[0], desk]))
    away = (5.0, 0.0)
    draw_dimension(axes, foot, to(lamp), away, length(float(lamp[1]) - desk))
    back, front = (to(np.array([x, desk])) for x in (place.base.back, place.base.front))
    wall = to(np.array([gap, desk]))
    up = (0.0, 3.5)
    draw_dimension(axes, wall, back, up, length(place.base.back - gap))
    draw_dimension(axes, front, foot, up, length(float(lamp[0]) - place.base.front))


def _front_view(axes: Axes, mounted: Mounted, place: Placement) -> Scaled:
    """Draw the wall as seen from the lamp: frame, shadow, plate, marks, holes, the lamp's foot."""
    from matplotlib.patches import Rectangle

    wide, high = place.frame_mm
    outer = place.plate_mm or place.frame_mm
    foot = np.array([place.right_mm, place.up_mm])
    ends = np.array([[-outer[0] / 2, -outer[1] / 2], [outer[0] / 2, outer[1] / 2], foot])
    if place.outline is not None:
        ends = np.concatenate([ends, place.outline])
    desk: float | None = None
    if place.base is not None:
        rise = float(place.wall[1] @ place.level[1])
        desk = (place.base.bottom - float(place.level[1] @ place.middle)) / rise
        ends = np.append(ends, [[0.0, desk]], axis=0)
    to = fit_scale(ends, FRONT)
    below = None if desk is None else float(to(np.array([0.0, desk]))[1])
    fill(axes, [to(p) for p in shadow_outlines(mounted, place)], SHADOW, below)
    for size, width in ((place.plate_mm, 0.8), (place.frame_mm, 0.5)):
        if size is not None:
            at = to(np.array([-size[0] / 2, -size[1] / 2]))
            axes.add_patch(
                Rectangle(
                    (float(at[0]), float(at[1])), size[0] / to.ratio, size[1] / to.ratio,
                    fill=False, lw=width, ec=INK, ls="-" if size is place.plate_mm else "--",
                )
            )  # fmt: skip
    if place.outline is not None:
        axes.plot(*to(np.append(place.outline, place.outline[:1], axis=0)).T, color=INK, lw=0.8)
    _draw_marks(axes, mounted, place, to)
    if desk is not None:
        line = to(np.array([[-0.6 * wide, desk], [0.6 * wide, desk]]))
        axes.plot(*line.T, color=INK, lw=0.8)
        note(axes, line[0] + (0, 0.8), "desk", size=6.5)
        corner = to(np.array([0.5 * wide, -0.5 * high]))
        draw_dimension(axes, (corner[0], line[0][1]), corner, (6, 0), length(-high / 2 - desk))
    _front_dimensions(axes, place, to, float(to(ends)[:, 1].min()))
    axes.text(
        FRONT[0] - 6, COSTS_Y + 6.0,
        f"Front view, square to the wall, {to.name}. "
        "Dashed: the frame; grey: its shadow.",
        size=7.5, va="top",
    )  # fmt: skip
    return to


def _front_dimensions(axes: Axes, place: Placement, to: Scaled, bottom: float) -> None:
    wide, high = place.frame_mm
    outer = place.plate_mm or place.frame_mm
    corners = to(np.array([[-outer[0] / 2, -outer[1] / 2], [outer[0] / 2, outer[1] / 2]]))
    inner = to(np.array([[-wide / 2, -high / 2], [wide / 2, high / 2]]))
    foot = to(np.array([place.right_mm, place.up_mm]))
    down = bottom - 3.5
    draw_dimension(axes, (inner[0][0], down), (inner[1][0], down), (0, 0), f"frame {length(wide)}")
    right = float(corners[1][0]) + 4.5
    draw_dimension(
        axes, (right, inner[0][1]), (right, inner[1][1]), (0, 0), f"frame {length(high)}"
    )
    # the lamp's foot is measured from the left and the lower edge of the body on the wall
    top = float(corners[1][1]) + 3.5
    draw_dimension(
        axes, (corners[0][0], top), (foot[0], top), (0, 0),
        length(place.right_mm + outer[0] / 2), color=LIGHT,
    )  # fmt: skip
    left = float(corners[0][0]) - 3.5
    draw_dimension(
        axes, (left, corners[0][1]), (left, foot[1]), (0, 0),
        length(place.up_mm + outer[1] / 2), color=LIGHT,
    )  # fmt: skip
    axes.plot([foot[0], foot[0]], [foot[1], top + 1], color=LIGHT, lw=0.25)
    axes.plot([left - 1, foot[0]], [foot[1], foot[1]], color=LIGHT, lw=0.25)
    axes.plot(*foot, "o", ms=5, mfc="none", mec=LIGHT, mew=0.8)
    axes.plot(*foot, "+", ms=8, color=LIGHT, mew=0.5)
    note(axes, foot + (1.8, 1.2), "opposite the lamp", size=6, color="#8a6500")
    y = down - 5.5
    if len(place.holes) and (place.outline is not None or place.plate_mm is not None):
        a, b = to(place.holes)
        apart = length(float(np.ptp(place.holes[:, 0])))
        draw_dimension(axes, (a[0], y), (b[0], y), (0, 0), f"screw holes {apart}")
    if place.plate_mm is not None:
        y -= 5.5
        draw_dimension(
            axes, (corners[0][0], y), (corners[1][0], y), (0, 0), f"plate {length(outer[0])}"
        )
        x = right + 5.5
        draw_dimension(
            axes, (x, corners[0][1]), (x, corners[1][1]), (0, 0), f"plate {length(outer[1])}"
        )


def _draw_marks(axes: Axes, mounted: Mounted, place: Placement, to: Scaled) -> None:
    """Draw screw holes or drill holes, the plate's notches, and which way is up."""
    for number, hole in enumerate(to(place.holes), start=1):
        axes.plot(*hole, "o", ms=2.6, mfc="white", mec=INK, mew=0.5, zorder=4)
        if place.plate_mm is None and place.outline is None:
            note(axes, hole + (1.0, 0.4), str(number), size=5, zorder=5)
    wall = mounted.wall
    if place.plate_mm is not None and wall is not None and mark_depth_mm(wall.settings):
        x, y = (s / 2 for s in place.plate_mm)
        for at, marker in (((0, y), "v"), ((0, -y), "^"), ((-x, 0), ">"), ((x, 0), "<")):
            axes.plot(*to(np.array(at)), marker, ms=3, color=INK, mew=0)
        axes.plot(*(to(np.array([0.0, y])) - (0, 2.4)), "^", ms=4, color=INK, mew=0)
    elif place.plate_mm is None:
        note(
            axes,
            to(np.array([0.0, place.frame_mm[1] / 2])) - (0, 1.0),
            "▲ up",
            size=7,
            ha="center",
            va="top",
        )


def shadow_outlines(mounted: Mounted, place: Placement, within_mm: float = 0.05) -> list[Array]:
    """Outline the shadow on the wall: polygons (n, 2), right and up from the frame's middle, mm."""
    from manifold3d import CrossSection

    flat = CrossSection()
    onto_wall = np.column_stack([place.wall, -place.wall @ place.middle])
    for body in mounted.solids:
        # a plate's face is the wall
        solid = body.transform(onto_wall).trim_by_plane([0.0, 0.0, 1.0], 0.01)
        flat += solid.warp_batch(place.throw).project()
    return [np.asarray(p, dtype=np.float64) for p in flat.simplify(within_mm).to_polygons()]
