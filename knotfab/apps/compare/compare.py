"""A photograph of the shadow on the wall against the picture that a build was made for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from knotfab.apps.compare.rectify import (
    LampFit,
    find_lamp,
    find_marks,
    find_plate,
    find_shadow,
    homography,
    read_corners,
    rectify,
    through,
)
from knotfab.base.arrays import Array, Mask
from knotfab.base.disk import write_whole
from knotfab.knots import Knot, Knots, read_knots
from knotfab.picture.raster import decode, encode_image
from knotfab.picture.read import read_bytes, read_target
from knotfab.picture.silhouette import mask_iou, sample_mask
from knotfab.report.drill_template import CARD_MM, card_middles
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.load import load_scene
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedView, Scene

_LONGER_PX = 640  # longer side of the pictures that are compared
_MARGIN = 0.15  # a share of the frame on each side, so that spill counts
# a share of the plate's margin: its edge may be rounded, and is found to a px or two
_PLATE_SHARE = 0.7
_LARGEST_PX = 12000
_GAIN = 0.004  # a gain of IoU below which the lamp may stay
_LEAST_MM = (2.0, 2.0, 8.0)  # moves by which a lamp is worth moving: right, up, away
# IoU after the fit below which it is the shadow of something else. The piece's own, with corners off by up to
# 2 mm, have 0.68 to 1.00; others up to 0.38, but up to 0.78 where both shadows are much like a disc
_ALIKE = 0.6
_ROUGH = 3  # factor of fewer px and vertices where only an order of the corners is looked for
_SURE = 0.9  # IoU after the fit from which on no other order of the corners is looked for
_PAPER, _BOTH, _MISSING, _SPILL = (250, 248, 244), (150, 146, 140), (33, 102, 172), (200, 60, 20)


@dataclass(frozen=True)
class Comparison:
    """`iou` of the photographed shadow and the picture; shares of the picture's area that are missing, and
    dark beside it; the lamp, where knots.json is there to tell; the differences as a PNG.

    `corners`: those of the frame, `x,y` px; `instead`: their orders in which the shadow is far more like the
    piece's than in this one, the best first.
    """

    iou: float
    missing: float
    spilled: float
    lamp: LampFit | None
    png: bytes
    corners: tuple[str, ...] = ()
    instead: tuple[tuple[str, ...], ...] = ()

    @property
    def alike(self) -> bool | None:
        """True if the piece throws such a shadow, wherever its lamp stands; None: no knots are there."""
        if self.instead:
            return False
        return None if self.lamp is None else _best_iou(self.iou, self.lamp) >= _ALIKE

    def to_dict(self) -> dict[str, Any]:
        lamp = None
        if self.lamp is not None and self.alike:
            lamp = {k: round(v, 4) for k, v in self.lamp.__dict__.items()}
        figures = {"iou": self.iou, "missing": self.missing, "spilled": self.spilled}
        return {
            **{k: round(v, 4) for k, v in figures.items()},
            "lamp": lamp,
            "advice": advise(self),
            "alike": self.alike,
            "corners": list(self.corners),
            "corners_instead": [list(order) for order in self.instead],
        }


def compare_photo(
    photo: Path,
    folder: Path,
    corners: Sequence[str] | None = None,
    view_name: str | None = None,
) -> Comparison:
    """Compare a photograph of the shadow with the picture of a folder that a build wrote.

    Args:
        corners: corners of the frame in the photograph, `x,y` px each, clockwise from the top left; None: the
            four marks of setup.pdf are looked for, and then the plate that the piece is mounted on.
        view_name: the first view by default.

    Raises:
        InputError: a file cannot be read, the frame is not found, or nothing in it is in shadow.
    """
    scene, view, _, (camera, wanted, pad), knots = open_view(folder, view_name)
    image = read_photo(photo)
    width, height = camera.width - 2 * pad[0], camera.height - 2 * pad[1]
    grey = image @ (0.299, 0.587, 0.114)
    marks = None
    if corners is not None:
        at = read_corners(corners, image.shape[1], image.shape[0])
    elif (marks := find_marks(grey)) is not None:
        cards = card_middles(view.frame_mm, _plate_margin(scene))
        at = through(homography(cards, marks), _corners_of(view))
    else:
        at = _corners_of_plate(image, scene, view, str(photo))

    def look(at: Array) -> tuple[Mask, float]:
        """Return the shadow in the frame of these corners, and its IoU with the picture."""
        seen = rectify(grey, at, (width, height), pad)
        if marks is not None:
            cards = through(homography(at, _corners_of(view)), marks)
            _leave_out(seen, cards * width / view.frame_width_mm + pad, width / view.frame_width_mm)
        shadow = find_shadow(seen, str(photo))
        return shadow, mask_iou(wanted, shadow)

    def look_roughly(at: Array) -> float:
        """Return the best IoU in the frame of these corners, in little time."""
        shadow, iou = look(at)
        if knots is None or iou >= _SURE:
            return iou
        return _best_iou(iou, find_lamp(*_coarsen(knots, camera, shadow)))

    shadow, iou = look(at)
    lamp = None if knots is None else find_lamp(knots, camera, shadow)
    area = max(1, int(wanted.sum()))
    return Comparison(
        iou,
        float((wanted & ~shadow).sum() / area),
        float((shadow & ~wanted).sum() / area),
        lamp,
        _draw(wanted, shadow),
        _tell(at),
        _find_orders(at, _best_iou(iou, lamp), look_roughly),
    )


def open_view(
    folder: Path, name: str | None
) -> tuple[Scene, ResolvedView, str, tuple[Camera, Mask, tuple[int, int]], Knots | None]:
    """Read the files of a view that a build wrote: scene, view, the files' suffix, picture and knots.

    The picture is that of a camera with a margin about the frame, of so many px to a side, as a photograph
    is looked at.

    Raises:
        InputError: there is no such view, a file cannot be read, or the wall is round.
    """
    scene, view, suffix = _read_view(folder, name)
    if view.wall_radius_mm is not None:
        raise InputError(
            f"view {view.name}",
            "its wall is round, and a photograph is straightened as one of a flat wall",
            "Compare a view whose wall is flat (--view NAME)",
        )
    if view.tone == "lines":
        target = read_target(view.lines_picture, base=folder)
    else:
        target = read_target(view.picture, view, base=folder)
    longer = max(target.width, target.height)
    width, height = (max(1, round(s * _LONGER_PX / longer)) for s in (target.width, target.height))
    pad = _margin_px(scene, view, width)
    asked = sample_mask(target.asked, width, height)
    wanted = np.pad(asked, ((pad[1], pad[1]), (pad[0], pad[0])))
    camera = camera_of(view, width, height).padded(*pad)
    knots = _read_knots(folder / f"knots{suffix}.json", scene)
    return scene, view, suffix, (camera, wanted, pad), knots


def _best_iou(iou: float, lamp: LampFit | None) -> float:
    """Return the IoU of shadow and picture, or of what the knots throw at best."""
    return iou if lamp is None else max(lamp.iou, lamp.iou_in_place)


def _coarsen(knots: Knots, camera: Camera, shadow: Mask) -> tuple[Knots, Camera, Mask]:
    """Thin out the vertices and pixels that `find_lamp` asks for."""
    small = camera.resized(camera.width // _ROUGH, camera.height // _ROUGH)
    seen = sample_mask(shadow, small.width, small.height)
    fewer = tuple(Knot(knot.points[::_ROUGH]) for knot in knots.knots)
    return Knots(fewer, knots.radius_mm), small, seen


def _find_orders(
    at: Array, found: float, look: Callable[[Array], float]
) -> tuple[tuple[str, ...], ...]:
    """Find the corners begun at another of the four, if clearly better; several of a symmetric shadow.

    Args:
        at: (4, 2) px. found: the best IoU in the order that was given. look: the best IoU in another order.
    """
    if found >= _SURE:
        return ()
    tried: list[tuple[float, Array]] = []
    for begun in (1, 2, 3):
        turned = np.roll(at, -begun, axis=0)
        try:
            tried.append((look(turned), turned))
        except InputError:  # no shadow stands out in that frame, whose margin is another
            continue
    tried = sorted(tried, key=lambda one: -one[0])
    # an order of the corners with so much more IoU is the right one
    if not tried or tried[0][0] < max(_ALIKE, found + 0.1):
        return ()
    # IoU by which orders differ that are both named
    return tuple(_tell(turned) for iou, turned in tried if iou > tried[0][0] - 0.02)


def _tell(at: Array) -> tuple[str, ...]:
    """Return corners as `--corners` takes them."""
    return tuple(f"{x:.0f},{y:.0f}" for x, y in at)


def advise(found: Comparison) -> str:
    """Say which way to move the lamp, or that the photograph shows another shadow."""
    lamp = found.lamp
    if found.instead:
        orders = " or ".join(f"--corners {' '.join(order)}" for order in found.instead)
        return (
            "This does not look like that piece's shadow, but it does with the same corners of the frame in "
            f"another order: {orders}"
        )
    if lamp is None:
        return ""
    if not found.alike:
        best = _best_iou(found.iou, lamp)
        return (
            "This does not look like that piece's shadow: wherever the lamp was taken to be, their IoU was "
            f"at most {best:.2f}. Check the folder, --view, and that these are the frame's corners, the top "
            f"left one first: --corners {' '.join(found.corners)}. If they are, the lamp is too far off to "
            "be found: put it where setup.pdf has it."
        )
    moves = (lamp.right_mm, lamp.up_mm, lamp.away_mm)
    words = (("left", "right"), ("down", "up"), ("nearer to the wall", "away from the wall"))
    said = [
        f"{abs(by):.0f} mm {word[0] if by > 0 else word[1]}"
        for by, word, least in zip(moves, words, _LEAST_MM, strict=True)
        if abs(by) >= least
    ]
    if not said or lamp.iou - lamp.iou_in_place < _GAIN:
        return "The lamp stands where it should."
    return f"Move the lamp {', '.join(said)}."


def write_comparison(found: Comparison, out: Path) -> None:
    """Write where they differ.

    Raises:
        InputError: it is no PNG, or cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "differences are drawn as PNG", "Name a file in .png.")
    write_whole(out, found.png)


