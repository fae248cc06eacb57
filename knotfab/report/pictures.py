"""The pictures that a report shows, found in its folder."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from shapely import MultiPolygon, Polygon

from knotfab.base.arrays import Array, Mask
from knotfab.design.hull import HullBound
from knotfab.design.sentence import with_noun
from knotfab.design.survey import SPILL, Survey, ViewSurvey
from knotfab.geometry.polylines import polylines_of
from knotfab.hold.mount import Mounted
from knotfab.knots import Knots
from knotfab.picture.fonts import needs_shaping, supplied_folder
from knotfab.picture.opening import Loss
from knotfab.picture.raster import encode_image
from knotfab.picture.read import Target
from knotfab.picture.silhouette import fit_size
from knotfab.render.image import image_at
from knotfab.render.pages import length
from knotfab.render.part_picture import turn_upright, write_gif
from knotfab.report.page import Picture
from knotfab.scene.camera import view_axes
from knotfab_formats.print_figures import Turning
from knotfab_formats.scene import SettledScene


def find_pictures(folder: Path) -> list[Picture]:
    """Find the report's pictures in a folder, and caption them."""
    found = []
    part = folder / "part.png"
    for path in sorted(folder.glob("failures*.png")):
        name = path.stem.replace("failures-", "part-").replace("failures", "the part")
        found.append(Picture(path, "part", f"where {name} fails its checks"))
    colours = folder / "compare-colours.png"
    if colours.is_file():
        caption = "the picture, the colours that the lamps can mix of it, what is seen, and where it is wrong"
        found.append(Picture(colours, "colours", caption))
        for path in sorted(folder.glob("shadow-*.png")):
            found.append(Picture(path, "alone", "", path.stem.removeprefix("shadow-")))
    for path in sorted(set(folder.glob("compare-*.png")) - {colours}):
        caption = "target, shadow of the written file, and where they differ"
        found.append(Picture(path, "compare", caption, path.stem.removeprefix("compare-")))
    for path in sorted(folder.glob("bent-*.png")):
        caption = "the picture as it came, as it is bent, and what all pictures leave of it"
        found.append(Picture(path, "bent", caption, path.stem.removeprefix("bent-")))
    for path in sorted(folder.glob("soft-*.png")):
        caption = "the shadow as a lamp of this size throws it"
        found.append(Picture(path, "shadow", caption, path.stem.removeprefix("soft-")))
    turn = folder / TURN_FILE
    if turn.is_file():
        found.append(Picture(turn, "turn", "the shadow under one lamp, over a full turn"))
    if part.is_file():
        found.append(
            Picture(part, "part", "from the light of each view, then turned about the vertical")
        )
    return found


# A piece of several views that turns under one fixed lamp: at which angles it shows its pictures.

TURN_FILE = "turn.gif"
STEP_DEG, PIXELS = 5.0, 240
FRAME_MS, HOLD_MS = 60, 900  # while it turns, and where it shows a picture
WALL, SHADOW = (250, 248, 244), (52, 49, 45)
_LEAST_MM = 1.0  # the least shift to the side that is told
# keys that must be the same in all views for one lamp to serve them
_SHARED = (
    *("kind", "light_distance_mm", "wall_distance_mm", "wall_tilt_deg"),
    *("elevation_deg", "light_right_mm", "light_up_mm"),
)


def turns_of(scene: SettledScene) -> dict[str, float]:
    """Find the angle, 0 to 360°, that brings each view before the first view's lamp.

    The piece turns about the vertical, anticlockwise from above. The result is empty for an eye, for one
    view, and where lamps or walls differ in height or distance, so that the views cannot share a lamp.
    """
    first = scene.views[0]
    alike = all(getattr(v, key) == getattr(first, key) for v in scene.views for key in _SHARED)
    if len(scene.views) < 2 or not alike or first.kind != "shadow" or first.elevation_deg != 0:
        return {}
    angles = {}
    for view in scene.views:
        turn = view_axes(first).T @ view_axes(view)
        angles[view.name] = float(np.degrees(np.arctan2(turn[0, 2], turn[0, 0]))) % 360.0
    return angles


def turn_piece(folder: Path, mounted: Mounted, knots: Knots) -> tuple[Turning | None, list[str]]:
    """Say at which angles a piece on a stand or thread shows its pictures, and write turn.gif."""
    angles = turns_of(mounted.scene)
    if not angles or (mounted.stand is None and mounted.hang is None):
        return None, []
    axis = np.zeros(3) if mounted.hang is None else mounted.hang.threads[0]
    view = mounted.scene.views[0]
    aside = {}
    for name, angle in angles.items():
        moved = (axis - turn_upright(axis, angle)) @ view_axes(view)[0]
        aside[name] = float(moved) * view.magnification
    words = [f"{name} at {angle:.0f}°{_tell_aside(aside[name])}" for name, angle in angles.items()]
    about = (
        "its thread" if mounted.stand is None else "the vertical through the middle of the scene"
    )
    note = f"Turned about {about} under the first lamp alone, it shows {', '.join(words)} ({TURN_FILE})."
    _write_turn(folder / TURN_FILE, mounted.scene, knots, axis, list(angles.values()))
    return Turning(angles, aside), [note]


