"""Compare a photograph of the shadow on the wall with the picture that the piece was built for."""

from __future__ import annotations

import json
import shlex
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
    find_shadow,
    homography,
    map_points,
    read_corners,
    rectify,
)
from knotfab.base.arrays import Array, Mask
from knotfab.base.disk import write_whole
from knotfab.base.limited import run_limited
from knotfab.knots import Knot, Knots, read_knots
from knotfab.picture.raster import decode, encode_image, image_uri
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import mask_iou, sample_mask
from knotfab.picture.source import SECONDS, read_bytes
from knotfab.report.drill_template import CARD_MM, card_middles
from knotfab.report.page import make_environment
from knotfab.report.summary import tell_share
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.load import load_scene, pick_view
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedView, Scene

_LONGER_PX = 640  # longer side of the compared pictures
_MARGIN = 0.15  # margin on each side, as a share of the frame, so that spill counts
# share of the plate's margin that is looked at: its edge may be rounded, and is found only to a px or two
_PLATE_SHARE = 0.7
_LARGEST_PX = 12000
_GAIN = 0.004  # gain of IoU below which the lamp may stay
_LEAST_MM = (2.0, 2.0, 8.0)  # smallest moves worth making: right, up, away
# IoU after the fit below which it is the shadow of something else. A piece's own shadow, with corners off by
# up to 2 mm, reaches 0.68 to 1.00. Others reach 0.38 at most, or 0.78 if both shadows are much like a disc
_ALIKE = 0.6
_PAGE_PX = 2000  # longer side of the photograph on the page to click
_ROUGH = 3  # factor by which pixels and vertices are thinned out to try an order of the corners
_SURE = 0.9  # IoU after the fit from which no other order of the corners is tried
_PAPER, _BOTH, _MISSING, _SPILL = (250, 248, 244), (150, 146, 140), (33, 102, 172), (200, 60, 20)


