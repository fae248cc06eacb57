"""One piece, or one frame of a sequence: written, handed over to be verified and sliced, and reported."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import START_FILE, Design
from knotfab.files.folder import OutputFolder
from knotfab.files.threemf import read_back_strict
from knotfab.knots import Knots
from knotfab.mount.drawing import draw_sheets, write_setup
from knotfab.mount.drill_template import write_drill_template
from knotfab.part.about import GCODE_PX, draw_thumbnail
from knotfab.part.also import write_also
from knotfab.part.assemble import Part, enlarge_knots, part_of
from knotfab.part.flatter import Flattening
from knotfab.part.write import pose_scene, write_model, write_part, write_unbuilt
from knotfab.picture.read import Target
from knotfab.preview.draw import draw_agreement
from knotfab.report.for_maker import draw_setup, list_files, tell_setup
from knotfab.report.of_bounds import tell_bounds
from knotfab.report.of_build import (
    add_fabrication,
    check_3mf,
    check_certificate,
    check_limits,
    report_of,
    tell_binding,
)
from knotfab.report.of_effects import (
    add_contrast,
    add_sag,
    advise,
    count_flattened,
    judge_made,
    tell_contrast,
    tell_walls,
    tell_warnings,
)
from knotfab.report.of_slicer import check_slicing, tell_kept
from knotfab.report.of_time import add_next_step
from knotfab.report.of_verdict import advise_widening
from knotfab.report.pictures import find_pictures
from knotfab.report.posing import add_posing, find_access
from knotfab.report.report_html import write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.report.turning import add_turning
from knotfab.report.viewer_data import HistoryFrame, viewer_data
from knotfab.request import Outcome, Request
from knotfab.scene.camera import cameras_of
from knotfab.settle import settle_part, tell_depth
from knotfab.slicer.result import NotSliced, Sliced, sum_slicings
from knotfab.slicer.run import SlicerQueue
from knotfab.verify.checks import exit_code, verdict_without_part
from knotfab.verify.verifier import Files, Verifier
from knotfab_formats.scene import ResolvedScene

if TYPE_CHECKING:
    from knotfab.wire.plan import WirePlan

__all__ = ["WrittenPiece", "discard_piece", "finish_build", "report_piece", "write_piece"]

Record = dict[str, Any]
_TOLD_S = 0.5  # between what is said of the slicer


@dataclass(frozen=True)
class WrittenPiece:
    """One piece as it was written; `part` is None where none can be made of its knots.

    `scene` has its pose. `suffix` is in its files' names, such as "-01" of a sequence's frame. `answer` waits
    for the validators' verdict; `slicings` are what the slicer will say, by file. `notes` are sentences
    for the report.
    """

    made: Design
    scene: ResolvedScene
    part: Part | None
    targets: tuple[Target, ...]
    suffix: str
    answer: Callable[[], Record]
    slicings: dict[str, Future[Sliced | NotSliced]] = field(default_factory=dict)
    flattening: Flattening | None = None
    slicer: SlicerQueue | None = None
    notes: tuple[str, ...] = ()

    @property
    def knots(self) -> Knots:
        """The knots as they are in the file."""
        return enlarge_knots(self.made) if self.part is None else self.part.pose.knots

    @cached_property
    def verdict(self) -> Record:
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
        printed = _files_for_slicer(folder, part, suffix)
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


def report_piece(
    piece: WrittenPiece, folder: OutputFolder, request: Request, progress: Progress
) -> Record:
    """Wait for the verdict on a piece, write its bending plan and drawings, and report all of it."""
    made, part = piece.made, piece.part
    cameras, access = cameras_of(piece.scene.views, piece.targets), None
    if part is not None and request.printing:
        with progress.stage("drawings"):  # while the validators measure
            sheets = draw_sheets(part.mounted, piece.scene, cameras)
            templates = write_drill_template(folder.work, part.mounted, cameras[0], piece.suffix)
            access = find_access(part)
    with progress.stage("verify"):
        said = [] if part is None else _read_back(folder, piece)
        verdict = piece.verdict
    own = [check_certificate(made), check_limits(made)]
    if part is None:
        verdict["checks"] += own
        report = report_of(request, made, piece.knots, [], verdict, piece.targets, progress)
        notes = [*tell_binding(made), *tell_warnings(made.result.effects)]
        return report | {"notes": notes} if notes else report
    sag = part.mounted.check_sag()
    verdict["checks"] += [check_3mf(said), *own]
    verdict["checks"] += [] if sag is None else [sag]
    with progress.stage("slicer"):
        while piece.slicer and wait(piece.slicings.values(), _TOLD_S).not_done:
            progress.update(piece.slicer.done, even=False)
        sliced = sum_slicings(piece.sliced) if piece.sliced else None
    if sliced is not None:
        verdict["checks"].append(check_slicing(sliced))
    plan = _plan_bends(folder, piece, progress)
    if plan is not None:
        verdict["checks"] += plan.checks
    drawings: list[str] = []
    if request.printing:
        with progress.stage("drawings"):
            views = verdict["views"] or [{} for _ in cameras]
            costs = [view.get("misplacement") for view in views]
            drawings = [*write_setup(folder.work, sheets, costs, piece.suffix), *templates]
    with progress.stage("report"):
        lies = piece.scene.pose
        up = None if lies is None or not request.printing else np.array(lies.matrix)[:3, 2]
        judge_made(made, piece.scene, part.mounted.moves, up)
        count_flattened(made.result.effects, piece.targets)
        add_contrast(verdict["views"], made)
        add_sag(verdict["views"], made, part.mounted.moves, [t.asked for t in piece.targets])
        report = report_of(
            request, made, piece.knots, part.bodies, verdict, piece.targets, progress
        )
        add_fabrication(report, part.mounted, sliced, plan, request.printing)
        report["notes"] += [*piece.notes, *filter(None, [part.framing[1]])]
        report["notes"] += tell_depth(request.scene.piece.depth, made)
        report["notes"] += tell_kept(sliced) if "gcode" in request.also else []
        report["print"]["drawings"] = drawings
        report["print"]["setup"] = tell_setup(part.mounted, cameras, made.knots.radius_mm)
        if request.printing:
            add_turning(report, folder.work, part.mounted, made.knots)
        views = report["views"]
        report["notes"] += [*tell_binding(made), *tell_warnings(made.result.effects)]
        report["notes"] += [*advise(views, made), *tell_contrast(views), *tell_walls(views)]
        report["notes"] += tell_bounds(made, piece.targets)
        for view, target, bound in zip(made.scene.views, piece.targets, made.bounds, strict=False):
            if target.bending is not None:
                folder.write(f"bent-{view.name}.png", draw_agreement(target, bound))
        add_posing(
            report,
            part,
            piece.flattening,
            piece.suffix,
            printing=request.printing,
            access=access,
        )
    return report


def finish_build(
    folder: OutputFolder,
    request: Request,
    report: Record,
    title: str,
    pieces: Sequence[WrittenPiece],
    progress: Progress,
) -> Outcome:
    """Write the report, and move the whole to where its checks say that it belongs.

    Args:
        pieces: one, or the frames of a sequence; the report's viewer shows them.
    """
    report["timings"] |= {
        **progress.timings,
        "total": progress.total,
    }  # the report's own seconds included
    add_next_step(report)
    if advised := advise_widening(report.get("verdict"), pieces[0].scene):
        report["notes"] = [*report.get("notes", []), *advised]
    write_report_json(folder.file("report.json"), report)
    names = [path.name for path in folder.work.iterdir()]
    write_report_html(
        folder.file("report.html"),
        report,
        find_pictures(folder.work),
        title,
        shown=_show(pieces),
        drawings=draw_setup(folder.work),
        files=list_files(names),
    )
    code = exit_code(report["checks"])
    if code == 0:
        folder.commit()
        return Outcome(0, report, request.out)
    folder.reject()
    return Outcome(code, report, request.out / "rejected")


def _show(pieces: Sequence[WrittenPiece]) -> Record:
    """The viewer's data of the first piece; the slider goes through its search, or through several pieces."""
    first = pieces[0]
    bodies = [] if first.part is None else first.part.bodies
    if several := len(pieces) > 1:
        frames = [
            HistoryFrame(f"frame {k} of {len(pieces)}", piece.made.knots, piece.targets[0].asked)
            for k, piece in enumerate(pieces, start=1)
        ]
    else:
        past = first.made.history
        frames = [HistoryFrame(f"{100 * k // len(past)} %", knots) for k, knots in enumerate(past)]
    return viewer_data(
        first.scene,
        first.knots,
        bodies,
        [target.asked for target in first.targets],
        history=frames,
        history_label="frame" if several else "search",
    )


