"""A sequence from its pictures to a folder: a verified part a frame, the moving shadow, a zoetrope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from knotfab.design.question import silhouette_polygon
from knotfab.errors import SceneError
from knotfab.files.folder import OutputFolder
from knotfab.files.threemf import read_back_strict
from knotfab.mount.prefetch import prefetch_modeller
from knotfab.progress import Progress
from knotfab.report.drawings import write_drawings
from knotfab.report.of_build import (
    add_fabrication,
    add_slicing,
    check_3mf,
    check_certificate,
    check_limits,
    report_of,
)
from knotfab.report.of_slicer import check_slicing
from knotfab.report.pictures import find_pictures
from knotfab.report.report_html import write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.request import Outcome, Request, require_device
from knotfab.scene.catalogue import resolve
from knotfab.sequence.chain import chain
from knotfab.sequence.frames import read_frames
from knotfab.sequence.gif import write_shadows_gif
from knotfab.sequence.motion import Motion, measure, outline_motion
from knotfab.sequence.report import (
    Ring,
    check_closing,
    check_motion,
    check_ring,
    sequence_report,
)
from knotfab.sequence.require import require_sequence
from knotfab.sequence.writing import ZOETROPE, Written, write_frame, write_scene, write_zoetrope
from knotfab.sequence.written import read_knot_in_scene
from knotfab.slicer.profile import write_profile
from knotfab.slicer.result import sum_slicings
from knotfab.slicer.run import SlicerQueue
from knotfab.target.read import Target, read_target
from knotfab.verify.checks import PRINTER_CHECKS, exit_code, explain_unprinted
from knotfab.verify.verifier import Files, Verifier

__all__ = ["GIF", "build_sequence"]

GIF = "sequence.gif"


def build_sequence(request: Request, progress: Progress | None = None) -> Outcome:
    """Search all frames as one moving knot, and write and verify each as a part of its own.

    Files: part-NN.stl, part-NN.3mf, knots-NN.json, scene-NN.toml, picture-frame-NN.*,
    shadow-frame-NN.png, compare-frame-NN.png, scene.toml, sequence.gif, report.json and report.html; to
    be printed, slicer.ini, zoetrope.stl and zoetrope.3mf as well; of wire, bends-NN.csv and its templates.
    With a mount each frame stands or hangs by itself, and has its own setup-NN.pdf and setup-NN.svg; the
    zoetrope has none. Frames are verified and sliced while later ones are searched. As with one picture,
    what fails a required check is written whole to DIR/rejected.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    require_device(request.device)
    require_sequence(request.scene)
    skip = request.skip | (set() if request.printing else set(PRINTER_CHECKS))
    if request.printing and request.scene.mount.kind != "none":
        prefetch_modeller()
    with OutputFolder(request.out) as folder:
        with progress.stage("pictures"):
            invert = request.scene.views[0].invert
            targets = request.targets or read_frames(
                request.pictures, invert=invert, base=request.base
            )
        if request.printing:
            write_profile(folder.work, resolve(request.scene))
        with Verifier(skip) as verifier, SlicerQueue() as slicer:
            left = request.search_budget_s(progress.total)
            frames = chain(request.scene, targets, request.device, progress, left)
            made = [
                write_frame(folder, frame, target, request, verifier, slicer, progress)
                for frame, target in zip(frames, targets, strict=True)
            ]
            write_scene(folder, request.scene, made[0].scene)
            with progress.stage("zoetrope"):
                ring = _make_ring(folder, made, verifier) if request.printing else None
            with progress.stage("verify"):
                verdicts = [m.verdict() for m in made]
                printed = [] if ring is None else check_ring(ring, made[0].scene.printer)
            with progress.stage("slicer"):
                sliced = {
                    f"part-{m.number}.3mf": m.sliced.result() for m in made if m.sliced is not None
                }
        for m, verdict in zip(made, verdicts, strict=True):
            verdict["checks"] += _own_checks(folder, m)
            if m.sliced is not None:
                verdict["checks"].append(check_slicing(m.sliced.result()))
            if not request.printing:
                explain_unprinted(verdict["checks"], request.skip)
        reports = [
            _report_frame(request, m, target, verdict, folder, progress)
            for m, target, verdict in zip(made, targets, verdicts, strict=True)
        ]
        with progress.stage("motion"):
            motions = _motions(folder, made)
        checks = [check_motion(motions[:-1]), check_closing(motions[-1]), *printed]
        with progress.stage("report"):
            shadows = [folder.file(f"shadow-{t.name}.png") for t in targets]
            if all(path.is_file() for path in shadows):
                write_shadows_gif(folder.file(GIF), shadows, motions[-1].held)
            report = sequence_report(
                reports,
                verdicts,
                [m.frame for m in made],
                motions,
                checks,
                None if ring is None else ring.spun,
                progress,
            )
            add_slicing(report, sum_slicings(sliced) if sliced else None, request.printing)
            write_report_json(folder.file("report.json"), report)
            write_report_html(
                folder.file("report.html"), report, find_pictures(folder.work), "a sequence"
            )
        code = exit_code(report["checks"])
        if code == 0:
            folder.commit()
            return Outcome(0, report, request.out)
        folder.reject()
        return Outcome(code, report, request.out / "rejected")


