"""A sequence from its pictures to a folder: a verified part a frame, the moving shadow, a zoetrope."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from knotfab.build import PRINTER_CHECKS, Outcome, Request
from knotfab.design import Design, problem_of
from knotfab.errors import InputError, SceneError
from knotfab.output import OutputFolder
from knotfab.part.assemble import Part, part_of, pose_of
from knotfab.part.clean import as_written
from knotfab.part.stl import write_stl
from knotfab.part.threemf import read_back_strict, write_3mf
from knotfab.progress import Progress
from knotfab.report.of_build import check_3mf, check_certificate, check_limits, report_of
from knotfab.report.report_html import Picture, write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.scene.load import dump_scene
from knotfab.scene.model import Scene
from knotfab.sequence.chain import Frame, chain
from knotfab.sequence.frames import read_frames
from knotfab.sequence.gif import shadows_gif
from knotfab.sequence.motion import Motion, measure, outline_motion
from knotfab.sequence.report import check_closing, check_motion, check_zoetrope, sequence_report
from knotfab.sequence.verifying import FrameFiles, FrameVerifier
from knotfab.sequence.written import knot_in_scene
from knotfab.sequence.zoetrope import Zoetrope, zoetrope
from knotfab.target.read import Target, read_target

__all__ = ["SequenceRequest", "build_sequence"]

GIF = "sequence.gif"
ZOETROPE = "zoetrope"


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


@dataclass
class _Made:
    """One frame as it was written, and its verdict to come."""

    frame: Frame
    part: Part
    scene: Scene
    answer: Future[dict[str, Any]]


def build_sequence(request: SequenceRequest, progress: Progress | None = None) -> Outcome:
    """Search all frames as one moving knot, and write and verify each as a part of its own.

    Files: part-NN.stl, part-NN.3mf, knots-NN.json, scene-NN.toml, picture-frame-NN.*,
    shadow-frame-NN.png, compare-frame-NN.png, sequence.gif, report.json and report.html; to be printed,
    zoetrope.stl and zoetrope.3mf as well. Frames are verified while later ones are searched.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    if request.scene.mount.kind != "none":
        raise InputError(
            f"--mount {request.scene.mount.kind}",
            "the frames of a sequence have no mounts",
            "Leave it out: the zoetrope holds them",
        )
    skip = set(request.skip) | (set() if request.printing else set(PRINTER_CHECKS))
    with OutputFolder(request.out) as folder:
        with progress.stage("pictures"):
            view = request.scene.views[0]
            targets = read_frames(request.sources, invert=view.invert, base=request.base)
        with FrameVerifier(skip) as verifier:
            made = []
            for frame, target in zip(
                chain(request.scene, targets, request.device, progress), targets, strict=True
            ):
                part = part_of(frame.made, request.printing, target, progress)
                if part.plates is not None:
                    raise SceneError(
                        f"{target.name}",
                        f"{request.scene.printer.name} prints it in several pieces only",
                        "Use a smaller frame (scene key frame_width_mm), or another printer",
                    )
                with progress.stage("part"):
                    scene, files = _write_frame(folder, frame.made, part, target)
                made.append(_Made(frame, part, scene, verifier.submit(files)))
            with progress.stage("zoetrope"):
                spun = _zoetrope(folder, made) if request.printing else None
            with progress.stage("verify"):
                verdicts = [m.answer.result() for m in made]
        reports = [
            _frame_report(request, m, v, folder, progress)
            for m, v in zip(made, verdicts, strict=True)
        ]
        with progress.stage("motion"):
            motions = _motions(folder, made)
        cyclic = motions[-1].held
        checks = [check_motion(motions[:-1]), check_closing(motions[-1])]
        if spun is not None:
            checks.append(check_zoetrope(spun, made[0].scene.printer))
        with progress.stage("report"):
            shadows = [folder.file(f"shadow-{t.name}.png") for t in targets]
            if all(path.is_file() for path in shadows):
                shadows_gif(folder.file(GIF), shadows, cyclic)
            report = sequence_report(
                reports, verdicts, [m.frame for m in made], motions, checks, spun, progress
            )
            write_report_json(folder.file("report.json"), report)
            write_report_html(
                folder.file("report.html"), report, _pictures(folder, targets), "a sequence"
            )
        codes = [int(v["exit_code"]) for v in verdicts]
        code = 1 if report["status"] == "fail" else 0
        if 3 in codes and 1 not in codes:
            code = 3
        if code == 0:
            folder.commit()
            return Outcome(0, report, request.out)
        folder.reject()
        return Outcome(code, report, request.out / "rejected")


