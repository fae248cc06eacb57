"""The files that a sequence writes beside its frames: the scene that repeats it, and the zoetrope."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from knotfab.design.design import Design
from knotfab.drawing.part_picture import draw_part
from knotfab.files.folder import OutputFolder
from knotfab.files.stl import write_stl
from knotfab.files.threemf import About, write_3mf
from knotfab.part.about import THUMBNAIL_PX
from knotfab.part.clean import clean_body
from knotfab.picture.read import Target
from knotfab.scene.load import dump_scene
from knotfab.sequence.zoetrope import Zoetrope, build_zoetrope
from knotfab_formats.scene import ResolvedScene

__all__ = ["PICTURES", "ZOETROPE", "frame_suffix", "write_scene", "write_zoetrope"]

PICTURES = "picture-frame-*"  # the frames' pictures, as scene.toml names them
ZOETROPE = "zoetrope"
_EYE_MM = np.array(
    [[0.0, 400.0, 700.0]]
)  # the eye that its ring is drawn from: before and above it


def frame_suffix(target: Target) -> str:
    """Return the end of the names of a frame's files: "-01"."""
    return "-" + target.name.removeprefix("frame-")


def write_scene(folder: OutputFolder, asked: ResolvedScene, first: ResolvedScene) -> Path:
    """scene.toml: the first frame's, every search setting resolved, with the pictures of all frames.

    Its mount is what was asked for: each frame has its own.

    `knotfab build --sequence --scene DIR/scene.toml` makes the same sequence again.

    Args:
        asked: the scene as a person wrote it: what is required of the IoU follows from each picture,
            unless it was given.
    """
    keys = first.model_dump(by_alias=True, exclude={"pose", "mount"})
    named = {"name": asked.views[0].name, "picture": PICTURES}
    keys["views"] = [{**keys["views"][0], **named}]
    keys["accuracy"]["iou_floor"] = asked.accuracy.iou_floor
    whole = ResolvedScene.model_validate({**keys, "mount": asked.mount})
    return folder.write("scene.toml", dump_scene(whole))


def write_zoetrope(folder: OutputFolder, frames: Sequence[Design]) -> Zoetrope:
    """All frames on one ring, as zoetrope.stl and zoetrope.3mf.

    Raises:
        SceneError: they make no one closed body.
    """
    scene = frames[0].scene
    spun = build_zoetrope(
        [made.knots for made in frames], scene.printer.build_volume_mm, scene.piece.clearance_mm
    )
    spun = replace(spun, mesh=clean_body(spun.mesh))
    write_stl(folder.file(f"{ZOETROPE}.stl"), [spun.mesh])
    drawn, (vertices, faces) = io.BytesIO(), spun.mesh
    draw_part(vertices[:, [0, 2, 1]] * [1, 1, -1], faces, drawn, _EYE_MM, THUMBNAIL_PX)  # y is up
    told, count = scene.about, len(frames)
    about = About(
        f"{told.title or 'knotfab'}, zoetrope",
        told.designer or "knotfab",
        f"{count} frames of a moving knot on a ring: a lamp in its middle throws them on a wall, one by one.",
        told.licence,
        drawn.getvalue(),
    )
    write_3mf(folder.file(f"{ZOETROPE}.3mf"), [spun.mesh], about)
    return spun
