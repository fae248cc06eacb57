"""Drawings of a mount: from the side, from the front, and from above where it has several views."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.lamp_frame import Table
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement
from knotfab.render.pages import (
    Box,
    Scaled,
    draw_dimension,
    fit_scale,
    length,
    outlines_of,
    project_outlines,
    write,
)
from knotfab.report.setup_words import lamp_name, level_wall
from knotfab_formats.views import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE: Box = (20.0, 196.0, 184.0, 252.0)  # the place on the page of each drawing
FRONT: Box = (18.0, 56.0, 104.0, 152.0)
ABOVE: Box = (26.0, 40.0, 184.0, 250.0)
ABOVE_WORDS: Box = (26.0, 92.0, 184.0, 250.0)  # the same where words stand below it
BESIDE_MM = 12.0  # a wall reaches so far beside its frame
INK, PIECE, LIGHT, FAINT, SHADOW, MEASURE = "black", "#8a8478", "#e0a400", "0.6", "0.82", "#06c"


def draw_side(axes: Axes, mounted: Mounted, place: Placement, view: View) -> Scaled:
    """Draw lamp, piece and wall from the left of someone at the lamp, which is at the right."""
    # axes to the right of the page: level towards the lamp; the viewer is at the piece's left
    seen = np.stack([place.level[2], place.level[1], -place.level[0]])
    piece = project_outlines(mounted.solids, seen)
    lamp = seen[:2] @ place.lamp
    frame, wall = _wall_lines(place, seen)
    ends = np.concatenate([*piece, frame, wall, lamp[None]])
    to = fit_scale(ends, SIDE)
    bottom = float(to(ends)[:, 1].min())
    _draw_light(axes, to, lamp, frame, seen[:2] @ place.middle, view)
    _fill(axes, [to(p) for p in piece], PIECE)
    _draw_wall(axes, to(wall), to(frame))
    write(axes, to(lamp) + (0, 3.2), lamp_name(view), size=7, ha="center")
    write(axes, to(wall[1]) + (1.0, 1.5), "wall", size=7, ha="left")
    middle, on_wall, at_lamp = to(np.zeros(2)), to(seen[:2] @ place.middle), to(lamp)
    _cross(axes, middle, 2.0, 0.4)
    for a, b, row, value in (
        (on_wall, middle, 5.0, view.wall_distance_mm),
        (middle, at_lamp, 5.0, view.light_distance_mm),
        (on_wall, at_lamp, 11.0, view.wall_distance_mm + view.light_distance_mm),
    ):
        down = bottom - row
        draw_dimension(axes, (a[0], down), (b[0], down), (0, 0), length(value))
        for p in (a, b):
            axes.plot([p[0], p[0]], [p[1] - 3, down - 1], color=MEASURE, lw=0.2)
    if place.base is not None:
        desk, gap = place.base.bottom, level_wall(place, place.base.bottom)
        at = (gap, place.base.back, place.base.front, lamp[0], lamp[0] + 20.0)
        wall_foot, back, front, foot, end = to(np.array([[x, desk] for x in at]))
        axes.plot(*np.stack([wall_foot, end]).T, color=INK, lw=0.8)
        draw_dimension(axes, foot, at_lamp, (5.0, 0.0), length(float(lamp[1]) - desk))
        draw_dimension(axes, wall_foot, back, (0.0, 3.5), length(place.base.back - gap))
        draw_dimension(axes, front, foot, (0.0, 3.5), length(float(lamp[0]) - place.base.front))
    axes.text(14.0, bottom - 17.0, f"Side view, from the left, {to.name}", size=7.5, va="top")
    return to


def _wall_lines(place: Placement, seen: Array) -> tuple[Array, Array]:
    """Return frame and wall as lines seen from the side, from below, (2, 2) each."""
    middle, up = seen[:2] @ place.middle, seen[:2] @ place.wall[1]
    half = place.frame_mm[1] / 2
    shown = BESIDE_MM + (half if place.plate_mm is None else place.plate_mm[1] / 2)
    top = max(shown, place.up_mm + BESIDE_MM)
    low = max(shown, BESIDE_MM - place.up_mm)
    if place.base is not None:
        low = max(low, (float(middle[1]) - place.base.bottom) / float(up[1]))
    frame = np.stack([middle - half * up, middle + half * up])
    return frame, np.stack([middle - low * up, middle + top * up])


def draw_front(axes: Axes, mounted: Mounted, place: Placement) -> Scaled:
    """Draw the wall as seen from the lamp: frame, shadow, plate, holes, the lamp's foot."""
    frame = np.array([[-0.5], [0.5]]) * place.frame_mm
    outer = frame if place.plate_mm is None else np.array([[-0.5], [0.5]]) * place.plate_mm
    foot_mm = np.array([place.right_mm, place.up_mm])
    ends = np.concatenate([outer, foot_mm[None]])
    if place.outline is not None:
        ends = np.concatenate([ends, place.outline])
    desk: float | None = None
    if place.base is not None:
        rise = float(place.wall[1] @ place.level[1])
        desk = (place.base.bottom - float(place.level[1] @ place.middle)) / rise
        ends = np.append(ends, [[0.0, desk]], axis=0)
    to = fit_scale(ends, FRONT)
    (x0, y0), (x1, y1) = to(frame)
    (left, lower), (right, upper) = to(outer)
    foot, low = to(foot_mm), float(to(ends)[:, 1].min()) - 3.5
    ground = None if desk is None else float(to(np.array([0.0, desk]))[1])
    _fill(axes, [to(p) for p in shadow_outlines(mounted, place)], SHADOW, ground)
    axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=INK, lw=0.5, ls="--")
    if place.plate_mm is not None:
        _draw_outline(axes, to(outer[[[0, 0], [1, 0], [1, 1], [0, 1]], [0, 1]]))
    elif place.outline is not None:
        _draw_outline(axes, to(place.outline))
    write(axes, ((x0 + x1) / 2, y1 - 1.0), "▲ up", size=7, ha="center", va="top")
    on_plate = place.plate_mm is not None or place.outline is not None
    for number, hole in enumerate(to(place.holes), start=1):
        axes.plot(*hole, "o", ms=2.6, mfc="white", mec=INK, mew=0.5, zorder=4)
        if not on_plate:
            write(axes, hole + (1.0, 0.4), str(number), size=5, zorder=5)
    # the lamp's foot is measured from the left and the lower edge of the body on the wall
    from_left, from_below = (length(v) for v in foot_mm - outer[0])
    for a, b, text in (
        ((left, upper + 3.5), (foot[0], upper + 3.5), from_left),
        ((left - 3.5, lower), (left - 3.5, foot[1]), from_below),
    ):
        draw_dimension(axes, a, b, (0, 0), text, color=LIGHT)
        axes.plot([b[0], foot[0]], [b[1], foot[1]], color=LIGHT, lw=0.25)
    axes.plot(*foot, "o", ms=5, mfc="none", mec=LIGHT, mew=0.8)
    _cross(axes, foot, 1.4, 0.5, LIGHT)
    write(axes, foot + (1.8, 1.2), "opposite the lamp", size=6, color="#8a6500")
    across = [("frame", x0, x1, place.frame_mm[0])]
    upright = [(right + 4.5, y0, y1, f"frame {length(place.frame_mm[1])}")]
    if on_plate and len(place.holes):
        (a, _), (b, _) = to(place.holes)
        across.append(("screw holes", a, b, float(np.ptp(place.holes[:, 0]))))
    if place.plate_mm is not None:
        across.append(("plate", left, right, place.plate_mm[0]))
        upright.append((right + 10.0, lower, upper, f"plate {length(place.plate_mm[1])}"))
    if desk is not None and ground is not None:
        axes.plot([x0 - 6.0, x1 + 6.0], [ground, ground], color=INK, lw=0.8)
        write(axes, (x0 - 6.0, ground + 0.8), "desk", size=6.5)
        upright.append((x1 + 9.0, ground, y0, length(frame[0, 1] - desk)))
    for x, a, b, text in upright:
        draw_dimension(axes, (x, a), (x, b), (0, 0), text)
    for name, a, b, value in across:
        draw_dimension(axes, (a, low), (b, low), (0, 0), f"{name} {length(value)}")
        low -= 5.5
    told = f"Front view, square to the wall, {to.name}. Dashed: the frame; grey: its shadow."
    write(axes, (14.0, low), told, size=7.5, va="top")
    return to


