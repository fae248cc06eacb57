"""Report a written piece, and put a finished build in its place: the folder itself, or `rejected`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import wait
from dataclasses import replace

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.sentence import OPEN_HOLDER, hold_of
from knotfab.design.survey import GUESSED, TOLD_NEAR
from knotfab.part.files import read_back_strict
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.pipeline.piece import WrittenPiece
from knotfab.pipeline.settle import tell_depth
from knotfab.report.drill_template import write_drill_template
from knotfab.report.effects import judge_made, list_sags, list_views, tell_bounds, tell_warnings
from knotfab.report.folder_page import write_page
from knotfab.report.for_maker import check_slicing, tell_setup, tell_unsliced, with_slicing
from knotfab.report.pictures import draw_agreement, tell_turns
from knotfab.report.report import (
    check_3mf,
    check_certificate,
    check_limits,
    check_price,
    plan_next_step,
    print_of,
    report_of,
    tell_binding,
    write_report_json,
)
from knotfab.report.rows import list_rows
from knotfab.report.setup import write_setup
from knotfab.report.supports import report_posing, report_supports
from knotfab.request import Outcome, Promise, Request
from knotfab.scene.camera import cameras_of
from knotfab_formats.laxer import tell_laxer
from knotfab_formats.print_figures import PlateFigures
from knotfab_formats.report import Report
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Check, Verdict, View, exit_code
from knotfab_validators.conclusion import tell_lowered
from knotfab_validators.shadows.verdict_rules import worst_verdict

SAME_TUBE = 0.05  # relative difference of radii that nobody sees
_TOLD_S = 0.5  # interval between progress messages on the slicer


def report_piece(
    piece: WrittenPiece,
    folder: OutputFolder,
    request: Request,
    progress: Progress,
    draw: Callable[[Sequence[View]], None] = lambda views: None,
) -> Report:
    """Wait for the verdict and the slicer, write drawings, and make the report.

    Args:
        draw: draws more from the verified views, while PrusaSlicer slices.

    Raises:
        SceneError: a required check failed, and the request has another scene to build.
    """
    made, part = piece.made, piece.part
    if part is None:
        prefer_other_way(request, piece.verdict.checks)
        return _report_unbuilt(piece, request)
    mounted, printing = part.mounted, request.printing
    cameras = cameras_of(piece.scene.views, piece.targets)
    drawings = list[str]()
    if printing:
        with progress.stage("drawings"):  # while the validators measure
            drawings = write_setup(folder.work, mounted, piece.scene, cameras, piece.suffix)
            drawings += write_drill_template(folder.work, mounted, cameras[0], piece.suffix)
    with progress.stage("verify"):
        said = _read_back(folder, piece)
        verdict = piece.verdict
        own = (check_3mf(said), check_certificate(made), check_limits(made), mounted.check_sag())
        checks = [*verdict.checks, *(check for check in own if check is not None)]
    prefer_other_way(request, checks)
    with progress.stage("report"):  # while PrusaSlicer slices
        views = _list_views(piece, printing, verdict)
        judged = worst_verdict(views)
        word = "faithful" if judged is None else judged.word
        if piece.slicing is not None and not piece.slicing.done() and not piece.suffix:
            failed = [check.name for check in checks if check.required and check.status == "fail"]
            told = f"{', '.join(failed)} failed" if failed else f"verified, {word}"
            progress.say(f"{told}; PrusaSlicer is slicing")
        draw(views)
        _draw_bendings(piece, folder)
        turning, turned = tell_turns(mounted) if printing else (None, [])
        print_ = replace(
            print_of(made, part.bodies, views),
            mount=mounted.figures,
            plate=_plate_of(piece) if printing else None,
            roots=mounted.roots_figures,
            drawings=tuple(drawings),
            setup=tell_setup(mounted, cameras, made.knots.radius_mm),
            turning=turning,
        )
        print_, laid = report_posing(print_, part, piece.flattening, printing=printing)
    sliced = _wait_for_slicer(piece, progress)
    with progress.stage("report"):
        checks += [] if sliced is None else [check_slicing(sliced)]
        prefer_other_way(request, checks)
        if printing:
            print_ = with_slicing(print_, sliced)
            checks += check_price(print_, piece.scene.piece)
            print_ = report_supports(print_, request, part, checks, views, word)
        notes = _list_notes(piece, request, views, sliced, (turned, laid))
        found = verdict, checks, views, print_, notes, sliced
        return report_of(request, made, piece.knots, *found)


def prefer_other_way(request: Request, checks: Sequence[Check]) -> None:
    """Reject a piece that fails a required check if the request can be built in another way.

    Raises:
        SceneError: a check failed; it names the checks, with figures and place of the first.
    """
    failed = [check for check in checks if check.required and check.status == "fail"]
    if request.otherwise is not None and failed:
        names = ", ".join(check.name for check in failed)
        raise SceneError(f"{names} failed", failed[0].detail, "Use --supports slicer")


def _report_unbuilt(piece: WrittenPiece, request: Request) -> Report:
    """Return the report of knots that could not be made into a part; its verdict says why."""
    made = piece.made
    checks = [*piece.verdict.checks, check_certificate(made), check_limits(made)]
    notes = [*tell_binding(made), *tell_warnings(made.result.effects)]
    print_ = print_of(made, (), ())
    return report_of(request, made, piece.knots, piece.verdict, checks, (), print_, notes)


def _wait_for_slicer(piece: WrittenPiece, progress: Progress) -> Sliced | NotSliced | None:
    """Wait until a piece is sliced; None if it is not to be."""
    with progress.stage("slicer"):
        while piece.slicer and piece.slicing and wait([piece.slicing], _TOLD_S).not_done:
            progress.update(piece.slicer.done, even=False)
        return piece.sliced


def _draw_bendings(piece: WrittenPiece, folder: OutputFolder) -> None:
    """Write bent-VIEW.png for each picture that was bent to agree with the others."""
    made = piece.made
    for view, target, bound in zip(made.scene.views, piece.targets, made.bounds, strict=False):
        if target.bending is not None:
            folder.write(f"bent-{view.name}.png", draw_agreement(target, bound))


def _list_notes(
    piece: WrittenPiece,
    request: Request,
    views: Sequence[View],
    sliced: Sliced | NotSliced | None,
    found: tuple[Sequence[str], Sequence[str]],
) -> list[str]:
    """List the report's notes; `found` are those on the turning pictures and on the pose."""
    made, part, targets = piece.made, piece.part, piece.targets
    assert part is not None
    turned, laid = found
    return [
        *(tell_unsliced(sliced) if request.printing else ()),
        *piece.notes,
        *filter(None, [part.framing[1]]),
        *tell_depth(request.scene.piece.depth, made),
        *turned,
        *tell_binding(made),
        *tell_warnings(made.result.effects),
        *tell_bounds(made, targets),
        *laid,
    ]