@dataclass(frozen=True)
class Comparison:
    """How like the picture a photographed shadow is, and where its lamp stood.

    `missing` and `spilled` are shares of the picture's area. `lamp` is None without knots.json. `png` draws
    the differences. `corners` are those of the frame, `x,y` px; `instead` lists other orders of them, best
    first, in which the shadow is far more like the piece's.
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
        """Whether the piece could cast this shadow with its lamp somewhere; None without knots.json."""
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
    photo: Path, folder: Path, corners: Sequence[str] | None = None, view_name: str | None = None
) -> Comparison:
    """Compare a photograph of the shadow with the picture in a folder that a build wrote.

    Args:
        corners: of the frame in the photograph, `x,y` px each, clockwise from the top left. By default they
            are found by the four marks of setup.pdf.
        view_name: the first view by default.

    Raises:
        InputError: a file cannot be read, the frame is not found, or nothing in it is in shadow.
    """
    scene, view, (camera, wanted, pad), knots = _open_view(folder, view_name)
    image = read_photo(photo)
    width, height = camera.width - 2 * pad[0], camera.height - 2 * pad[1]
    grey = image @ (0.299, 0.587, 0.114)
    marks = None
    if corners is not None:
        at = read_corners(corners, image.shape[1], image.shape[0])
    elif (marks := find_marks(grey)) is not None:
        margin = scene.mount.plate_margin_mm if _has_plate(scene) else 0.0
        cards = card_middles(view.frame_mm, margin)
        at = map_points(homography(cards, marks), _frame_corners(view))
    else:
        raise InputError(
            str(photo),
            "it does not show the four marks",
            "Put the four marks of setup.pdf about the frame, or point at the frame's corners (--click), or "
            "name them: --corners x,y x,y x,y x,y.",
        )

    def look(at: Array) -> tuple[Mask, float]:
        """Return the shadow in a frame with these corners, and its IoU with the picture."""
        seen = rectify(grey, at, (width, height), pad)
        if marks is not None:
            cards = map_points(homography(at, _frame_corners(view)), marks)
            scale = width / view.frame_width_mm
            _blank_cards(seen, cards * scale + pad, scale)
        shadow = find_shadow(seen, str(photo))
        return shadow, mask_iou(wanted, shadow)

    def look_roughly(at: Array) -> float:
        """Estimate quickly the best IoU that a frame with these corners can have."""
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
        _draw_differences(wanted, shadow),
        _format_corners(at),
        _find_orders(at, _best_iou(iou, lamp), look_roughly),
    )


def _open_view(
    folder: Path, name: str | None
) -> tuple[Scene, ResolvedView, tuple[Camera, Mask, tuple[int, int]], Knots | None]:
    """Read the files that a build wrote for a view.

    Returns:
        Scene, view, (camera, picture, margin), and the knots if they are there. Camera and picture include
        the margin around the frame, in px right and down.

    Raises:
        InputError: there is no such view, or a file cannot be read.
    """
    scene, view, suffix = _read_view(folder, name)
    target = read_target(view.picture, view, base=folder)
    longer = max(target.width, target.height)
    width, height = (max(1, round(s * _LONGER_PX / longer)) for s in (target.width, target.height))
    pad = _margin_px(scene, view, width)
    asked = sample_mask(target.asked, width, height)
    wanted = np.pad(asked, ((pad[1], pad[1]), (pad[0], pad[0])))
    camera = camera_of(view, width, height).padded(*pad)
    knots = _read_knots(folder / f"knots{suffix}.json", scene)
    return scene, view, (camera, wanted, pad), knots


def _best_iou(iou: float, lamp: LampFit | None) -> float:
    """Return the IoU of shadow and picture or, if larger, of the shadow and that of the knots."""
    return iou if lamp is None else max(lamp.iou, lamp.iou_in_place)


def _coarsen(knots: Knots, camera: Camera, shadow: Mask) -> tuple[Knots, Camera, Mask]:
    small = camera.resized(camera.width // _ROUGH, camera.height // _ROUGH)
    seen = sample_mask(shadow, small.width, small.height)
    fewer = tuple(Knot(knot.points[::_ROUGH]) for knot in knots.knots)
    return Knots(fewer, knots.radius_mm), small, seen


def _find_orders(
    at: Array, found: float, look: Callable[[Array], float]
) -> tuple[tuple[str, ...], ...]:
    """Return the orders of the corners, begun at another one, that fit clearly better; best first.

    A symmetric shadow may have several.

    Args:
        at: (4, 2) px.
        found: the best IoU in the given order.
        look: estimates the best IoU in another order.
    """
    if found >= _SURE:
        return ()
    tried: list[tuple[float, Array]] = []
    for begun in (1, 2, 3):
        turned = np.roll(at, -begun, axis=0)
        try:
            tried.append((look(turned), turned))
        except InputError:  # its margin is another, and no shadow stands out there
            continue
    tried = sorted(tried, key=lambda one: -one[0])
    # it takes 0.1 more IoU to doubt the given order; orders within 0.02 of the best are all named
    if not tried or tried[0][0] < max(_ALIKE, found + 0.1):
        return ()
    return tuple(_format_corners(turned) for iou, turned in tried if iou > tried[0][0] - 0.02)


def _format_corners(at: Array) -> tuple[str, ...]:
    """Format corners as `--corners` takes them."""
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
    """Write the PNG of the differences.

    Raises:
        InputError: `out` is not named .png, or cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "differences are drawn as PNG", "Name a file in .png.")
    write_whole(out, found.png)


def print_comparison(found: Comparison, picture: Path, as_json: bool) -> None:
    """Print how like the picture a photographed shadow is, and what would help; `picture` shows it."""
    if as_json:
        print(json.dumps({**found.to_dict(), "picture": str(picture)}))
        return
    lost = f": {found.missing:.1%} of the picture is missing, {found.spilled:.1%} spilled"
    print(f"{tell_share(found.iou)} alike{'' if found.alike is False else lost}.")
    if advice := advise(found):
        print(f"  {advice}")
    print(f"  {picture} shows where they differ: blue is missing, red is spilled.")