def shadow_outlines(mounted: Mounted, place: Placement) -> list[Array]:
    """Outline the shadow on the wall: polygons (n, 2), right and up from the frame's middle, mm."""
    onto_wall = np.column_stack([place.wall, -place.wall @ place.middle])
    return outlines_of(
        (  # a plate's face is the wall
            body.transform(onto_wall).trim_by_plane([0.0, 0.0, 1.0], 0.01).warp_batch(place.throw)
            for body in mounted.solids
        ),
        within_mm=0.05,
    )


def draw_from_above(
    axes: Axes, mounted: Mounted, places: Sequence[Placement], views: Sequence[View],
    table: Table | None, *, shared: bool,
) -> Scaled:  # fmt: skip
    """Draw piece, lamps and walls from above, the first lamp below the piece.

    Args:
        places, views: one of each for each lamp. table: the frame that holds lamps and screen, if any.
        shared: whether all lamps throw on one screen.
    """
    right, up, out = places[0].level
    above = np.stack([right, -out, up])  # axes: to the right and up the page, and to the viewer
    piece = project_outlines(mounted.solids, above)
    lamps = np.stack([above[:2] @ place.lamp for place in places])
    frames = [_across(place, above, 0.0) for place in places]
    walls = frames if shared else [_across(place, above, BESIDE_MM) for place in places]
    bars = []
    for bar in () if table is None else table.bars:
        aside = 0.5 * bar.width_mm * np.array([-bar.along[1], bar.along[0]])
        end = bar.start + bar.length_mm * bar.along
        bars.append(
            np.stack([bar.start + aside, end + aside, end - aside, bar.start - aside]) * (1, -1)
        )
    every = np.concatenate([*piece, *bars, *walls, lamps])
    to = fit_scale(every, ABOVE_WORDS if shared else ABOVE)
    for outline in bars:
        axes.fill(*to(outline).T, fc="0.9", ec=FAINT, lw=0.4)
    _fill(axes, [to(p) for p in piece], PIECE)
    for place, view, lamp, wall, frame in zip(places, views, lamps, walls, frames, strict=True):
        middle = above[:2] @ place.middle
        _draw_light(axes, to, lamp, frame, middle, view)
        _draw_wall(axes, to(wall), to(frame))
        if shared:
            write(axes, to(lamp) - (0.0, 3.5), view.name, size=7, ha="center", va="top")
        else:
            _dimension_view(axes, to(np.stack([lamp, middle, np.zeros(2)])), view, to.ratio)
    _cross(axes, to(np.zeros(2)), 2.0, 0.4)
    if shared:
        screen, where = above[:2] @ places[0].middle, length(views[0].wall_distance_mm)
        write(axes, to(screen) + (0.0, 3.0), f"screen: {where} behind", size=7, ha="center")
    return to


