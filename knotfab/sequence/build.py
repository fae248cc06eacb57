"""A sequence from its pictures to a folder: a verified part a frame, the moving shadow, a zoetrope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotfab.design.question import silhouette_polygon
from knotfab.errors import SceneError
from knotfab.files.folder import OutputFolder
from knotfab.files.threemf import read_back_strict
from knotfab.pipeline import PRINTER_CHECKS, Outcome, Request, require_device
from knotfab.progress import Progress
from knotfab.report.of_build import check_3mf, check_certificate, check_limits, report_of
from knotfab.report.report_html import Picture, write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.scene.model import Scene
from knotfab.sequence.chain import chain
from knotfab.sequence.frames import read_frames
from knotfab.sequence.gif import shadows_gif
from knotfab.sequence.motion import Motion, measure, outline_motion
from knotfab.sequence.report import (
    Ring,
    check_closing,
    check_motion,
    check_ring,
    check_slicing,
    sequence_report,
)
from knotfab.sequence.require import require_sequence
from knotfab.sequence.verifying import FrameFiles, FrameVerifier
from knotfab.sequence.writing import ZOETROPE, Written, write_frame, write_scene, write_zoetrope
from knotfab.sequence.written import knot_in_scene
from knotfab.target.read import Target, read_target

__all__ = ["GIF", "SequenceRequest", "build_sequence"]

GIF = "sequence.gif"


@dataclass(frozen=True)
class SequenceRequest:
    """What `knotfab build --sequence` was asked.

    `sources`: a folder of numbered pictures, an animation, or several pictures in order.
    """

    scene: Scene
    sources: Sequence[str]
    out: Path
    base: Path | None = None
    printing: bool = False
    device: str = "cpu"
    skip: frozenset[str] = frozenset()
    command: str = ""
    targets: tuple[Target, ...] = ()  # the frames, where they have been read already


def build_sequence(request: SequenceRequest, progress: Progress | None = None) -> Outcome:
    """Search all frames as one moving knot, and write and verify each as a part of its own.

    Files: part-NN.stl, part-NN.3mf, knots-NN.json, scene-NN.toml, picture-frame-NN.*,
    shadow-frame-NN.png, compare-frame-NN.png, scene.toml, sequence.gif, report.json and report.html; to
    be printed, zoetrope.stl and zoetrope.3mf as well. Frames are verified while later ones are searched.
    As with one picture, what fails a required check is written whole to DIR/rejected.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    require_device(request.device)
    require_sequence(request.scene)
    skip = set(request.skip) | (set() if request.printing else set(PRINTER_CHECKS))
    with OutputFolder(request.out) as folder:
        with progress.stage("pictures"):
            invert = request.scene.views[0].invert
            targets = request.targets or read_frames(
                request.sources, invert=invert, base=request.base
            )
        with FrameVerifier(skip) as verifier:
            frames = chain(request.scene, targets, request.device, progress)
            made = [
                write_frame(folder, frame, target, request.printing, verifier, progress)
                for frame, target in zip(frames, targets, strict=True)
            ]
            write_scene(folder, request.scene, made[0].scene)
            with progress.stage("zoetrope"):
                ring = _ring(folder, made, verifier) if request.printing else None
            with progress.stage("verify"):
                verdicts = [m.answer.result() for m in made]
                printed = [] if ring is None else check_ring(ring, made[0].scene.printer)
        reports = [
            _frame_report(request, m, v, folder, progress)
            for m, v in zip(made, verdicts, strict=True)
        ]
        with progress.stage("motion"):
            motions = _motions(folder, made)
        checks = [check_motion(motions[:-1]), check_closing(motions[-1]), *printed]
        if request.printing:
            checks.append(check_slicing())
        with progress.stage("report"):
            shadows = [folder.file(f"shadow-{t.name}.png") for t in targets]
            if all(path.is_file() for path in shadows):
                shadows_gif(folder.file(GIF), shadows, motions[-1].held)
            report = sequence_report(
                reports,
                verdicts,
                [m.frame for m in made],
                motions,
                checks,
                None if ring is None else ring.spun,
                progress,
            )
            write_report_json(folder.file("report.json"), report)
            write_report_html(
                folder.file("report.html"), report, _pictures(folder, targets), "a sequence"
            )
        states = {c["status"] for c in report["checks"] if c["required"]}
        code = 1 if "fail" in states else 3 if "skipped" in states else 0
        if code == 0:
            folder.commit()
            return Outcome(0, report, request.out)
        folder.reject()
        return Outcome(code, report, request.out / "rejected")


def _ring(folder: OutputFolder, made: Sequence[Written], verifier: FrameVerifier) -> Ring:
    """The zoetrope, and the verdict to come on its written file."""
    try:
        spun = write_zoetrope(folder, [m.frame for m in made])
    except SceneError as error:
        return Ring(None, str(error), None)
    files = FrameFiles(folder.file(f"{ZOETROPE}.stl"))
    return Ring(spun, "", verifier.submit(files, PRINTER_CHECKS))


def _frame_report(
    request: SequenceRequest,
    made: Written,
    verdict: dict[str, Any],
    folder: OutputFolder,
    progress: Progress,
) -> dict[str, Any]:
    """The report of one frame, as that of a piece of its own."""
    own = Request(
        made.scene,
        made.scene.views[0].picture,
        request.out,
        printing=request.printing,
        device=request.device,
        skip=request.skip,
        command=request.command,
    )
    if made.part is not None:
        verdict["checks"].append(
            check_3mf(read_back_strict(folder.file(f"part-{made.number}.3mf")))
        )
    verdict["checks"] += [check_certificate(made.frame.made), check_limits(made.frame.made)]
    if not request.printing:
        for check in verdict["checks"]:
            if check["name"] in PRINTER_CHECKS and check["name"] not in request.skip:
                check["detail"] = "checked with --print"
    bodies = [] if made.part is None else made.part.bodies
    return report_of(own, made.frame.made, made.knots, bodies, verdict, progress)


def _motions(folder: OutputFolder, made: Sequence[Written]) -> list[Motion]:
    """The motion into each frame but the first, and at the end that back to it, from the written knots."""
    points, outlines = [], []
    for m in made:
        points.append(knot_in_scene(folder.file(f"knots-{m.number}.json"), m.scene))
        view = m.scene.views[0]
        target = read_target(folder.file(view.picture), invert=view.invert)
        outlines.append(silhouette_polygon(view, target))
    radius = made[0].frame.made.knots.radius_mm
    following = [*range(1, len(made)), 0]
    return [
        measure(points[k], points[n], outline_motion(outlines[k], outlines[n]), radius)
        for k, n in enumerate(following)
    ]


def _pictures(folder: OutputFolder, targets: Sequence[Target]) -> list[Picture]:
    found = []
    for target in targets:
        path = folder.file(f"compare-{target.name}.png")
        if path.is_file():
            caption = "target, shadow of the written file, and where they differ"
            found.append(Picture(path, "compare", caption, target.name))
    return found
