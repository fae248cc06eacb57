"""One piece, or one frame of a sequence: written, and handed over to be verified and sliced."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import START_FILE, Design
from knotfab.files.folder import OutputFolder
from knotfab.knots import Knots
from knotfab.part.about import GCODE_PX, draw_thumbnail
from knotfab.part.also import write_also
from knotfab.part.assemble import Part, enlarge_knots, part_of
from knotfab.part.flatter import Flattening
from knotfab.part.write import pose_scene, write_model, write_part, write_unbuilt
from knotfab.picture.read import Target
from knotfab.request import Request
from knotfab.settle import settle_part
from knotfab.slicer.result import NotSliced, Sliced
from knotfab.slicer.run import SlicerQueue
from knotfab.verify.checks import verdict_without_part
from knotfab.verify.verifier import Files, Verifier
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Verdict

__all__ = ["WrittenPiece", "discard_piece", "files_for_slicer", "write_piece"]


@dataclass(frozen=True)
class WrittenPiece:
    """One piece as it was written; `part` is None where none can be made of its knots.

    `scene` has its pose. `suffix` is in its files' names, such as "-01" of a sequence's frame. `answer` waits
    for the validators' verdict; `slicings` are what the slicer will say, by file. `notes` are sentences
    for the report.
    """

    made: Design
    scene: SettledScene
    part: Part | None
    targets: tuple[Target, ...]
    suffix: str
    answer: Callable[[], Verdict]
    slicings: dict[str, Future[Sliced | NotSliced]] = field(default_factory=dict)
    flattening: Flattening | None = None
    slicer: SlicerQueue | None = None
    notes: tuple[str, ...] = ()

    @property
    def knots(self) -> Knots:
        """The knots as they are in the file."""
        return enlarge_knots(self.made) if self.part is None else self.part.pose.knots

    @cached_property
    def verdict(self) -> Verdict:
        """The validators' verdict on the files."""
        return self.answer()

    @cached_property
    def sliced(self) -> dict[str, Sliced | NotSliced]:
        """The slicer's result for each file."""
        return {name: slicing.result() for name, slicing in self.slicings.items()}


def write_piece(
    made: Design,
    targets: Sequence[Target],
    folder: OutputFolder,
    request: Request,
    verifier: Verifier,
    slicer: SlicerQueue,
    progress: Progress,
    suffix: str = "",
) -> WrittenPiece:
    """Write the part of a design with its knots, scene and pictures, and hand them over.

    Where no part can be made of it, or the printer holds none, its verdict says why.

    Args:
        targets: the pictures of all views. suffix: suffix of its files' names, where it is one of several
            frames.
    """
    targets, flattening = tuple(targets), None
    if made.region_stl is not None and made.scene.region.file is not None:
        folder.write(made.scene.region.file, made.region_stl)
    if made.start_json is not None:
        folder.write(START_FILE, made.start_json)
    try:
        if len(targets) == 1 and not suffix:  # all frames move in one depth, before one wall
            made, part, flattening = settle_part(request, targets[0], made, progress)
        else:
            part = part_of(made, request.printing, targets, progress)
    except SceneError as error:
        why = str(error)
        scene = write_unbuilt(folder, made, targets, suffix)
        return WrittenPiece(made, scene, None, targets, suffix, lambda: verdict_without_part(why))
    with progress.stage("part"):
        scene = pose_scene(part, suffix)
        write_part(folder, part, scene, targets, request.colours, suffix)
    slicings = {}
    if request.printing and "slicer" not in request.skip:
        printed = files_for_slicer(folder, part, suffix)
        png = draw_thumbnail(part, scene.views, GCODE_PX) if "gcode" in request.also else b""
        slicings = {path.name: slicer.submit(path, scene, png) for path in printed}
    files = Files(
        folder.file(f"part{suffix}.stl"),
        folder.file(f"knots{suffix}.json"),
        folder.file(f"scene{suffix}.toml"),
        folder.work,
        folder.file(f"failures{suffix}.png"),
    )
    answer = verifier.submit(files).result
    with progress.stage("part"):
        write_model(folder, part, scene, suffix)
        told = write_also(folder, part, scene, targets, request.also, suffix)
    return WrittenPiece(
        made, scene, part, targets, suffix, answer, slicings, flattening, slicer, told
    )


def discard_piece(piece: WrittenPiece, folder: OutputFolder) -> None:
    """Remove all files of a frame that is to be written anew; its verdict is known.

    A slicing that has begun may still read them, and is waited for.
    """
    wait([slicing for slicing in piece.slicings.values() if not slicing.cancel()])
    own = re.compile(rf"[a-z-]+{piece.suffix}(-\d+)?\.\w+")  # "plate-03-1.3mf" of suffix "-03"
    for path in list(folder.work.iterdir()):
        if own.fullmatch(path.name):
            path.unlink()


def files_for_slicer(folder: OutputFolder, part: Part, suffix: str) -> list[Path]:
    """List the printed files: the part, or its plates."""
    names = [f"part{suffix}.3mf"] if part.plates is None else part.plates.files(suffix)
    return [folder.file(name) for name in names]