def _plan_bends(folder: OutputFolder, piece: WrittenPiece, progress: Progress) -> WirePlan | None:
    """The bending plan, written, where the piece is of wire."""
    if piece.scene.material.process != "wire":
        return None
    from knotfab.wire.plan import write_bending_plan

    with progress.stage("bending plan"):
        pictures = [folder.file(view.picture) for view in piece.scene.views]
        return write_bending_plan(
            folder.work, piece.made.knots, piece.scene, pictures, suffix=piece.suffix
        )


def _files_for_slicer(folder: OutputFolder, part: Part, suffix: str) -> list[Path]:
    """List the printed files: the part, or its plates."""
    names = [f"part{suffix}.3mf"] if part.plates is None else part.plates.files(suffix)
    return [folder.file(name) for name in names]


def _read_back(folder: OutputFolder, piece: WrittenPiece) -> list[str]:
    """Read the files for the slicer back with lib3mf; its words are by name where there are several."""
    assert piece.part is not None
    whole, coloured = (
        folder.file(f"{name}{piece.suffix}.3mf") for name in ("part", "part-colours")
    )
    others = {*_files_for_slicer(folder, piece.part, piece.suffix), coloured} - {whole}
    warnings = read_back_strict(whole)
    for path in sorted(p for p in others if p.is_file()):
        warnings += [f"{path.name}: {warning}" for warning in read_back_strict(path)]
    return warnings