def write_click_page(photo: Path, command: list[str], out: Path) -> None:
    """Write a page, of one file, on which four clicks at the frame's corners give the command to go on.

    Args:
        command: the call of `knotfab compare` to which the page adds the corners.

    Raises:
        InputError: the photograph cannot be read, or the page cannot be written.
    """
    image = Image.fromarray((255 * read_photo(photo)).round().astype("uint8"))
    width, height = image.size
    image.thumbnail((_PAGE_PX, _PAGE_PX))
    template = make_environment(Path(__file__).parent).get_template("click.html.j2")
    page: str = template.render(
        name=photo.name,
        uri=image_uri(image, "jpeg", quality=85),
        width=width,
        height=height,
        before=shlex.join(command[:4]),
        after="".join(f" {shlex.quote(word)}" for word in command[4:]),
    )
    write_whole(out, page.encode())


def _read_view(folder: Path, name: str | None) -> tuple[Scene, ResolvedView, str]:
    """Read the scene, and pick the view by name (the first by default). Returns also the files' suffix."""
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
    view = pick_view(scene.views, name)
    if view.frame_width_mm is None or view.frame_height_mm is None:
        raise InputError(str(path), "no build has written it", "Name a folder that a build wrote.")
    return scene, ResolvedView.model_validate(view.model_dump()), suffix


def _margin_px(scene: Scene, view: ResolvedView, width: int) -> tuple[int, int]:
    """Return the margin to look at around the frame, which stays within a plate if there is one."""
    margin = _MARGIN * view.longer_mm
    if _has_plate(scene):
        margin = min(margin, _PLATE_SHARE * scene.mount.plate_margin_mm)
    px = max(1, round(margin * width / view.frame_width_mm))
    return px, px


def _has_plate(scene: Scene) -> bool:
    held = scene.mount
    return held.kind == "wall" and held.foot != "dowel" and not held.on_feet


def read_photo(path: Path) -> Array:
    """Read a photograph upright, as (H, W, 3) from 0 to 1.

    Raises:
        InputError: the file is missing, or is not a readable image.
    """
    data = read_bytes(path, str(path), _LARGEST_PX, "Check the path.")
    image = run_limited(
        lambda: decode(data, str(path), largest=_LARGEST_PX)[0].convert("RGB"),
        str(path),
        seconds=SECONDS,
    )
    return np.asarray(image, dtype=np.float64) / 255.0


def _frame_corners(view: ResolvedView) -> Array:
    """Return the frame's corners (4, 2), clockwise, in mm right and down from the first."""
    w, h = view.frame_mm
    return np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]])


def _blank_cards(seen: Array, middles: Array, scale: float) -> None:
    """Set to NaN the squares that cards cover, by their middles (4, 2) px, at `scale` px to a mm."""
    v, u = np.mgrid[: seen.shape[0], : seen.shape[1]]
    half = (CARD_MM / 2 + 1.0) * scale
    for x, y in middles:
        seen[(np.abs(u - x) <= half) & (np.abs(v - y) <= half)] = np.nan


def _read_knots(path: Path, scene: Scene) -> Knots | None:
    """Read the knots and move them into the scene; None if the file or the scene's pose is missing.

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


def _draw_differences(wanted: Mask, shadow: Mask) -> bytes:
    """Draw both in grey, the picture alone in blue, the shadow alone in red."""
    sheet = np.full((*wanted.shape, 3), _PAPER, dtype=np.uint8)
    sheet[wanted & shadow] = _BOTH
    sheet[wanted & ~shadow] = _MISSING
    sheet[shadow & ~wanted] = _SPILL
    return encode_image(Image.fromarray(sheet))