def _read_view(folder: Path, name: str | None) -> tuple[Scene, ResolvedView, str]:
    """Read the scene, its view of that name, or the first, and the suffix of its files: a frame's own."""
    if not folder.is_dir():
        raise InputError(str(folder), "it is no folder", "Name a folder that a build wrote.")
    suffix = ""
    if own := sorted(path.stem.removeprefix("scene") for path in folder.glob("scene-*.toml")):
        frames = [f"frame{one}" for one in own]
        if name not in frames:
            why = "it is a sequence" if name is None else "the sequence has no such frame"
            what = str(folder) if name is None else f"--view {name}"
            remedy = f"Say which frame the photograph shows: --view {frames[0]} to {frames[-1]}."
            raise InputError(what, why, remedy)
        suffix = name.removeprefix("frame")
    path = folder / f"scene{suffix}.toml"
    scene = load_scene(path)
    views = [v for v in scene.views if name in (None, v.name)]
    if not views:
        known = ", ".join(v.name for v in scene.views)
        raise InputError(f"--view {name}", "the scene has no such view", f"It has: {known}.")
    if views[0].frame_width_mm is None or views[0].frame_height_mm is None:
        raise InputError(str(path), "no build has written it", "Name a folder that a build wrote.")
    return scene, ResolvedView.model_validate(views[0].model_dump()), suffix