def _write_frame(
    folder: OutputFolder, made: Design, part: Part, target: Target
) -> tuple[Scene, FrameFiles]:
    """Write one frame's part, knots, scene and picture; `scene` has its pose."""
    number = target.name.removeprefix("frame-")
    scene = part.mounted.scene.model_copy(update={"pose": pose_of(part.pose.matrix)})
    write_stl(folder.file(f"part-{number}.stl"), part.bodies)
    write_3mf(
        folder.file(f"part-{number}.3mf"),
        part.bodies,
        part.mounted.names,
        title=f"knotfab {target.name}",
        colors=[scene.material.color] * len(part.bodies),
    )
    part.pose.knots.write(folder.file(f"knots-{number}.json"))
    folder.write(scene.views[0].picture, target.png_bytes)
    folder.write(f"scene-{number}.toml", dump_scene(scene))
    if made.region_stl is not None and made.scene.region.file is not None:
        folder.write(made.scene.region.file, made.region_stl)
    files = FrameFiles(
        folder.file(f"part-{number}.stl"),
        folder.file(f"knots-{number}.json"),
        folder.file(f"scene-{number}.toml"),
        folder.work,
    )
    return scene, files


def _zoetrope(folder: OutputFolder, made: Sequence[_Made]) -> Zoetrope:
    """All frames on one ring, written as STL and 3MF."""
    scene = made[0].scene
    spun = zoetrope([m.frame.made.knots for m in made], scene.printer.build_volume_mm)
    spun = replace(spun, mesh=as_written(spun.mesh))
    write_stl(folder.file(f"{ZOETROPE}.stl"), [spun.mesh])
    write_3mf(
        folder.file(f"{ZOETROPE}.3mf"),
        [spun.mesh],
        [ZOETROPE],
        title="knotfab zoetrope",
        colors=[scene.material.color],
    )
    return spun


def _frame_report(
    request: SequenceRequest,
    made: _Made,
    verdict: dict[str, Any],
    folder: OutputFolder,
    progress: Progress,
) -> dict[str, Any]:
    """The report of one frame, as that of a piece of its own."""
    number = made.scene.views[0].name.removeprefix("frame-")
    own = Request(
        made.scene,
        made.scene.views[0].picture,
        request.out,
        printing=request.printing,
        device=request.device,
        skip=request.skip,
        command=request.command,
    )
    warnings = read_back_strict(folder.file(f"part-{number}.3mf"))
    verdict["checks"] += [
        check_3mf(warnings),
        check_certificate(made.frame.made),
        check_limits(made.frame.made),
    ]
    if not request.printing:
        for check in verdict["checks"]:
            if check["name"] in PRINTER_CHECKS and check["name"] not in request.skip:
                check["detail"] = "checked with --print"
    placed = made.part.pose.knots
    return report_of(own, made.frame.made, placed, made.part.bodies, verdict, progress)


def _motions(folder: OutputFolder, made: Sequence[_Made]) -> list[Motion]:
    """The motion into each frame but the first, and at the end that back to it, from the written knots."""
    points, outlines = [], []
    for m in made:
        name = m.scene.views[0].name
        points.append(
            knot_in_scene(folder.file(f"knots-{name.removeprefix('frame-')}.json"), m.scene)
        )
        target = read_target(folder.file(m.scene.views[0].picture), invert=m.scene.views[0].invert)
        outlines.append(problem_of(m.scene, target).polygon)
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