def _across(place: Placement, above: Array, beside: float) -> Array:
    """Return a wall from above, `beside` mm past its frame, at its middle's height, (2, 2)."""
    reach = place.frame_mm[0] / 2 + beside
    points = place.middle + np.array([[-reach], [reach]]) * place.wall[0]
    return np.asarray(points @ above[:2].T)


def _dimension_view(axes: Axes, ends: Array, view: View, ratio: float) -> None:
    """Name a view's lamp and wall, and dimension both from the middle: `ends` are these three places."""
    lamp, wall, middle = ends
    along = (wall - lamp) / np.linalg.norm(wall - lamp)
    aside = 4.0 * np.array([-along[1], along[0]])  # from a view's axis to its dimensions
    levelled = view.light_distance_mm * float(np.cos(np.deg2rad(view.elevation_deg)))
    draw_dimension(axes, lamp, middle, aside, length(levelled))
    draw_dimension(axes, middle, wall, aside, length(float(np.linalg.norm(wall - middle)) * ratio))
    # along the wall, read from below or from the right
    turn = (float(np.degrees(np.arctan2(aside[1], aside[0]))) + 89.9) % 180.0 - 89.9
    for at, name in ((lamp - 5.0 * along, lamp_name(view)), (wall + 5.0 * along, "wall")):
        write(axes, at, f"{name}: {view.name}", size=7, ha="center", va="center", rotation=turn)


def _draw_light(
    axes: Axes, to: Scaled, lamp: Array, frame: Array, middle: Array, view: View
) -> None:
    """Draw a lamp, its rays to the frame's ends, and its axis."""
    from matplotlib.patches import Circle

    for end in frame:
        axes.plot(*to(np.stack([lamp, end])).T, color=LIGHT, lw=0.4)
    axes.plot(*to(np.stack([lamp, middle])).T, color=FAINT, lw=0.3, ls="-.")
    at, radius = to(lamp), max(0.5 * view.light_size_mm / to.ratio, 0.5)
    axes.add_patch(Circle((float(at[0]), float(at[1])), radius, fc=LIGHT, lw=0.3, ec=INK, zorder=3))
    _cross(axes, at, 2.5, 0.25)


def _draw_wall(axes: Axes, wall: Array, frame: Array) -> None:
    """Draw a wall's line (2, 2) with the frame on it, its back hatched with short strokes."""
    axes.plot(*wall.T, color=INK, lw=0.8)
    axes.plot(*frame.T, color=INK, lw=1.8, solid_capstyle="butt")
    far = float(np.linalg.norm(wall[1] - wall[0]))
    unit = (wall[1] - wall[0]) / far
    for s in np.arange(1.5, far, 2.5):
        at = wall[0] + s * unit
        axes.plot(*np.stack([at, at + (-unit[1], unit[0]) - unit]).T, color=FAINT, lw=0.3)


def _fill(axes: Axes, polygons: Sequence[Array], color: str, above: float | None = None) -> None:
    """Fill polygons and their holes as one path; nothing below the height `above` is drawn."""
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    if rings := [Outline(np.append(p, p[:1], axis=0), closed=True) for p in polygons]:
        patch = PathPatch(Outline.make_compound_path(*rings), fc=color, lw=0)
        axes.add_patch(patch)
        if above is not None:
            patch.set_clip_path(Rectangle((0.0, above), 210.0, 297.0, transform=axes.transData))


def _draw_outline(axes: Axes, corners: Array) -> None:
    axes.plot(*np.append(corners, corners[:1], axis=0).T, color=INK, lw=0.8)


def _cross(axes: Axes, at: Array, reach: float, width: float, color: str = INK) -> None:
    """Draw a cross at a point (2,), `reach` mm to each side, in strokes `width` points wide."""
    for arm in (np.array([reach, 0.0]), np.array([0.0, reach])):
        axes.plot(*np.stack([at - arm, at + arm]).T, color=color, lw=width)
