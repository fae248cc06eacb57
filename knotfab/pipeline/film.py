"""Make a sequence: a part for each frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.design.budget import Budget
from knotfab.design.film import POOR, Chain, SequenceFrame
from knotfab.design.film_motion import measure_motion, outline_motion
from knotfab.design.question import silhouette_polygon
from knotfab.knots import read_knots
from knotfab.part.assemble import part_of
from knotfab.part.slicer_profile import write_profile
from knotfab.picture.frames import count_knots, tell_apart
from knotfab.picture.read import read_target
from knotfab.pipeline.film_report import check_closing, check_motion, sequence_report
from knotfab.pipeline.finish import report_piece
from knotfab.pipeline.piece import Settled, WrittenPiece, discard_piece, write_piece
from knotfab.pipeline.plan import Workshop
from knotfab.plan import Attempts
from knotfab.request import Request
from knotfab.scene.load import dump_scene
from knotfab_formats.report import Motion, Report
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.verdict import list_unmet

PICTURES = "picture-frame-*"  # how scene.toml names the frames' pictures


def make_film(
    shop: Workshop, request: Request, left: Budget | None, attempts: Attempts
) -> tuple[Report, str, list[WrittenPiece]]:
    """Search all frames as the same moving knots, and write and verify each as a separate part.

    Each frame has the files of a single piece, numbered (part-01.stl, …), and its own mount; scene.toml and
    report are of all. Frames are verified and sliced while later ones are searched.

    Returns:
        The report of all, their title, and the frames.
    """
    folder, progress, targets = shop.folder, shop.progress, shop.targets
    knots = count_knots(targets, request.scene.piece.knots)
    if (apart := tell_apart(targets, knots)) is not None:
        progress.say(apart)
    if request.printing:
        write_profile(folder.work, request.scene)
    chain = Chain(request.scene, targets, request.device, attempts, left)
    found: dict[int, tuple[SequenceFrame, WrittenPiece]] = {}

    def write(frame: SequenceFrame) -> WrittenPiece:
        target = targets[frame.number]
        work = folder, request, shop.verifier, shop.slicer, progress
        settled: Settled | str
        try:  # frames share one depth and one wall
            settled = frame.made, part_of(frame.made, request.printing, [target], progress), None
        except SceneError as error:
            settled = str(error)
        suffix = "-" + target.name.removeprefix("frame-")
        return write_piece(frame.made, [target], settled, *work, suffix)

    for frame in chain.frames():
        found[frame.number] = frame, write(frame)
    for number, (frame, piece) in found.items():
        with progress.stage("verify"):
            _ = piece.verdict
        found[number] = _retry_failed(chain, frame, piece, write, folder)
    ordered = [found[number] for number in sorted(found)]
    frames, pieces = [f for f, _ in ordered], [p for _, p in ordered]
    write_scene(folder, request.scene, pieces[0].scene)
    reports = [report_piece(piece, folder, request, progress) for piece in pieces]
    with progress.stage("motion"):
        motions = _measure_motions(folder, pieces)
    loop = request.scene.sequence.loop
    closing = [check_closing(motions[-1])] if loop else []
    checks = [check_motion(motions[:-1]), *closing]
    with progress.stage("report"):
        whole = reports, pieces, frames, motions, checks
        return sequence_report(*whole, request), "a sequence", pieces


def _list_failed(frame: SequenceFrame, piece: WrittenPiece) -> list[str]:
    limits = [] if frame.made.result.feasible else ["limits"]
    unmet = list_unmet(piece.verdict.checks)
    return [*limits, *(c.name for c in unmet if c.status == "fail")]


def _retry_failed(
    chain: Chain,
    frame: SequenceFrame,
    piece: WrittenPiece,
    write: Callable[[SequenceFrame], WrittenPiece],
    folder: OutputFolder,
) -> tuple[SequenceFrame, WrittenPiece]:
    """Search a failed frame again from another start, and keep the better one.

    A frame whose limits or floor forbid a better result is returned as it is.
    """
    failed, made = _list_failed(frame, piece), frame.made
    shadows = bool(failed) and set(failed) <= {"shadow", "half_light"}
    best = shadows and made.result.iou_estimate >= made.opening_iou - POOR
    if not failed or best or made.unmet or made.binding:
        return frame, piece
    again = chain.retry(frame.number)
    discard_piece(piece, folder)
    other = write(again)
    if len(_list_failed(again, other)) < len(failed):
        chain.accept(again)
        return again, other
    discard_piece(other, folder)
    return frame, write(frame)


def _measure_motions(folder: OutputFolder, pieces: Sequence[WrittenPiece]) -> list[Motion]:
    """Measure from the written knots the motion into frames 2, 3, … and, last, back to frame 1."""
    points, outlines = [], []
    for piece in pieces:
        assert piece.scene.pose is not None
        written = read_knots(folder.file(f"knots{piece.suffix}.json"))
        points.append(written.moved(np.array(piece.scene.pose.matrix)).points)
        (view,) = piece.made.scene.views
        target = read_target(folder.file(view.picture), view)
        outlines.append(silhouette_polygon(view, target))
    knots = pieces[0].made.knots
    following = [*range(1, len(pieces)), 0]
    return [
        measure_motion(
            points[k],
            points[n],
            outline_motion(outlines[k], outlines[n], len(knots.knots)),
            knots.radius_mm,
        )
        for k, n in enumerate(following)
    ]


def write_scene(folder: OutputFolder, asked: ResolvedScene, first: ResolvedScene) -> Path:
    """Write a scene.toml from which `knotfab build --sequence` makes the same sequence again.

    It has the first frame's resolved settings, but the mount and the IoU floor of `asked`, since these
    follow from each frame.

    Args:
        asked: the scene as the user wrote it.
    """
    keys = first.model_dump(by_alias=True, exclude={"pose", "mount"})
    named = {"name": asked.views[0].name, "picture": PICTURES}
    keys["views"] = [{**keys["views"][0], **named}]
    keys["accuracy"]["iou_floor"] = asked.accuracy.iou_floor
    whole = ResolvedScene.model_validate({**keys, "mount": asked.mount})
    return folder.write("scene.toml", dump_scene(whole))
