"""One piece, or one frame of a sequence: written, handed over to be verified and sliced, and reported."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from dataclasses import dataclass, field, replace
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
from knotfab.report.of_build import (
    check_3mf,
    check_certificate,
    check_limits,
    print_of,
    report_of,
    tell_binding,
    tell_mount,
    tell_plan,
    write_report_json,
)
from knotfab.report.of_effects import (
    advise,
    count_flattened,
    judge_made,
    list_contrasts,
    list_sags,
    tell_contrast,
    tell_walls,
    tell_warnings,
)
from knotfab.report.of_slicer import check_slicing, tell_kept, tell_unsliced, with_slicing
from knotfab.report.of_time import plan_next_step
from knotfab.report.of_views import advise_widening, list_views, tell_bounds
from knotfab.report.pictures import find_pictures
from knotfab.report.posing import find_access, lay_out
from knotfab.report.report_html import write_report_html
from knotfab.report.turning import turn_piece
from knotfab.report.viewer_data import HistoryFrame, viewer_data
from knotfab.request import Outcome, Request
from knotfab.scene.camera import cameras_of
from knotfab.settle import settle_part, tell_depth
from knotfab.slicer.result import NotSliced, Sliced, sum_slicings
from knotfab.slicer.run import SlicerQueue
from knotfab.verify.checks import verdict_without_part
from knotfab.verify.verifier import Files, Verifier
from knotfab_formats.report import Report
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Verdict, View, exit_code

if TYPE_CHECKING:
    from knotfab.wire.plan import WirePlan

__all__ = ["WrittenPiece", "discard_piece", "finish_build", "report_piece", "write_piece"]

_TOLD_S = 0.5  # between what is said of the slicer
_AFTER_BENDS_S = 5.0  # from the last step of a wire's plan to the end of a build


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
) -> Report:
    """Wait for the verdict on a piece, write its bending plan and drawings, and report all of it."""
    made, part, targets = piece.made, piece.part, piece.targets
    if part is None:
        checks = [*piece.verdict.checks, check_certificate(made), check_limits(made)]
        notes = [*tell_binding(made), *tell_warnings(made.result.effects)]
        print_ = print_of(made, (), ())
        return report_of(request, made, piece.knots, piece.verdict, checks, (), print_, notes)
    mounted, printing = part.mounted, request.printing
    cameras = cameras_of(piece.scene.views, targets)
    sheets, templates, access = None, list[str](), None
    if printing:
        with progress.stage("drawings"):  # while the validators measure
            sheets = draw_sheets(mounted, piece.scene, cameras)
            templates = write_drill_template(folder.work, mounted, cameras[0], piece.suffix)
            access = find_access(part)
    with progress.stage("verify"):
        said = _read_back(folder, piece)
        verdict = piece.verdict
    with progress.stage("slicer"):
        while piece.slicer and wait(piece.slicings.values(), _TOLD_S).not_done:
            progress.update(piece.slicer.done, even=False)
        sliced = sum_slicings(piece.sliced) if piece.sliced else None
    plan = _plan_bends(folder, piece, request, progress)
    drawings: tuple[str, ...] = ()
    if sheets is not None:
        with progress.stage("drawings"):
            costs = [view.misplacement for view in verdict.views] or [None for _ in cameras]
            drawings = (*write_setup(folder.work, sheets, costs, piece.suffix), *templates)
    with progress.stage("report"):
        own = (check_3mf(said), check_certificate(made), check_limits(made), mounted.check_sag())
        checks = [*verdict.checks, *(check for check in own if check is not None)]
        checks += [] if sliced is None else [check_slicing(sliced)]
        checks += [] if plan is None else plan.checks
        views = _list_views(piece, printing, verdict)
        for view, target, bound in zip(made.scene.views, targets, made.bounds, strict=False):
            if target.bending is not None:
                folder.write(f"bent-{view.name}.png", draw_agreement(target, bound))
        setup = tell_setup(mounted, cameras, made.knots.radius_mm)
        mount, turning, turned = mounted.figures, None, list[str]()
        if printing:
            turning, turned = turn_piece(folder.work, mounted, made.knots)
        print_ = replace(
            print_of(made, part.bodies, views),
            mount=mount,
            drawings=drawings,
            setup=setup,
            turning=turning,
        )
        filament = printing and plan is None
        print_ = with_slicing(print_, sliced) if filament else print_
        how = piece.flattening, piece.suffix
        print_, laid = lay_out(print_, part, *how, printing=printing, access=access)
        flat_wall = piece.scene.views[0].wall_radius_mm is None
        notes = [
            *tell_mount(len(piece.knots.knots), mount, len(targets) == 1 and flat_wall),
            *(tell_unsliced(sliced) if filament else ()),
            *tell_plan(plan),
            *piece.notes,
            *filter(None, [part.framing[1]]),
            *tell_depth(request.scene.piece.depth, made),
            *(tell_kept(sliced) if "gcode" in request.also else ()),
            *turned,
            *tell_binding(made),
            *tell_warnings(made.result.effects),
            *advise(views, made),
            *tell_contrast(views),
            *tell_walls(views),
            *tell_bounds(made, targets),
            *laid,
        ]
        found = verdict, checks, views, print_, notes, sliced, plan
        return report_of(request, made, piece.knots, *found)


def _list_views(piece: WrittenPiece, printing: bool, verdict: Verdict) -> list[View]:
    """The verified views, with what the build knows and measures of them."""
    made, part, lies = piece.made, piece.part, piece.scene.pose
    moves = None if part is None else part.mounted.moves
    up = None if lies is None or not printing else np.array(lies.matrix)[:3, 2]
    judge_made(made, piece.scene, moves, up)
    count_flattened(made.result.effects, piece.targets)
    sags = list_sags(made, moves, [target.asked for target in piece.targets])
    return list_views(verdict.views, made, piece.targets, list_contrasts(made), sags)


def finish_build(
    folder: OutputFolder,
    request: Request,
    report: Report,
    title: str,
    pieces: Sequence[WrittenPiece],
    progress: Progress,
) -> Outcome:
    """Write the report, and move the whole to where its checks say that it belongs.

    Args:
        pieces: one, or the frames of a sequence; the report's viewer shows them.
    """
    timings = {**progress.timings, "total": progress.total}
    report = replace(
        report,
        timings=timings,
        next_step=plan_next_step(report, timings),
        notes=(*report.notes, *advise_widening(report.verdict, pieces[0].scene)),
    )
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
    code = exit_code(report.checks)
    if code == 0:
        folder.commit()
        return Outcome(0, report, request.out)
    folder.reject()
    return Outcome(code, report, request.out / "rejected")


def _show(pieces: Sequence[WrittenPiece]) -> dict[str, Any]:
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


def _plan_bends(
    folder: OutputFolder, piece: WrittenPiece, request: Request, progress: Progress
) -> WirePlan | None:
    """The bending plan, written, where the piece is of wire."""
    if piece.scene.material.process != "wire":
        return None
    from knotfab.wire.plan import write_bending_plan

    with progress.stage("bending plan"):
        pictures = [folder.file(view.picture) for view in piece.scene.views]
        left = request.budget(progress.total, mounted=False)
        ends = np.inf
        if left is not None:
            seconds = replace(left, after_s=_AFTER_BENDS_S, after_vertex_s=0.0).search_s(0)
            ends = time.perf_counter() + seconds
        return write_bending_plan(
            folder.work, piece.made.knots, piece.scene, pictures, piece.suffix, ends
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
