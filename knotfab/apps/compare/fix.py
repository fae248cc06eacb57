"""From a photograph to a better piece: the scene with the lamp where it was found to stand."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from knotfab.apps.compare.compare import Comparison, advise, open_view, read_photo
from knotfab.apps.compare.rectify import cast_shadow
from knotfab.base.arrays import Array
from knotfab.base.disk import write_whole
from knotfab.knots import Knot, Knots
from knotfab.picture.raster import image_uri
from knotfab.picture.silhouette import mask_iou
from knotfab.render.pages import length
from knotfab.report.page import make_environment
from knotfab.report.summary import tell_share
from knotfab.scene.camera import Camera
from knotfab.scene.load import dump_scene
from knotfab_formats.errors import InputError

FIXED = "fixed.toml"  # beside the scene that was built, whose picture files it names


@dataclass(frozen=True)
class Fix:
    """The two remedies for a lamp that stands elsewhere: move it, or build a new piece for it.

    `moved_iou` is the IoU of shadow and picture with the lamp moved to its place, and `new_iou` an estimate
    for a new piece, which hangs `right_mm` and `up_mm` from this one, as seen from the lamp.
    """

    scene: Path
    moved_iou: float
    new_iou: float
    light_distance_mm: float
    right_mm: float
    up_mm: float

    def to_dict(self) -> dict[str, object]:
        """Return the value of `fix` in `knotfab compare --json`."""
        numbers = {k: round(v, 4) for k, v in self.__dict__.items() if k != "scene"}
        return {"scene": str(self.scene), **numbers}


def plan_fix(found: Comparison, folder: Path, view_name: str | None = None) -> Fix:
    """Write `fixed.toml`, the scene with the lamp at its real distance, into a folder that a build wrote.

    A lamp that stands to the side needs no other piece: the new one hangs as far to that side.

    Raises:
        InputError: the lamp was not found, knots.json is missing, or the piece is one of a sequence.
    """
    remedy = advise(found) or "Name a folder with its knots.json."
    if found.lamp is None or not found.alike:
        raise InputError("--fix", "the photograph does not tell where the lamp stood", remedy)
    scene, view, suffix, (camera, wanted, _), knots = open_view(folder, view_name)
    if suffix:
        why = "a sequence is lit by one lamp, and all of its frames would have to be made anew"
        raise InputError("--fix", why, "Move the lamp instead: leave out --fix.")
    assert knots is not None
    off = np.array([found.lamp.right_mm, found.lamp.up_mm, found.lamp.away_mm])
    stands = camera.eye + off @ camera.wall_axes
    axis = camera.eye / np.linalg.norm(camera.eye)
    distance = float(stands @ axis)
    aside = camera.wall_axes @ (stands - distance * axis)
    moved_to = {"light_distance_mm": distance}
    views = tuple(one.but(**moved_to) if one.name == view.name else one for one in scene.views)
    mount = scene.mount.but(pegs=(), thread_mm=None, second_thread_mm=None)
    fixed = scene.but(views=views, pose=None, mount=mount)
    path = folder / FIXED
    write_whole(path, dump_scene(fixed).encode("utf-8"))
    moved = mask_iou(cast_shadow(knots, camera, camera.eye) > 0.5, wanted)
    rebuilt = _shift_along_wall(knots, camera, stands)
    renewed = mask_iou(cast_shadow(rebuilt, camera, stands) > 0.5, wanted)
    return Fix(path, moved, renewed, distance, float(aside[0]), float(aside[1]))


def tell_fix(fix: Fix, found: Comparison) -> list[str]:
    """Say what moving the lamp alone would bring, and what a new part would."""
    said = [
        f"Moving the lamp alone would bring {tell_share(fix.moved_iou)} (now {tell_share(found.iou)}).",
        f"A new part for the lamp as it stands, {length(fix.light_distance_mm)} mm from its middle, would "
        f"bring about {tell_share(fix.new_iou)}: knotfab build --scene {fix.scene}",
    ]
    ways = [
        f"{abs(by):.0f} mm {word[by > 0]}"
        for by, word in ((fix.right_mm, ("left", "right")), (fix.up_mm, ("down", "up")))
        if abs(by) >= 2.0  # mm; less is not worth hanging it elsewhere
    ]
    if ways:
        said.append(f"It belongs {' and '.join(ways)} of where this one is, before the lamp.")
    return said


def print_comparison(
    found: Comparison, picture: Path, as_json: bool, plan: Fix | None = None
) -> None:
    """Print how like the picture a photographed shadow is, and what would help; `picture` shows it."""
    if as_json:
        fix = {} if plan is None else {"fix": plan.to_dict()}
        print(json.dumps({**found.to_dict(), "picture": str(picture), **fix}))
        return
    lost = f": {found.missing:.1%} of the picture is missing, {found.spilled:.1%} spilled"
    print(f"{tell_share(found.iou)} alike{'' if found.alike is False else lost}.")
    if advice := advise(found):
        print(f"  {advice}")
    for line in () if plan is None else tell_fix(plan, found):
        print(f"  {line}")
    print(f"  {picture} shows where they differ: blue is missing, red is spilled.")


def _shift_along_wall(knots: Knots, camera: Camera, eye: Array) -> Knots:
    """Shift each point parallel to the wall, so that a lamp at `eye` casts it where the camera's did."""
    wall, offset = camera.receiver[:3], float(camera.receiver[3])

    def shift(points: Array) -> Array:
        off = points @ wall + offset
        share = (off / (float(camera.eye @ wall) + offset))[:, None]
        there = (points - share * camera.eye) / (1 - share)  # its shadow on the wall
        share = (off / (float(eye @ wall) + offset))[:, None]
        return np.asarray(there + share * (eye - there))

    return replace(knots, knots=tuple(Knot(shift(knot.points)) for knot in knots.knots))


_LONGER_PX = 2000  # longer side of the photograph on the page


def write_click_page(photo: Path, command: list[str], out: Path) -> None:
    """Write a page, of one file, on which four clicks at the frame's corners give the command to go on.

    Args:
        command: the call of `knotfab compare` to which the page adds the corners.

    Raises:
        InputError: the photograph cannot be read, or the page cannot be written.
    """
    image = Image.fromarray((255 * read_photo(photo)).round().astype("uint8"))
    width, height = image.size
    image.thumbnail((_LONGER_PX, _LONGER_PX))
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