def _tell_aside(aside_mm: float) -> str:
    if abs(aside_mm) < _LEAST_MM:
        return ""
    return f" ({length(abs(aside_mm))} mm to the {'right' if aside_mm > 0 else 'left'})"


def _write_turn(
    path: Path, scene: SettledScene, knots: Knots, axis: Array, shown: list[float]
) -> None:
    view, curves = scene.views[0], [knot.points for knot in knots.knots]
    points, rings = np.concatenate(curves), polylines_of(curves)
    reach = float(np.hypot(*(points - axis)[:, [0, 2]].T).max() + np.hypot(axis[0], axis[2]))
    near = view.light_distance_mm / max(view.light_distance_mm - reach, 1.0)
    wide = 2.2 * (reach + knots.radius_mm) * near * view.magnification
    high = 2.2 * (np.abs(points[:, 1]).max() + knots.radius_mm) * near * view.magnification
    frame = {
        "frame_width_mm": max(wide, view.frame_width_mm),
        "frame_height_mm": max(high, view.frame_height_mm),
        "frame_up_mm": 0.0,
    }
    image = image_at(view.but(**frame), np.zeros((8, 8), dtype=bool), knots.radius_mm, PIXELS)
    turns = sorted({*np.arange(0.0, 360.0, STEP_DEG), *shown})
    frames = []
    for angle in turns:
        dark = image.seen(turn_upright(points - axis, angle) + axis, rings, knots.radius_mm)
        frames.append(Image.fromarray(np.where(dark[..., None], SHADOW, WALL).astype(np.uint8)))
    write_gif(path, frames, [HOLD_MS if angle in shown else FRAME_MS for angle in turns])


# A survey as one picture: each silhouette, and in red what the build's tube and thicker ones lose.

_PANEL = 360  # px
_TEXT = 34  # px of the caption above each
_GAP = 12  # px between panels
_FINER = 3  # drawn so many times as large and brought down
_PAPER, _INK, _FRAME = (250, 248, 244), (60, 58, 56), (214, 208, 198)
_FAINT, _RED = (196, 190, 182), (212, 30, 30)
_SEEN_AS = "the colours that will be seen"
_SEEN = 9.0  # px: a smaller loss gets a ring about it


class Panel(NamedTuple):
    """A silhouette, or what a tube leaves of it, and the words above it."""

    caption: str
    image: Image.Image


def draw_survey(found: Survey) -> bytes:
    """Draw a PNG with a row for each picture: its silhouette and one panel for each radius."""
    return _lay_out(_draw_rows(found))


def draw_agreement(target: Target, bound: HullBound) -> bytes:
    """Draw a PNG of a picture as it came, as it was bent, and what all views leave of it."""
    return _lay_out([_agreement(target, bound, _PANEL)])


def _lay_out(panels: Sequence[Sequence[Panel]]) -> bytes:
    """Lay rows of panels with their captions on one sheet; return it as PNG."""
    rows = [[_with_caption(panel) for panel in row] for row in panels]
    width = _GAP + max(len(row) for row in rows) * (_PANEL + _GAP)
    heights = [max(p.height for p in row) + _GAP for row in rows]
    sheet = Image.new("RGB", (width, _GAP + sum(heights)), _PAPER)
    top = _GAP
    for row, height in zip(rows, heights, strict=True):
        for n, panel in enumerate(row):
            sheet.paste(panel, (_GAP + n * (_PANEL + _GAP), top))
        top += height
    return encode_image(sheet, compress_level=6)


def draw_panels(found: Survey, side_px: int = 2 * _PANEL) -> list[Panel]:
    """Draw the panels of all pictures in their order, `side_px` on the longer side."""
    return [panel for row in _draw_rows(found, side_px) for panel in row]


def _draw_rows(found: Survey, side_px: int = _PANEL) -> list[list[Panel]]:
    """Draw each picture's panels: the silhouette, what agrees with the others, and what tubes lose."""
    colours = []
    if (parted := found.parted) is not None:
        came = Image.open(io.BytesIO(parted.png))
        seen = Image.open(io.BytesIO(parted.seen_png()))
        colours = [
            [_picture_panel("as it came", came, side_px), _picture_panel(_SEEN_AS, seen, side_px)]
        ]
    bounds = found.bounds or (None,) * len(found.views)
    return colours + [
        (_agreement(seen.target, bound, side_px) if bound else [_draw_panel(seen, None, side_px)])
        + [_draw_panel(seen, radius, side_px) for radius in seen.losses]
        for seen, bound in zip(found.views, bounds, strict=True)
    ]


def _agreement(target: Target, bound: HullBound, side_px: int) -> list[Panel]:
    panels = [_mask_panel(f"{target.shown[:30]}, as it came", target.asked, side_px)]
    if (bent := target.bending) is not None:
        said = f"as bent: {bent.rms:.1%} on average, {bent.most:.1%} at most"
        panels.append(_mask_panel(said, target.mask, side_px))
    lost = bound.wanted & ~bound.covered
    said = f"what all leave of it: {bound.iou:.3f}"
    return [*panels, _mask_panel(said, bound.covered, side_px, lost)]