def _make_ring(folder: OutputFolder, made: Sequence[Written], verifier: Verifier) -> Ring:
    """The zoetrope, and the verdict to come on its written file."""
    try:
        spun = write_zoetrope(folder, [m.frame for m in made])
    except SceneError as error:
        return Ring(None, str(error), None)
    answer = verifier.submit(Files(folder.file(f"{ZOETROPE}.stl")), PRINTER_CHECKS)
    return Ring(spun, "", answer)


def _own_checks(folder: OutputFolder, made: Written) -> list[dict[str, Any]]:
    """What the maker itself knows of a frame."""
    checks = [check_certificate(made.frame.made), check_limits(made.frame.made)]
    if made.part is not None:
        warnings = read_back_strict(folder.file(f"part-{made.number}.3mf"))
        checks.insert(0, check_3mf(warnings))
        sag = made.part.mounted.check_sag()
        checks += [] if sag is None else [sag]
    return checks


def _report_frame(
    request: Request,
    made: Written,
    target: Target,
    verdict: dict[str, Any],
    folder: OutputFolder,
    progress: Progress,
) -> dict[str, Any]:
    """The report of one frame, as that of a piece of its own, and its drawings where it has a mount."""
    part, plan = made.part, None
    if made.scene.material.process == "wire":
        from knotfab.wire.plan import write_bending_plan

        with progress.stage("bending plan"):
            picture = folder.file(made.scene.views[0].picture)
            knots = made.frame.made.knots
            plan = write_bending_plan(
                folder.work, knots, made.scene, [picture], suffix=f"-{made.number}"
            )
            verdict["checks"] += plan.checks
    bodies = [] if part is None else part.bodies
    report = report_of(request, made.frame.made, made.knots, bodies, verdict, progress)
    if part is not None and (plan is not None or made.scene.mount.kind != "none"):
        add_fabrication(report, part.mounted, None, plan, request.printing)
    if part is not None and made.scene.mount.kind != "none":
        with progress.stage("drawings"):
            names = write_drawings(folder, part, made.scene, [target], verdict, f"-{made.number}")
        report["print"]["drawings"] = names
    return report


def _motions(folder: OutputFolder, made: Sequence[Written]) -> list[Motion]:
    """The motion into each frame but the first, and at the end that back to it, from the written knots."""
    points, outlines = [], []
    for m in made:
        points.append(read_knot_in_scene(folder.file(f"knots-{m.number}.json"), m.scene))
        view = m.frame.made.scene.views[0]
        target = read_target(folder.file(view.picture), invert=view.invert)
        outlines.append(silhouette_polygon(view, target))
    radius = made[0].frame.made.knots.radius_mm
    following = [*range(1, len(made)), 0]
    return [
        measure(points[k], points[n], outline_motion(outlines[k], outlines[n]), radius)
        for k, n in enumerate(following)
    ]
