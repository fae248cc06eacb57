"""The pictures that a report shows, found in its folder."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from knotfab.base.arrays import Array, Mask
from knotfab.design.hull import HullBound
from knotfab.design.survey import Survey, ViewSurvey
from knotfab.hold.mount import Mounted
from knotfab.picture.raster import encode_image
from knotfab.picture.read import Target
from knotfab.picture.silhouette import fit_size
from knotfab.render.pages import length
from knotfab.render.part_picture import look_from, turn_upright
from knotfab.report.page import Picture
from knotfab.scene.camera import view_axes
from knotfab_formats.print_figures import Turning
from knotfab_formats.scene import ResolvedView, SettledScene
from knotfab_formats.verdict import View
from knotfab_validators.shadows.told import DOOR

_COLOURS = "compare-colours.png"
# files, their role on the page, and a caption, in which {} is the view
_SHOWN = (
    ("failures*.png", "part", "where {} fails its checks"),
    (
        _COLOURS,
        "colours",
        "the picture, the colours that the lamps can mix of it, what is seen, and where it is wrong",
    ),
    ("shadow-*.png", "alone", ""),
    ("given-*.*", "given", "{0} as it came; its silhouette is picture-{0}.png"),
    ("compare-*.png", "compare", "target, shadow of the written file, and where they differ"),
    (
        "bent-*.png",
        "bent",
        "the picture as it came, as it is bent, and what all pictures leave of it",
    ),
    ("soft-*.png", "shadow", "the shadow as a lamp of this size throws it"),
    ("piece.png", "piece", "the piece with its shadow, its lamp on"),
    (
        "unlit.png",
        "unlit",
        "unlit: from the door, 45° aside at its height, and from where it tells most",
    ),
    ("part.png", "part", "from the light of each view, then turned about the vertical"),
)


def find_pictures(folder: Path) -> list[Picture]:
    """Find the report's pictures in a folder, and caption them."""
    found, coloured = [], (folder / _COLOURS).is_file()
    for pattern, role, caption in _SHOWN:
        for path in sorted(folder.glob(pattern)) if role != "alone" or coloured else ():
            view = path.stem.partition("-")[2]
            if pattern.startswith("failures"):
                view = f"part-{view}" if view else "the part"
            if role != "compare" or path.name != _COLOURS:
                found.append(Picture(path, role, caption.format(view), view))
    return found


def place_strangers(views: Sequence[ResolvedView], found: Sequence[View]) -> Array:
    """Return eyes (2, 3), mm: in the door, and where the unlit piece tells most; none if nothing is told."""
    told = [(one.told.worst, own) for one, own in zip(found, views, strict=False) if one.told]
    if not told:
        return np.empty((0, 3))
    worst, view = max(told, key=lambda one: one[0].share)
    most = worst.azimuth, worst.elevation
    door = next(side for side in DOOR if side != most)
    return np.array([look_from(view, *door), look_from(view, *most)])


# A piece of several views that turns under one fixed lamp: at which angles it shows its pictures.

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


def tell_turns(mounted: Mounted) -> tuple[Turning | None, list[str]]:
    """Say at which angles a piece on a stand or thread shows its pictures, and how far aside."""
    angles = turns_of(mounted.scene)
    if not angles or (mounted.stand is None and mounted.hang is None):
        return None, []
    axis = np.zeros(3) if mounted.hang is None else mounted.hang.threads.mean(axis=0)
    view = mounted.scene.views[0]
    aside = {}
    for name, angle in angles.items():
        moved = (axis - turn_upright(axis, angle)) @ view_axes(view)[0]
        aside[name] = float(moved) * view.magnification
    words = [f"{name} at {angle:.0f}°{_tell_aside(aside[name])}" for name, angle in angles.items()]
    about = (
        "its thread" if mounted.stand is None else "the vertical through the middle of the scene"
    )
    note = f"Turned about {about} under the first lamp alone, it shows {', '.join(words)}."
    return Turning(angles, aside), [note]


def _tell_aside(aside_mm: float) -> str:
    if abs(aside_mm) < _LEAST_MM:
        return ""
    return f" ({length(abs(aside_mm))} mm to the {'right' if aside_mm > 0 else 'left'})"