def _list_views(piece: WrittenPiece, printing: bool, verdict: Verdict) -> list[View]:
    """Add to the verified views what only the build knows: effects, sag, bounds."""
    made, part, lies = piece.made, piece.part, piece.scene.pose
    moves = None if part is None else part.mounted.moves
    up = None if lies is None or not printing else np.array(lies.matrix)[:3, 2]
    judge_made(made, piece.scene, moves, up)
    sags = list_sags(made, moves, [target.asked for target in piece.targets])
    return list_views(verdict.views, made, piece.targets, sags)


def _plate_of(piece: WrittenPiece) -> PlateFigures | None:
    """Return the figures of the plate in which the piece stands, if it does."""
    if piece.part is None:
        return None
    return piece.part.mounted.plate_figures(piece.scene.material.shrinks_to)


def tell_unlike_preview(
    promise: Promise | None, report: Report, scene: SettledScene, radius_mm: float
) -> list[str]:
    """Say what of a piece is not as the preview told it, and why: holder, tube, grams, hours, told."""
    if promise is None:
        return []
    print_, holder, other = report.print, hold_of(scene), list[str]()
    if holder != promise.holder and promise.holder not in ("", OPEN_HOLDER):
        other.append(f"it is {holder}, and not {promise.holder}")
    if abs(radius_mm / promise.radius_mm - 1.0) > SAME_TUBE:
        other.append(
            f"its tube is {2 * radius_mm:.1f} mm thick, and not {2 * promise.radius_mm:.1f} mm "
            f"(--tube-radius {promise.radius_mm:.2f} keeps to that)"
        )
    if print_.time_s and print_.filament_g and promise.hours:
        grams, hours = print_.filament_g, print_.time_s / 3600
        pairs = (promise.grams, grams, 1.0), (promise.hours, hours, 0.1)
        if any(abs(a - b) > max((GUESSED - 1) * b, least) for a, b, least in pairs):
            other.append(
                f"it takes {grams:.0f} g and {hours:.1f} h, and not {promise.grams:.0f} g and "
                f"{promise.hours:.1f} h"
            )
    said, tells = promise.told, [view.told.worst.share for view in report.views if view.told]
    if said is not None and tells and abs(max(tells) - said) > TOLD_NEAR:
        other.append(f"unlit it tells {max(tells):.2f} of its picture, and not {said:.2f}")
    if not other:
        return []
    length = sum(knot.length_mm for knot in report.knots)
    long = f"its strands are {length:.0f} mm long, where {promise.length_mm:.0f} mm are usual"
    if print_.supports is not None and print_.supports.way == "slicer":
        why = print_.supports.why
    else:
        why = "; ".join(dict.fromkeys(one.why_next for one in report.attempts if one.why_next))
        if abs(length / promise.length_mm - 1) > SAME_TUBE:
            why = f"{long}{why and ', since '}{why}"
    return [f"the piece is not as the preview said: {', '.join(other)}; {why or long}"]


def finish_build(
    folder: OutputFolder,
    request: Request,
    report: Report,
    title: str,
    pieces: Sequence[WrittenPiece],
    progress: Progress,
) -> Outcome:
    """Write the report, and commit the folder, or reject it if a required check failed.

    Args:
        pieces: one, or the frames of a sequence; the report's viewer shows them.
    """
    timings, cpu = progress.account()
    report = replace(
        report,
        title=title,
        timings=timings,
        cpu=cpu,
        next_step=plan_next_step(report, timings),
        warnings=(
            *tell_lowered(report.checks),
            *filter(None, [tell_laxer(pieces[0].scene)]),
            *tell_unlike_preview(
                request.promise, report, pieces[0].scene, pieces[0].made.knots.radius_mm
            ),
        )
        or None,
    )
    report = replace(report, rows=list_rows(report))
    write_report_json(folder.file("report.json"), report)
    write_page(folder.work)
    code = exit_code(report.checks)
    if code == 0:
        folder.commit()
        return Outcome(0, report, request.out)
    folder.reject()
    return Outcome(code, report, request.out / "rejected")


def _read_back(folder: OutputFolder, piece: WrittenPiece) -> list[str]:
    """Read the 3MF files back with lib3mf, and return its warnings."""
    warnings = read_back_strict(folder.file(f"part{piece.suffix}.3mf"))
    coloured = folder.file(f"part-colours{piece.suffix}.3mf")
    if coloured.is_file():
        warnings += [f"{coloured.name}: {warning}" for warning in read_back_strict(coloured)]
    return warnings