def _mask_panel(caption: str, mask: Mask, side_px: int, lost: Mask | None = None) -> Panel:
    """Draw a mask in ink, and what is `lost` in red."""
    colours = np.where(mask[..., None], _INK, _PAPER)
    if lost is not None:
        colours = np.where(lost[..., None], _RED, colours)
    return _picture_panel(caption, Image.fromarray(colours.astype(np.uint8)), side_px)


def _picture_panel(caption: str, picture: Image.Image, side_px: int) -> Panel:
    """Draw a picture inside a frame."""
    picture = picture.convert("RGB")
    picture = picture.resize(fit_size(*picture.size, side_px), Image.Resampling.LANCZOS)
    ends = (0, 0, picture.width - 1, picture.height - 1)
    ImageDraw.Draw(picture).rectangle(ends, outline=_FRAME)
    return Panel(caption, picture)


def _with_caption(panel: Panel) -> Image.Image:
    picture = panel.image
    sheet = Image.new("RGB", (_PANEL, _TEXT + picture.height), _PAPER)
    sheet.paste(picture, (0, _TEXT))
    said, font = panel.caption, ImageFont.load_default(14)
    if not said.isascii():
        wide = ImageFont.truetype(f"{supplied_folder()}/DejaVuSans.ttf", 13)
        box = bytes(wide.getmask("\U0010ffff"))  # no font draws that sign
        # a name in a script that this font lacks, or cannot set, is left out
        while ", " in said and (
            needs_shaping(said) or any(bytes(wide.getmask(c)) == box for c in said)
        ):
            said = said.partition(", ")[2]
        font = font if said.isascii() else wide
    ImageDraw.Draw(sheet).text((0, 8), said, fill=_INK, font=font)
    return sheet


def _draw_panel(seen: ViewSurvey, radius: float | None, side_px: int) -> Panel:
    """Draw the silhouette, or what a tube of `radius` mm leaves of it and loses, in red."""
    width, height = seen.target.width, seen.target.height
    scale = side_px * _FINER / max(width, height)
    size = fit_size(width, height, side_px * _FINER)
    picture = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(picture)
    lost = [] if radius is None else seen.losses[radius]
    _fill_shape(draw, seen.polygon, scale, _INK if radius is None else _FAINT)
    for loss in lost:
        _fill_shape(draw, MultiPolygon([loss.shape]), scale, _RED)
    for loss in lost:
        _mark_loss(draw, loss, scale)
    draw.rectangle((0, 0, size[0] - 1, size[1] - 1), outline=_FRAME, width=_FINER)
    picture = picture.resize((size[0] // _FINER, size[1] // _FINER), Image.Resampling.BOX)
    return Panel(_caption(seen, radius, lost), picture)


def _caption(seen: ViewSurvey, radius: float | None, lost: list[Loss]) -> str:
    if radius is None:
        wide, high = seen.view.frame_mm
        name = seen.target.shown[:20]
        parts = f"{with_noun(seen.pieces, 'piece')}, {with_noun(seen.holes, 'hole')}"
        return f"{name}, {wide:.0f} x {high:.0f} mm, {parts}"
    which = "a build's tube" if radius == next(iter(seen.losses)) else "a tube"
    if not lost:
        spill = seen.spills.get(radius, 0.0)
        beside = f", {spill:.0%} is spilled" if spill >= SPILL else ""
        return f"{which}, {2 * radius:.1f} mm thick: nothing is lost{beside}"
    longest = max(loss.extent for loss in lost) * seen.wall_mm_per_px
    return f"{which}, {2 * radius:.1f} mm thick: {with_noun(len(lost), 'loss')}, up to {longest:.0f} mm"


def _fill_shape(
    draw: ImageDraw.ImageDraw, shape: MultiPolygon, scale: float, colour: object
) -> None:
    """Fill polygons, larger ones first, so that what lies in a hole is painted after it."""
    for piece in sorted(shape.geoms, key=lambda p: -Polygon(p.exterior).area):
        draw.polygon(_to_sheet(piece.exterior.coords, scale), fill=colour)  # type: ignore[arg-type]
        for hole in piece.interiors:
            draw.polygon(_to_sheet(hole.coords, scale), fill=_PAPER)


def _to_sheet(points: object, scale: float) -> list[tuple[float, float]]:
    moved: Array = (np.asarray(points, dtype=np.float64) + 0.5) * scale - 0.5
    return [(float(x), float(y)) for x, y in moved]


def _mark_loss(draw: ImageDraw.ImageDraw, loss: Loss, scale: float) -> None:
    reach = 0.5 * loss.extent * scale
    if reach < _SEEN * _FINER:
        (x, y), r = _to_sheet([loss.at], scale)[0], _SEEN * _FINER
        draw.ellipse((x - r, y - r, x + r, y + r), outline=_RED, width=2 * _FINER)
