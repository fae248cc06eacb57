"""What a sequence writes: the files of each frame, the scene that repeats it, and the zoetrope."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from knotfab.errors import SceneError
from knotfab.files.folder import OutputFolder
from knotfab.files.stl import write_stl
from knotfab.files.threemf import write_3mf
from knotfab.knots import Knots
from knotfab.part.assemble import Part, part_of
from knotfab.part.clean import clean_body
from knotfab.part.write import pose_scene, write_part, write_unbuilt
from knotfab.progress import Progress
from knotfab.request import Request
from knotfab.scene.load import dump_scene
from knotfab.scene.model import ResolvedScene, Scene
from knotfab.sequence.chain import Frame
from knotfab.sequence.zoetrope import Zoetrope, build_zoetrope
from knotfab.slicer.result import NotSliced, Sliced
from knotfab.slicer.run import SlicerQueue
from knotfab.target.read import Target
from knotfab.verify.checks import verdict_without_part
from knotfab.verify.verifier import Files, Verifier

__all__ = ["PICTURES", "ZOETROPE", "Written", "write_frame", "write_scene", "write_zoetrope"]

PICTURES = "picture-frame-*"  # the frames' pictures, as scene.toml names them
ZOETROPE = "zoetrope"


@dataclass(frozen=True)
class Written:
    """One frame as it was written; `part` None if none fits.

    `verdict` waits for the validators, and `sliced` is what the slicer will say, None where it is not asked.
    """

    frame: Frame
    scene: ResolvedScene  # with its pose
    knots: Knots  # placed as in the file
    part: Part | None
    verdict: Callable[[], dict[str, Any]]
    sliced: Future[Sliced | NotSliced] | None = None

    @property
    def number(self) -> str:
        """Of the frame, as its files have it: "01"."""
        return self.scene.views[0].name.removeprefix("frame-")


def write_frame(
    folder: OutputFolder,
    frame: Frame,
    target: Target,
    request: Request,
    verifier: Verifier,
    slicer: SlicerQueue,
    progress: Progress,
) -> Written:
    """Write one frame's part, knots, scene and picture, and hand them over to be verified and sliced.

    Where no part can be made of it, or the printer holds none, its verdict says why.
    """
    made, suffix = frame.made, "-" + target.name.removeprefix("frame-")
    if made.region_stl is not None and made.scene.region.file is not None:
        folder.write(made.scene.region.file, made.region_stl)
    try:
        part = part_of(made, request.printing, [target], progress)
        if part.plates is not None:
            raise SceneError(
                target.name,
                f"{made.scene.printer.name} prints it in several pieces only",
                "Use a smaller frame (scene key frame_width_mm), or another printer",
            )
    except SceneError as error:
        scene = write_unbuilt(folder, made, [target], suffix)
        verdict = verdict_without_part(str(error))
        return Written(frame, scene, made.knots, None, lambda: verdict)
    with progress.stage("part"):
        scene = pose_scene(part)
        write_part(folder, part, scene, [target], request.colours, suffix)
    answer = verifier.submit(
        Files(
            folder.file(f"part{suffix}.stl"),
            folder.file(f"knots{suffix}.json"),
            folder.file(f"scene{suffix}.toml"),
            folder.work,
        )
    )
    sliced = None
    if request.printing and "slicer" not in request.skip:
        sliced = slicer.submit(folder.file(f"part{suffix}.3mf"), scene)
    return Written(frame, scene, part.pose.knots, part, answer.result, sliced)


def write_scene(folder: OutputFolder, asked: Scene, first: Scene) -> Path:
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
    whole = Scene.model_validate({**keys, "mount": asked.mount})
    return folder.write("scene.toml", dump_scene(whole))


def write_zoetrope(folder: OutputFolder, frames: Sequence[Frame]) -> Zoetrope:
    """All frames on one ring, as zoetrope.stl and zoetrope.3mf.

    Raises:
        SceneError: they make no one closed body.
    """
    scene = frames[0].made.scene
    spun = build_zoetrope(
        [f.made.knots for f in frames], scene.printer.build_volume_mm, scene.piece.clearance_mm
    )
    spun = replace(spun, mesh=clean_body(spun.mesh))
    write_stl(folder.file(f"{ZOETROPE}.stl"), [spun.mesh])
    write_3mf(
        folder.file(f"{ZOETROPE}.3mf"),
        [spun.mesh],
        "knotfab zoetrope",
    )
    return spun
