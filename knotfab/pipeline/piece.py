"""Write one piece, or one frame of a sequence, and hand its files over to be verified and sliced."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.design import START_FILE, Design
from knotfab.geometry.tube import sweep
from knotfab.hold.modeller import call_fixture
from knotfab.hold.placement import placement_of
from knotfab.knots import Knots
from knotfab.part.assemble import Part, enlarge_knots, part_of
from knotfab.part.files import write_dxf, write_svg
from knotfab.part.orient import Flattening
from knotfab.part.slicer import SlicerQueue
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.part.write import (
    GCODE_PX,
    draw_thumbnail,
    pose_scene,
    write_model,
    write_part,
    write_unbuilt,
)
from knotfab.picture.read import Target
from knotfab.pipeline.settle import settle_part
from knotfab.pipeline.verifier import Files, Verifier
from knotfab.report.setup import shadow_outlines
from knotfab.report.summary import verdict_without_part
from knotfab.request import Request
from knotfab.scene.camera import Camera, cameras_of
from knotfab_fixtures.step import write_centre_lines, write_solids
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Verdict


@dataclass(frozen=True)
class WrittenPiece:
    """One piece as written. `part` is None if none could be made of its knots.

    `scene` has the pose. `suffix` is in the names of its files, such as "-01" for a frame of a sequence.
    `answer` waits for the validators' verdict, and `slicings` hold the slicer's pending results, by file.
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
    def sliced(self) -> dict[str, Sliced | NotSliced]:
        """The slicer's result for each file; waits for it."""
        return {name: slicing.result() for name, slicing in self.slicings.items()}


Settled = tuple[Design, Part, Flattening | None]


def settle(
    request: Request, made: Design, targets: Sequence[Target], progress: Progress, suffix: str = ""
) -> Settled:
    """Make the part of a design, which is searched again where its mount or supports need it.

    Raises:
        SceneError: no part can be made.
    """
    if len(targets) == 1 and not suffix:  # frames share one depth and one wall
        return settle_part(request, targets[0], made, progress)
    return made, part_of(made, request.printing, targets, progress), None


def write_piece(
    made: Design,
    targets: Sequence[Target],
    folder: OutputFolder,
    request: Request,
    verifier: Verifier,
    slicer: SlicerQueue,
    progress: Progress,
    suffix: str = "",
    settled: Settled | None = None,
) -> WrittenPiece:
    """Write a design's part, knots, scene and pictures, and submit them to validators and slicer.

    If no part can be made of the design, or it does not fit the printer, the verdict says why.

    Args:
        targets: the pictures of all views.
        suffix: for the names of the files, for a frame of a sequence.
        settled: the part, where it has been made already.
    """
    targets = tuple(targets)
    if made.region_stl is not None and made.scene.region.file is not None:
        folder.write(made.scene.region.file, made.region_stl)
    if made.start_json is not None:
        folder.write(START_FILE, made.start_json)
    try:
        made, part, flattening = settled or settle(request, made, targets, progress, suffix)
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


def discard_piece(piece: WrittenPiece, folder: OutputFolder, aside: Path | None = None) -> None:
    """Remove all files of a piece, or move them `aside`, once no slicer reads them any more."""
    wait([slicing for slicing in piece.slicings.values() if not slicing.cancel()])
    own = re.compile(rf"[a-z-]+{piece.suffix}(-\d+)?\.\w+")  # such as "plate-03-1.3mf" for "-03"
    for path in list(folder.work.iterdir()):
        if own.fullmatch(path.name):
            path.unlink() if aside is None else path.rename(aside / path.name)


def files_for_slicer(folder: OutputFolder, part: Part, suffix: str) -> list[Path]:
    """List the files to print: the part, or its plates."""
    names = [f"part{suffix}.3mf"] if part.plates is None else part.plates.files(suffix)
    return [folder.file(name) for name in names]


# files for other tools (--also)

_SIDES, _FEWEST_SIDES = 12, 6  # most and fewest sides of a faceted tube
_FACETS, _MOST_FACETS = 24_000, 60_000  # facets aimed at, and most; writing each takes 0.4 ms
_SHADOW_MM = 0.01  # tolerance of a shadow's outline as a polygon