# A survey as one picture: each silhouette, and in red what the tube loses of it.

_SIDE = 720  # px of a panel's longer side
_GAP = 12  # px between panels
_PAPER, _INK, _FRAME, _RED = (250, 248, 244), (60, 58, 56), (214, 208, 198), (212, 30, 30)
_RING = 18.0  # px of a panel: a smaller loss gets a ring about it


class Panel(NamedTuple):
    """A picture on a preview's sheet, and the words for it."""

    caption: str
    image: Image.Image


def draw_survey(found: Survey) -> bytes:
    """Draw a PNG with a row for each picture: its silhouette, with what the tube loses in red."""
    return _lay_out(_draw_rows(found))


def draw_agreement(target: Target, bound: HullBound) -> bytes:
    """Draw a PNG of a picture as it came, as it was bent, and what all views leave of it."""
    return _lay_out([_agreement(target, bound)])


def draw_panels(found: Survey) -> list[Panel]:
    """Draw the panels of all pictures in their order."""
    return [panel for row in _draw_rows(found) for panel in row]


def _lay_out(rows: Sequence[Sequence[Panel]]) -> bytes:
    """Lay rows of panels on one sheet; return it as PNG."""
    heights = [_GAP + max(panel.image.height for panel in row) for row in rows]
    width = _GAP + max(sum(_GAP + panel.image.width for panel in row) for row in rows)
    sheet, top = Image.new("RGB", (width, _GAP + sum(heights)), _PAPER), _GAP
    for row, height in zip(rows, heights, strict=True):
        left = _GAP
        for panel in row:
            sheet.paste(panel.image, (left, top))
            left += panel.image.width + _GAP
        top += height
    return encode_image(sheet, compress_level=6)


def _draw_rows(found: Survey) -> list[list[Panel]]:
    rows = []
    if (parted := found.parted) is not None:
        came, seen = (Image.open(io.BytesIO(png)) for png in (parted.png, parted.seen_png()))
        rows.append([_framed("as it came", came), _framed("the colours that will be seen", seen)])
    for n, one in enumerate(found.views):
        drawn = _mask_panel(one.target.shown[:30], one.target.mask, _mark_losses(one))
        before = _agreement(one.target, found.bounds[n]) if found.bounds else []
        rows.append([*before, drawn])
    return rows


def _agreement(target: Target, bound: HullBound) -> list[Panel]:
    panels = [_mask_panel("as it came", target.asked)]
    if target.bending is not None:
        panels.append(_mask_panel("as it is bent", target.mask))
    lost = bound.wanted & ~bound.covered
    return [*panels, _mask_panel("what all pictures leave of it", bound.covered, lost)]


def _mask_panel(caption: str, mask: Mask, lost: Mask | None = None) -> Panel:
    """Draw a mask in ink, and what is `lost` in red."""
    colours = np.where(mask[..., None], _INK, _PAPER)
    if lost is not None:
        colours = np.where(lost[..., None], _RED, colours)
    return _framed(caption, Image.fromarray(colours.astype(np.uint8)))


def _framed(caption: str, picture: Image.Image) -> Panel:
    picture = picture.convert("RGB")
    picture = picture.resize(fit_size(*picture.size, _SIDE), Image.Resampling.BOX)
    ends = (0, 0, picture.width - 1, picture.height - 1)
    ImageDraw.Draw(picture).rectangle(ends, outline=_FRAME)
    return Panel(caption, picture)


def _mark_losses(seen: ViewSurvey) -> Mask:
    """Mark the pixels of a picture that the tube loses, with rings about those that are hard to see."""
    width, height = seen.target.width, seen.target.height
    marked, px = Image.new("1", (width, height)), max(width, height) / _SIDE
    draw = ImageDraw.Draw(marked)
    for loss in seen.losses or ():  # the largest first
        draw.polygon(list(loss.shape.exterior.coords), fill=1)
        for hole in loss.shape.interiors:
            draw.polygon(list(hole.coords), fill=0)
        if 0.5 * loss.extent < _RING * px:
            draw.circle(loss.at, _RING * px, outline=1, width=max(1, round(3 * px)))
    return np.asarray(marked)
