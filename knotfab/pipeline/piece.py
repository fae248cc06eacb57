"""Write one piece, or one frame of a sequence, and hand its files over to be verified and sliced."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property

from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.design import START_FILE, Design
from knotfab.knots import Knots
from knotfab.part.assemble import Part, enlarge_knots
from knotfab.part.orient import Flattening
from knotfab.part.slicer import SlicerQueue
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.part.write import pose_scene, write_model, write_part, write_unbuilt
from knotfab.picture.read import Target
from knotfab.pipeline.verifier import Files, Verifier
from knotfab.report.summary import verdict_without_part
from knotfab.request import Request
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Verdict


@dataclass(frozen=True)
class WrittenPiece:
    """One piece as written. `part` is None if none could be made of its knots.

    `scene` has the pose. `suffix` is in the names of its files, such as "-01" for a frame of a sequence.
    `answer` waits for the validators' verdict, and `slicing` for the slicer's result.
    """

    made: Design
    scene: SettledScene
    part: Part | None
    targets: tuple[Target, ...]
    suffix: str
    answer: Callable[[], Verdict]
    slicing: Future[Sliced | NotSliced] | None = None
    flattening: Flattening | None = None
    slicer: SlicerQueue | None = None
    notes: tuple[str, ...] = ()  # sentences for the report

    @property
    def knots(self) -> Knots:
        """The knots as in the file."""
        return enlarge_knots(self.made) if self.part is None else self.part.pose.knots

    @cached_property
    def verdict(self) -> Verdict:
        """The validators' verdict on the files; waits for it."""
        return self.answer()

    @cached_property
    def sliced(self) -> Sliced | NotSliced | None:
        """The slicer's result; waits for it."""
        return None if self.slicing is None else self.slicing.result()


Settled = tuple[Design, Part, Flattening | None]


def write_piece(
    made: Design,
    targets: Sequence[Target],
    settled: Settled | str,
    folder: OutputFolder,
    request: Request,
    verifier: Verifier,
    slicer: SlicerQueue,
    progress: Progress,
    suffix: str = "",
) -> WrittenPiece:
    """Write a design's part, knots, scene and pictures, and submit them to validators and slicer.

    Where there is no part, the verdict says why.

    Args:
        targets: the pictures of all views.
        settled: the part with the design that it is of, or why there is none.
        suffix: for the names of the files, for a frame of a sequence.
    """
    targets = tuple(targets)
    if made.region_stl is not None and made.scene.region.file is not None:
        folder.write(made.scene.region.file, made.region_stl)
    if made.start_json is not None:
        folder.write(START_FILE, made.start_json)
    if isinstance(settled, str):
        why = settled
        scene = write_unbuilt(folder, made, targets, suffix)
        return WrittenPiece(made, scene, None, targets, suffix, lambda: verdict_without_part(why))
    made, part, flattening = settled
    with progress.stage("part"):
        scene = pose_scene(part)
        write_part(folder, part, scene, targets, request.colours, suffix)
    slicing = None
    if request.printing and "slicer" not in request.skip:
        slicing = slicer.submit(folder.file(f"part{suffix}.3mf"), scene)
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
    return WrittenPiece(made, scene, part, targets, suffix, answer, slicing, flattening, slicer)
