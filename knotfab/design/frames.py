"""Frame the pictures of a scene: spread their views, match their heights, widen their thin strokes.

Two level views see the same heights of a part. So pictures whose frames have no given size are scaled and
shifted until all silhouettes have the same top and bottom.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotfab.design.candidates import line_width
from knotfab.picture.opening import is_thin, thicken
from knotfab.picture.read import Change, Target
from knotfab.picture.silhouette import count_dust, drop_specks
from knotfab.picture.source import name_picture
from knotfab.scene.camera import find_aligned
from knotfab_formats.bounds import why_out_of_bounds
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene, ResolvedView
from knotfab_formats.views import View

LONGER_FRAME_MM = 180.0  # default length of a picture's longer side on the wall
# strokes below this many widths of the tube's shadow are drawn along their centre lines
_SLIM = 1.25
_WIDEST = 0.25  # widest stroke, as a share of the picture's narrower side
_ROOM = 1.1  # width of a filled stroke over that of the thinnest tube's shadow
# reasons why only a single picture is drawn along its lines
_ASIDE = (
    "it is for one picture: strands that run there and back along a line hide behind each other from one "
    "light alone, and stand side by side in every other"
)
_MEETING = (
    "it is for one picture: a sequence is one knot that moves from frame to frame, and where strokes meet "
    "or part on the way strands would have to be cut and joined anew"
)


def spread_views(scene: ResolvedScene, pictures: Sequence[str]) -> ResolvedScene:
    """Make a view for each picture, named after it, at azimuths 180 / count degrees apart.

    They share half a turn, since from behind a silhouette is only mirrored.
    """
    first, names = scene.views[0], name_views(pictures)
    turn = 180.0 / len(names)
    views = tuple(
        first.but(name=name, picture="", azimuth_deg=first.azimuth_deg + turn * n)
        for n, name in enumerate(names)
    )
    return scene.but(views=views)


_DIRECTIONS = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "side": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (270.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
}


def direct_views(scene: ResolvedScene, directions: str) -> ResolvedScene:
    """Place the views' lights at these directions, a word or AZIMUTH:ELEVATION each.

    Raises:
        InputError: one cannot be read, there are not as many as views, or two are along one line.
    """
    option, words = f"--directions {directions}", directions.replace(" ", "").split(",")
    if len(words) != len(scene.views):
        raise InputError(
            option,
            f"it has {len(words)}, and there are {len(scene.views)} pictures",
            "Give one for each, in their order, such as front,side",
        )
    views = []
    for view, word in zip(scene.views, words, strict=True):
        try:
            azimuth, elevation = _DIRECTIONS.get(word.lower()) or map(float, word.split(":"))
            if not (abs(azimuth) <= 360 and abs(elevation) <= 90):
                raise ValueError
            views.append(view.but(azimuth_deg=azimuth, elevation_deg=elevation))
        except ValueError:
            raise InputError(
                option,
                f"{word!r} is no direction",
                f"Write {', '.join(_DIRECTIONS)}, or AZIMUTH:ELEVATION in degrees, from -90 to 90 above the "
                "horizontal, such as 30:45",
            ) from None
    if (pair := find_aligned(views)) is not None:
        other, word = (words[n] for n in pair)
        raise InputError(
            option,
            f"{other} and {word} look along one line, where a part has one silhouette and its mirror image",
            "Give directions that are neither equal nor opposite",
        )
    return scene.but(views=tuple(views))


def name_views(pictures: Sequence[str]) -> list[str]:
    """Name a view after each picture, with a number where names would be equal."""
    names = list[str]()
    for picture in pictures:
        plain, number = name_picture(picture), 1
        name = plain
        while name.casefold() in map(str.casefold, names):  # some file systems ignore case
            number += 1
            name = f"{plain}-{number}"
        names.append(name)
    return names


@dataclass(frozen=True)
class _Extent:
    """A silhouette's bounding box, in units of the picture's longer side.

    `up` is the height of its centre above the frame's.
    """

    width: float
    height: float
    up: float


def _extent(mask: NDArray[np.bool_]) -> _Extent:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    side = max(mask.shape)
    return _Extent(
        (columns[-1] + 1 - columns[0]) / side,
        (rows[-1] + 1 - rows[0]) / side,
        (0.5 * (mask.shape[0] - 1) - 0.5 * (rows[0] + rows[-1])) / side,
    )


def framed_alike(scene: ResolvedScene, targets: Sequence[Target]) -> ResolvedScene:
    """Size and shift the frames so that the silhouettes of all level views have the same top and bottom.

    No frame's side exceeds `LONGER_FRAME_MM`. A raised view gets the width of the first level silhouette.
    The scene is returned unchanged if a view's frame has a given size, or if the views share a wall.
    """
    if scene.share_wall:
        return scene
    extents = [_extent(t.mask) for t in targets]
    free = [v.frame_width_mm is None and v.frame_height_mm is None for v in scene.views]
    # views raised by less than a degree count as level
    level = [n for n, v in enumerate(scene.views) if abs(v.elevation_deg) < 1.0]
    if not all(free) or len(level) < 1:
        return scene
    # the longer side of each frame over the common height of the silhouettes
    longer = [1.0 / e.height for e in extents]
    first = level[0]
    for n in range(len(extents)):
        if n not in level:
            longer[n] = extents[first].width / extents[first].height / extents[n].width
    height = min(LONGER_FRAME_MM / side for side in longer)
    views = []
    for view, extent, target, side in zip(scene.views, extents, targets, longer, strict=True):
        millimetres = round(height * side, 4)
        views.append(_resize_frame(view, target, millimetres, -extent.up * millimetres))
    return scene.but(views=tuple(views))


def size_frames(scene: ResolvedScene, targets: Sequence[Target]) -> ResolvedScene:
    """Set the first of several equally sized frames to that size, and fit the others to it.

    They are sized so that the silhouettes have the same height.
    """
    first = scene.views[0]
    width, height = first.frame_width_mm, first.frame_height_mm
    if len(scene.views) < 2 or (width is None and height is None):
        return scene
    if any((v.frame_width_mm, v.frame_height_mm) != (width, height) for v in scene.views):
        return scene
    none = {"frame_width_mm": None, "frame_height_mm": None}
    bare = scene.but(views=tuple(v.but(**none) for v in scene.views))
    alike = framed_alike(bare, targets).views
    own = frame_view(first, targets[0])
    scale = own.frame_width_mm / frame_view(alike[0], targets[0]).frame_width_mm
    keys = ("frame_width_mm", "frame_height_mm", "frame_up_mm")
    views = tuple(v.but(**{key: scale * (getattr(v, key) or 0.0) for key in keys}) for v in alike)
    return scene.but(views=views)


def size_longer(scene: ResolvedScene, target: Target, longer_mm: float) -> ResolvedScene:
    """Size every frame by one length: its width if `target` is wider than high, or else its height."""
    key = "frame_width_mm" if target.width >= target.height else "frame_height_mm"
    sides = {"frame_width_mm": None, "frame_height_mm": None, key: longer_mm}
    return scene.but(views=tuple(view.but(**sides) for view in scene.views))


def widen_targets(
    scene: ResolvedScene, targets: Sequence[Target], sequence: bool = False
) -> tuple[ResolvedScene, tuple[Target, ...]]:
    """Widen thin strokes as the scene asks (`thicken_mm`, on the receiver), and settle `lines`.

    A single picture is drawn along its centre lines if most of it is thinner than the tube; its strokes are
    then as wide as the tube's shadow.

    Args:
        targets: one a view, or the frames of a sequence.

    Returns:
        The scene with widths as numbers and `lines` settled, and the targets with their widened strokes.

    Raises:
        InputError: several pictures were asked to be drawn along their lines.
    """
    if not sequence and len(targets) > 1:  # widened strokes must not change the frames
        framed = framed_alike(scene, targets)
    else:
        framed = scene
    one = len(targets) == 1 and not sequence
    asked, radius = scene.piece.tube_radius_mm, scene.thinnest_mm
    if not sequence and not scene.share_wall:  # masks on one wall must register
        targets = [
            _without_dust(v, t, scene.printer.min_tube_radius_mm)
            for v, t in zip(framed.views, targets, strict=True)
        ]
    views = []
    if not one and any(view.lines for view in scene.views):
        raise InputError(
            "--lines on", _MEETING if sequence else _ASIDE, "Leave it out, or build one picture"
        )
    for view, target in zip(framed.views, targets, strict=False):
        width = view.thicken_mm
        lines = view.lines
        if lines is None:
            lines = one and width == 0 and _is_thin(view, target, radius)
        if lines and not width:
            width = line_width(view, radius)
        elif lines and asked is not None and width:
            alike = line_width(view, asked)
            if abs(width - alike) > 0.01:
                raise InputError(
                    f"--thicken {width:g} with --tube-radius {asked:g}",
                    f"one tube along each line draws it {alike:g} mm wide",
                    "Give one of the two",
                )
        elif width is None:
            width = round(_ROOM * line_width(view, scene.printer.min_tube_radius_mm), 3)
        views.append(view.but(thicken_mm=width, lines=lines))
    if all(view.thicken_mm == 0 for view in views):
        settled = tuple(
            old.but(lines=new.lines) for old, new in zip(scene.views, views, strict=True)
        )
        return scene.but(views=settled), tuple(targets)
    each = views * len(targets) if sequence else views
    widened = tuple(widen(v, t) for v, t in zip(each, targets, strict=True))
    return framed.but(views=tuple(views)), widened


def _without_dust(view: View, target: Target, thinnest: float) -> Target:
    """Drop specks that no tube can draw, unless the view says how its picture is cleaned."""
    if view.speck_px or view.keep_largest or view.smooth_px or target.is_text or target.settled:
        return target
    least = (2.0 * thinnest * frame_view(view, target).px_per_mm(target.width)) ** 2
    count = count_dust(target.mask, least)
    if not count:
        return target
    speck_px = math.ceil(least * target.shrunk**2)
    note = (
        f"{count} specks that are smaller than any tube draws are left out (--specks {speck_px}; "
        "--specks 1 keeps them)"
    )
    mask = drop_specks(target.mask, round(speck_px / target.shrunk**2))
    return replace(target, mask=mask, notes=(*target.notes, note))


def _is_thin(view: View, target: Target, radius: float) -> bool:
    """Return whether most of a picture is too thin for two adjacent strands of this radius, mm."""
    px = frame_view(view, target).px_per_mm(target.width)
    return is_thin(target.mask, _SLIM * 2.0 * radius * px)


def widen(view: View, target: Target) -> Target:
    """Widen the target's thin strokes to the view's `thicken_mm`, if that is set.

    Raises:
        InputError: that is more than a quarter of the picture's narrower side.
    """
    if not view.thicken_mm:
        return target
    width = view.thicken_mm * target.width / frame_view(view, target).frame_width_mm
    if width > _WIDEST * min(target.width, target.height):
        narrow, wide = sorted(frame_view(view, target).frame_mm)
        size = math.ceil(wide * view.thicken_mm / (_WIDEST * narrow))
        lines = view.lines
        raise InputError(
            f"picture {target.shown}",
            f"strokes {view.thicken_mm:g} mm wide{', as a tube draws them,' if lines else ''} leave nothing "
            f"of a picture of {narrow:.3g} mm",
            f"Make the picture larger, from --size {size}"
            + ("" if lines else ", or leave out --thicken"),
        )
    mask = thicken(target.mask, width)
    rule = target.rule
    if view.lines:
        rule += "; drawn along its centre lines by one tube each"
    if (mask != target.mask).any():
        rule += (
            f"; strokes widened to {view.thicken_mm:g} mm, {width * target.shrunk:.1f} px, by which it "
            "is judged"
        )
    judged = mask if target.change is None else thicken(target.asked, width)
    return replace(target, mask=mask, change=Change(target.asked, judged), rule=rule)


def _resize_frame(view: View, target: Target, longer_mm: float, up_mm: float) -> View:
    pixel = longer_mm / max(target.width, target.height)
    return view.but(
        frame_width_mm=pixel * target.width,
        frame_height_mm=pixel * target.height,
        frame_up_mm=round(up_mm, 4) + 0.0,
    )


def frame_view(view: View, target: Target) -> ResolvedView:
    """Resolve a view: sides of its frame that are not given follow from the picture's aspect ratio.

    Raises:
        InputError: a side would be out of its bounds.
    """
    across, up = view.frame_width_mm, view.frame_height_mm
    if across is not None:
        scale = across / target.width
    elif up is not None:
        scale = up / target.height
    else:
        scale = LONGER_FRAME_MM / max(target.width, target.height)
    own = {
        "picture": f"picture-{view.name}.png",
        "title": target.shown,
        "frame_width_mm": target.width * scale if across is None else across,
        "frame_height_mm": target.height * scale if up is None else up,
    }
    for key in ("frame_width_mm", "frame_height_mm"):
        bounds = why_out_of_bounds(View, key, own[key])
        if bounds is not None:
            raise InputError(
                f"view {view.name}",
                f"with its picture's shape its {key} would be {own[key]:g}, and it is {bounds}",
                "Give another size (--size).",
            )
    return ResolvedView(**view.but(**own).model_dump())