def _margin_px(scene: Scene, view: ResolvedView, width: int) -> tuple[int, int]:
    """Return how far about the frame one looks: no further than a plate, which is unlike the wall."""
    margin = _MARGIN * view.longer_mm
    if _has_plate(scene):
        margin = min(margin, _PLATE_SHARE * scene.mount.plate_margin_mm)
    px = max(1, round(margin * width / view.frame_width_mm))
    return px, px


def _has_plate(scene: Scene) -> bool:
    return scene.mount.kind == "wall" and scene.mount.foot != "dowel"


def _plate_margin(scene: Scene) -> float:
    return scene.mount.plate_margin_mm if _has_plate(scene) else 0.0


def read_photo(path: Path) -> Array:
    """Read (H, W, 3), 0 to 1, upright.

    Raises:
        InputError: there is no such file, or it is no photograph that can be read (`read_bytes`, `decode`).
    """
    data = read_bytes(path, str(path), _LARGEST_PX, "Check the path.")
    image, _ = decode(data, str(path), largest=_LARGEST_PX)
    return np.asarray(image.convert("RGB"), dtype=np.float64) / 255.0


def _corners_of(view: ResolvedView) -> Array:
    """Return (4, 2) the frame's corners, mm right and down from the first, clockwise."""
    w, h = view.frame_mm
    return np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]])


def _corners_of_plate(image: Array, scene: Scene, view: ResolvedView, what: str) -> Array:
    """Return the frame's corners in the photograph, a margin inside those of the plate."""
    remedy = (
        "Put the four marks of setup.pdf about it, or point at the frame's corners (--click), or name them: "
        "--corners x,y x,y x,y x,y."
    )
    if not _has_plate(scene):
        why = "it does not show the four marks, and this piece has no plate to find its frame by"
        raise InputError(what, why, remedy)
    plate = find_plate(image)
    if plate is None:
        why = "it shows neither the four marks nor the plate's outline clearly enough"
        raise InputError(what, why, remedy)
    frame, m = _corners_of(view), scene.mount.plate_margin_mm
    return through(homography(frame + m * np.sign(frame - frame.mean(axis=0)), plate), frame)


def _leave_out(seen: Array, middles: Array, scale: float) -> None:
    """Make NaN what cards cover: squares about middles (4, 2) px, `scale` px to a mm."""
    v, u = np.mgrid[: seen.shape[0], : seen.shape[1]]
    half = (CARD_MM / 2 + 1.0) * scale
    for x, y in middles:
        seen[(np.abs(u - x) <= half) & (np.abs(v - y) <= half)] = np.nan


def _read_knots(path: Path, scene: Scene) -> Knots | None:
    """Read the knots in the scene; None where there are none, or no pose that leads there.

    Raises:
        InputError: the file is damaged.
    """
    if scene.pose is None or not path.is_file():
        return None
    try:
        found = read_knots(path).moved(np.array(scene.pose.matrix))
        if not np.isfinite(found.points).all():
            raise ValueError("a number in it is not finite")
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(
            str(path), "it is damaged", "Remove it, or name another folder that a build wrote."
        ) from error
    return found


def _draw(wanted: Mask, shadow: Mask) -> bytes:
    """Draw grey: both; blue: the picture alone; red: the shadow alone."""
    sheet = np.full((*wanted.shape, 3), _PAPER, dtype=np.uint8)
    sheet[wanted & shadow] = _BOTH
    sheet[wanted & ~shadow] = _MISSING
    sheet[shadow & ~wanted] = _SPILL
    return encode_image(Image.fromarray(sheet))
