"""What a sequence writes: the files of each frame, the scene that repeats it, and the zoetrope."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.errors import SceneError
from knotfab.files.folder import OutputFolder
from knotfab.files.stl import write_stl
from knotfab.files.threemf import write_3mf
from knotfab.knots import Knots
from knotfab.part.assemble import Part, part_of, pose_of
from knotfab.part.clean import as_written
from knotfab.progress import Progress
from knotfab.report.of_build import check_part
from knotfab.scene.load import dump_scene
from knotfab.scene.model import ResolvedScene, Scene
from knotfab.sequence.chain import Frame
from knotfab.sequence.verifying import FrameFiles, FrameVerifier
from knotfab.sequence.zoetrope import Zoetrope, zoetrope
from knotfab.target.read import Target

__all__ = ["PICTURES", "ZOETROPE", "Written", "write_frame", "write_scene", "write_zoetrope"]

PICTURES = "picture-frame-*"  # the frames' pictures, as scene.toml names them
ZOETROPE = "zoetrope"


@dataclass(frozen=True)
class Written:
    """One frame as it was written, and the validators' verdict to come; `part` None if none fits."""

    frame: Frame
    scene: ResolvedScene  # with its pose
    knots: Knots  # placed as in the file
    part: Part | None
    answer: Future[dict[str, Any]]

    @property
    def number(self) -> str:
        """Of the frame, as its files have it: "01"."""
        return self.scene.views[0].name.removeprefix("frame-")


def write_frame(
    folder: OutputFolder,
    frame: Frame,
    target: Target,
    printing: bool,
    verifier: FrameVerifier,
    progress: Progress,
) -> Written:
    """Write one frame's part, knots, scene and picture, and hand them over to be verified.

    Where no part can be made of it, or the printer holds none, its verdict says why.
    """
    made, number = frame.made, target.name.removeprefix("frame-")
    folder.write(made.scene.views[0].picture, target.png_bytes)
    if made.region_stl is not None and made.scene.region.file is not None:
        folder.write(made.scene.region.file, made.region_stl)
    stl = folder.file(f"part-{number}.stl")
    knots = folder.file(f"knots-{number}.json")
    placed = folder.file(f"scene-{number}.toml")
    try:
        part = part_of(made, printing, [target], progress)
        if part.plates is not None:
            raise SceneError(
                target.name,
                f"{made.scene.printer.name} prints it in several pieces only",
                "Use a smaller frame (scene key frame_width_mm), or another printer",
            )
    except SceneError as error:
        scene = made.scene.model_copy(update={"pose": pose_of(np.eye(4))})
        made.knots.write(knots)
        folder.write(placed.name, dump_scene(scene))
        return Written(frame, scene, made.knots, None, _refused(str(error)))
    with progress.stage("part"):
        scene = part.mounted.scene.model_copy(update={"pose": pose_of(part.pose.matrix)})
        write_stl(stl, part.bodies)
        write_3mf(
            stl.with_suffix(".3mf"),
            part.bodies,
            part.mounted.names,
            title=f"knotfab {target.name}",
            colors=[scene.material.color] * len(part.bodies),
        )
        part.pose.knots.write(knots)
        folder.write(placed.name, dump_scene(scene))
    return Written(
        frame,
        scene,
        part.pose.knots,
        part,
        verifier.submit(FrameFiles(stl, knots, placed, folder.work)),
    )


def _refused(why: str) -> Future[dict[str, Any]]:
    """The verdict on a frame that has no part."""
    answer: Future[dict[str, Any]] = Future()
    answer.set_result(
        {
            "status": "fail",
            "exit_code": 1,
            "checks": [check_part(why)],
            "views": [],
            "seconds": {},
        }
    )
    return answer


def write_scene(folder: OutputFolder, asked: Scene, first: Scene) -> Path:
    """scene.toml: the first frame's, every search setting resolved, with the pictures of all frames.

    Its mount is what was asked for: each frame has its own.

    `knotfab build --sequence --scene DIR/scene.toml` makes the same sequence again.

    Args:
        asked: the scene as a person wrote it: what is required of the IoU follows from each picture,
            unless it was given.
    """
    keys = first.model_dump(by_alias=True, exclude={"pose", "mount"})
    keys["views"][0] |= {"name": asked.views[0].name, "picture": PICTURES}
    keys["accuracy"]["iou_floor"] = asked.accuracy.iou_floor
    whole = Scene.model_validate({**keys, "mount": asked.mount})
    return folder.write("scene.toml", dump_scene(whole))


def write_zoetrope(folder: OutputFolder, frames: Sequence[Frame]) -> Zoetrope:
    """All frames on one ring, as zoetrope.stl and zoetrope.3mf.

    Raises:
        SceneError: they make no one closed body.
    """
    scene = frames[0].made.scene
    spun = zoetrope(
        [f.made.knots for f in frames], scene.printer.build_volume_mm, scene.piece.clearance_mm
    )
    spun = replace(spun, mesh=as_written(spun.mesh))
    write_stl(folder.file(f"{ZOETROPE}.stl"), [spun.mesh])
    write_3mf(
        folder.file(f"{ZOETROPE}.3mf"),
        [spun.mesh],
        [ZOETROPE],
        title="knotfab zoetrope",
        colors=[scene.material.color],
    )
    return spun
