"""Go from a photograph back to a better piece: a scene with the lamp where it was found to stand."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from knotfab.apps.compare.compare import Comparison, advise, open_view, read_photo
from knotfab.apps.compare.rectify import LampFit, cast_shadow
from knotfab.base.arrays import Array
from knotfab.base.disk import write_whole
from knotfab.knots import Knot, Knots
from knotfab.picture.raster import image_uri
from knotfab.picture.silhouette import mask_iou
from knotfab.render.pages import length
from knotfab.report.page import make_environment
from knotfab.scene.camera import Camera
from knotfab.scene.load import dump_scene
from knotfab_formats.errors import InputError

FIXED = "fixed.toml"  # a file beside the scene that was built, whose pictures it names


@dataclass(frozen=True)
class Fix:
    """Remedies for a lamp that stands elsewhere, and their gains.

    IoU of shadow and picture: `moved_iou` of this piece, once its lamp is where it belongs; `new_iou`, by an
    estimate, of a new one for the lamp as it stands. `right_mm` and `up_mm`: where the new one then hangs,
    from where this one does, as seen from the lamp.
    """

    scene: Path
    moved_iou: float
    new_iou: float
    light_distance_mm: float
    right_mm: float
    up_mm: float

    def to_dict(self) -> dict[str, object]:
        """Return the key `fix` of `knotfab compare --json`."""
        numbers = {k: round(v, 4) for k, v in self.__dict__.items() if k != "scene"}
        return {"scene": str(self.scene), **numbers}


def plan_fix(found: Comparison, folder: Path, view_name: str | None = None) -> Fix:
    """Write `fixed.toml` into a folder that a build wrote: its scene, with the lamp at the distance it has.

    A lamp beside its place needs no other piece: one that hangs as far to that side has it before its middle.

    Raises:
        InputError: nothing can be said of the lamp; or the piece is one of a sequence, or no knots are there.
    """
    remedy = advise(found) or "Name a folder with its knots.json."
    if found.lamp is None or not found.alike:
        raise InputError("--fix", "the photograph does not tell where the lamp stood", remedy)
    scene, view, suffix, (camera, wanted, _), knots = open_view(folder, view_name)
    if suffix:
        why = "a sequence is lit by one lamp, and all of its frames would have to be made anew"
        raise InputError("--fix", why, "Move the lamp instead: leave out --fix.")
    assert knots is not None
    stands = camera.eye + _displaced(camera, found.lamp)
    axis = camera.eye / np.linalg.norm(camera.eye)
    distance = float(stands @ axis)
    aside = camera.wall_axes @ (stands - distance * axis)
    moved_to = {"light_distance_mm": distance}
    views = tuple(one.but(**moved_to) if one.name == view.name else one for one in scene.views)
    fixed = scene.but(views=views, pose=None, mount=scene.mount.but(pegs=(), thread_mm=None))
    path = folder / FIXED
    write_whole(path, dump_scene(fixed).encode("utf-8"))
    moved = mask_iou(cast_shadow(knots, camera, camera.eye) > 0.5, wanted)
    renewed = mask_iou(cast_shadow(_led(knots, camera, stands), camera, stands) > 0.5, wanted)
    return Fix(path, moved, renewed, distance, float(aside[0]), float(aside[1]))


def tell_fix(fix: Fix, found: Comparison) -> list[str]:
    """Say what moving the lamp alone would bring, and what a new part would."""
    said = [
        f"Moving the lamp alone would bring {_percent(fix.moved_iou)} (now {_percent(found.iou)}).",
        f"A new part for the lamp as it stands, {length(fix.light_distance_mm)} mm from its middle, would "
        f"bring about {_percent(fix.new_iou)}: knotfab build --scene {fix.scene}",
    ]
    ways = [
        f"{abs(by):.0f} mm {word[by > 0]}"
        for by, word in ((fix.right_mm, ("left", "right")), (fix.up_mm, ("down", "up")))
        if abs(by) >= 2.0  # a piece is worth hanging elsewhere from so much on
    ]
    if ways:
        said.append(f"It belongs {' and '.join(ways)} of where this one is, before the lamp.")
    return said


def _percent(share: float) -> str:
    return f"{min(100 * share, 99.9):.1f}%"


def _displaced(camera: Camera, lamp: LampFit) -> Array:
    """Return (3,) how far the lamp is off its place."""
    found: Array = np.array([lamp.right_mm, lamp.up_mm, lamp.away_mm]) @ camera.wall_axes
    return found


def _led(knots: Knots, camera: Camera, eye: Array) -> Knots:
    """Give the knots, each point led along the wall until a lamp at `eye` throws it if the camera's does."""
    wall, offset = camera.receiver[:3], float(camera.receiver[3])

    def led(points: Array) -> Array:
        off = points @ wall + offset
        share = (off / (float(camera.eye @ wall) + offset))[:, None]
        there = (points - share * camera.eye) / (1 - share)  # points on the wall
        share = (off / (float(eye @ wall) + offset))[:, None]
        return np.asarray(there + share * (eye - there))

    return replace(knots, knots=tuple(Knot(led(knot.points)) for knot in knots.knots))


# A page to point at the frame's corners in a photograph: four clicks, and it says the command.


_LONGER_PX = 2000  # longer side of the photograph as it is shown


def write_click_page(photo: Path, command: list[str], out: Path) -> None:
    """Write a page of one file, which opens offline.

    Args:
        command: the call of `knotfab compare` without its corners: what the page adds them to.

    Raises:
        InputError: the photograph cannot be read, or the page not written.
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