def write_also(
    folder: OutputFolder,
    part: Part,
    scene: SettledScene,
    targets: Sequence[Target],
    also: Collection[str],
    suffix: str = "",
) -> tuple[str, ...]:
    """Write centre lines, shadow outlines and solids in the formats that `also` names.

    SVG and DXF centre lines are drawn where the first light casts them on the wall, laid flat, so that they
    lie in the middle of the shadow. STEP files have the pose of part.stl.

    Returns:
        Sentences for the report.
    """
    if not also:
        return ()
    assert scene.pose is not None
    cameras = cameras_of(scene.views, targets)
    places = [placement_of(part.mounted, c, v) for c, v in zip(cameras, scene.views, strict=True)]
    knots = part.pose.knots.moved(np.array(scene.pose.matrix)).knots
    lines = {f"knot-{n}": [places[0].cast(k.points)] for n, k in enumerate(knots, start=1)}
    frame = places[0].frame_mm
    if "dxf" in also:
        write_dxf(folder.file(f"centre-lines{suffix}.dxf"), lines, frame)
    if "svg" in also:
        title = f"centre lines as the light of {scene.views[0].name} throws them"
        write_svg(folder.file(f"centre-lines{suffix}.svg"), lines, frame, title)
        for view, place in zip(scene.views, places, strict=True):
            outlines = {"shadow": shadow_outlines(part.mounted, place, _SHADOW_MM)}
            path = folder.file(f"shadow-{view.name}.svg")
            write_svg(path, outlines, place.frame_mm, f"shadow of {view.name}", filled=True)
    return _write_step(folder, part, cameras[0], suffix) if "step" in also else ()


def _write_step(folder: OutputFolder, part: Part, camera: Camera, suffix: str) -> tuple[str, ...]:
    """Write centre lines, tubes and mount as STEP. Returns a sentence for each tube that cannot be smooth."""
    knots = part.pose.knots
    lines = {f"knot {n}": k.points for n, k in enumerate(knots.knots, start=1)}
    call_fixture(
        write_centre_lines,
        str(folder.file(f"centre-lines{suffix}.step")),
        {name: points.tolist() for name, points in lines.items()},
    )
    fixtures: dict[str, Any] = {}
    for one in part.mounted.fixtures(camera):
        number = sum(name.startswith(one.kind) for name in fixtures) + 1
        fixtures[f"{one.kind} {number}"] = one.to_dict()
    to_part = np.linalg.inv(part.pose.matrix).tolist()
    tubes: dict[str, Any] = {
        name: {"points": points.tolist(), "radius_mm": knots.radius_mm}
        for name, points in lines.items()
    }
    path = str(folder.file(f"part{suffix}.step"))
    failed = call_fixture(write_solids, path, tubes, fixtures, to_part)
    if not failed:
        return ()
    told = []
    for name in failed:
        sides = _count_sides(len(lines[name]))
        if sides == 0:
            del tubes[name]
            why = "and has too many vertices for one of facets: take part.stl."
            told.append(
                f"{Path(path).name} lacks the tube of {name}: it bends too tightly for a smooth solid, {why}"
            )
            continue
        vertices, faces = sweep(lines[name], knots.radius_mm, sides)
        tubes[name] = {"vertices": vertices.tolist(), "faces": faces.tolist()}
        told.append(
            f"{Path(path).name} holds the tube of {name} as a solid of facets, {sides} about it: it bends "
            "too tightly for a smooth one."
        )
    if tubes or fixtures:
        call_fixture(write_solids, path, tubes, fixtures, to_part)
    return tuple(told)


def _count_sides(vertices: int) -> int:
    """Return how many sides a faceted tube of `vertices` may have; 0 if even the fewest are too many."""
    if 2 * _FEWEST_SIDES * vertices > _MOST_FACETS:
        return 0
    fit = _FACETS // (4 * vertices) * 2
    return min(_SIDES, max(_FEWEST_SIDES, fit))
