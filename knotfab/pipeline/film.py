"""Make a sequence: a part for each frame, the moving shadow as a GIF, and a zoetrope."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.design.budget import Budget
from knotfab.design.design import Design
from knotfab.design.film import Chain, SequenceFrame
from knotfab.design.film_motion import measure_motion, outline_motion
from knotfab.design.film_search import POOR
from knotfab.design.kept import KeptFrames, keep_for
from knotfab.design.question import silhouette_polygon
from knotfab.knots import read_knots
from knotfab.part.files import About, write_3mf, write_stl
from knotfab.part.plates import clean_body
from knotfab.part.slicer_profile import write_profile
from knotfab.part.write import THUMBNAIL_PX
from knotfab.part.zoetrope import Zoetrope, build_zoetrope
from knotfab.picture.frames import count_knots, tell_apart
from knotfab.picture.read import read_target
from knotfab.pipeline.film_report import (
    Ring,
    check_closing,
    check_motion,
    check_ring,
    sequence_report,
)
from knotfab.pipeline.finish import report_piece
from knotfab.pipeline.held import Workshop
from knotfab.pipeline.piece import WrittenPiece, discard_piece, write_piece
from knotfab.pipeline.verifier import Files, Verifier
from knotfab.render.part_picture import draw_part, write_shadows_gif
from knotfab.request import Request
from knotfab.scene.load import dump_scene
from knotfab_formats.report import Motion, Report
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.verdict import PRINTER, list_unmet

GIF = "sequence.gif"
PICTURES = "picture-frame-*"  # how scene.toml names the frames' pictures
ZOETROPE = "zoetrope"
_EYE_MM = np.array([[0.0, 400.0, 700.0]])  # the zoetrope is drawn from the front and above


def make_film(
    shop: Workshop, request: Request, left: Budget | None, until_written: ExitStack
) -> tuple[Report, str, list[WrittenPiece]]:
    """Search all frames as the same moving knots, and write and verify each as a separate part.

    Each frame has the files of a single piece, numbered (part-01.stl, …). There are one scene.toml,
    sequence.gif and report, and for print the zoetrope. Each frame has its own mount, the zoetrope none.
    Frames are verified and sliced while later ones are searched.

    Args:
        until_written: closed when the build is written; frames kept in case of an interrupt then go.

    Returns:
        The report of all, their title, and the frames.
    """
    folder, progress, targets = shop.folder, shop.progress, shop.targets
    knots = count_knots(targets, request.scene.piece.knots)
    if (apart := tell_apart(targets, knots)) is not None:
        progress.say(apart)
    if request.printing:
        write_profile(folder.work, request.scene)
    kept = until_written.enter_context(_keep_frames(request, shop))
    chain = Chain(request.scene, targets, request.device, progress, left, kept)
    found: dict[int, tuple[SequenceFrame, WrittenPiece]] = {}

    def write(frame: SequenceFrame) -> WrittenPiece:
        target = targets[frame.number]
        work = folder, request, shop.verifier, shop.slicer, progress
        return write_piece(frame.made, [target], *work, "-" + target.name.removeprefix("frame-"))

    for frame in chain.frames():
        found[frame.number] = frame, write(frame)
    for number, (frame, piece) in found.items():
        with progress.stage("verify"):
            _ = piece.verdict
        found[number] = _retry_failed(chain, frame, piece, write, folder)
    ordered = [found[number] for number in sorted(found)]
    frames, pieces = [f for f, _ in ordered], [p for _, p in ordered]
    write_scene(folder, request.scene, pieces[0].scene)
    with progress.stage("zoetrope"):
        ring = _make_ring(folder, pieces, shop.verifier) if request.printing else None
    reports = [report_piece(piece, folder, request, progress) for piece in pieces]
    printed = [] if ring is None else check_ring(ring, pieces[0].scene.printer)
    with progress.stage("motion"):
        motions = _measure_motions(folder, pieces)
    loop = request.scene.sequence.loop
    closing = [check_closing(motions[-1])] if loop else []
    checks = [check_motion(motions[:-1]), *closing, *printed]
    with progress.stage("report"):
        shadows = [folder.file(f"shadow-{t.name}.png") for t in targets]
        if all(path.is_file() for path in shadows):
            write_shadows_gif(folder.file(GIF), shadows, loop and motions[-1].held)
        spun = None if ring is None else ring.spun
        whole = reports, pieces, frames, motions, checks, spun
        return sequence_report(*whole, request, chain.resumed), "a sequence", pieces


@contextmanager
def _keep_frames(request: Request, shop: Workshop) -> Iterator[KeptFrames]:
    """Keep the frames that are found until the build has ended well; say on an interrupt how many are."""
    kept = keep_for(request.scene, shop.targets, request.device, request.time_budget_s)
    count = len(shop.targets)
    if len(kept) > 0:
        shop.progress.say(f"{len(kept)} of {count} frames were done before, and are kept.")
    try:
        yield kept
    except KeyboardInterrupt:
        if len(kept) == 0:
            raise
        said = f"{len(kept)} of {count} frames are searched, and kept for the same call"
        raise KeyboardInterrupt(said) from None
    kept.discard()


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


def _make_ring(folder: OutputFolder, pieces: Sequence[WrittenPiece], verifier: Verifier) -> Ring:
    try:
        spun = write_zoetrope(folder, [piece.made for piece in pieces])
    except SceneError as error:
        return Ring(None, str(error), None)
    answer = verifier.submit(Files(folder.file(f"{ZOETROPE}.stl")), PRINTER)
    return Ring(spun, "", answer)


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


def write_zoetrope(folder: OutputFolder, frames: Sequence[Design]) -> Zoetrope:
    """Write all frames on one ring as zoetrope.stl and zoetrope.3mf.

    Raises:
        SceneError: they do not make one closed body.
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
