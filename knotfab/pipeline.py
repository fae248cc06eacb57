"""The main job: from a picture to a folder with a part that was verified after it was written."""

from __future__ import annotations

from concurrent.futures import Future
from pathlib import Path
from typing import Any

from knotfab.design.design import Design, design_knots
from knotfab.errors import SceneError
from knotfab.files.folder import OutputFolder
from knotfab.files.threemf import read_back_strict
from knotfab.flatten import flatten
from knotfab.geometry.meshes import join_meshes
from knotfab.mount.prefetch import prefetch_modeller
from knotfab.part.assemble import Part, part_of
from knotfab.part.write import COLOURED, pose_scene, write_part, write_unbuilt
from knotfab.progress import Progress
from knotfab.report.drawings import write_drawings
from knotfab.report.of_bounds import add_bounds
from knotfab.report.of_build import (
    add_binding,
    add_fabrication,
    check_3mf,
    check_certificate,
    check_limits,
    report_of,
)
from knotfab.report.of_slicer import check_slicing
from knotfab.report.pictures import draw_part, find_pictures, place_eyes
from knotfab.report.posing import add_posing
from knotfab.report.report_html import write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.request import Outcome, Request, require_device
from knotfab.scene.model import ResolvedScene, Scene
from knotfab.slicer.profile import write_profile
from knotfab.slicer.result import NotSliced, Sliced, sum_slicings
from knotfab.slicer.run import SlicerQueue
from knotfab.target.read import Target, read_targets
from knotfab.verify.checks import PRINTER_CHECKS, exit_code, explain_unprinted, verdict_without_part
from knotfab.verify.verifier import Files, Verifier

__all__ = ["build", "run_build"]


def run_build(request: Request, progress: Progress | None = None) -> Outcome:
    """Build what was asked: a piece, or a sequence of them.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    if request.sequence:
        from knotfab.sequence.build import build_sequence

        return build_sequence(request, progress)
    return build(request, progress)


def build(request: Request, progress: Progress | None = None) -> Outcome:
    """Search, sweep, mount, pose, write, verify, slice and report (contract: files in DIR).

    A piece that fails a required check is written whole to DIR/rejected and leaves an earlier good
    result as it was.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    require_device(request.device)
    skip = request.skip | (set() if request.printing else set(PRINTER_CHECKS))
    with OutputFolder(request.out) as folder:
        with progress.stage("picture"):
            inverts = [view.invert for view in request.scene.views]
            targets = list(
                request.targets or read_targets(request.pictures, inverts, base=request.base)
            )
            target = targets[0]
        with Verifier(skip) as verifier, SlicerQueue() as slicer:
            left = request.search_budget_s(progress.total)
            if request.printing and request.scene.mount.kind != "none":
                prefetch_modeller()
            made = design_knots(request.scene, targets, request.device, progress, left)
            if made.region_stl is not None and made.scene.region.file is not None:
                folder.write(made.scene.region.file, made.region_stl)
            try:
                part = part_of(made, request.printing, targets, progress)
                flattening = None
                if len(targets) == 1:
                    made, part, flattening = flatten(request, target, made, part, progress)
            except SceneError as error:
                return _reject_unbuilt(folder, request, made, targets, progress, str(error))
            with progress.stage("part"):
                scene = pose_scene(part)
                write_part(folder, part, scene, targets, request.colours)
            slicings = _begin_slicing(folder, scene, request, slicer)
            with progress.stage("verify"):
                answer = verifier.submit(_written_files(folder))
                # decoration, so a lack of graphics is no error
                if "shadow-render" not in request.skip:
                    _draw(part, scene, folder.file("part.png"))
                verdict = answer.result()
            with progress.stage("slicer"):
                sliced = _end_slicing(slicings)
        if not request.printing:
            explain_unprinted(verdict["checks"], request.skip)
        verdict["checks"] += _own_checks(made, part, _read_back(folder))
        if sliced is not None:
            verdict["checks"].append(check_slicing(sliced))
        plan = None
        if scene.material.process == "wire":
            with progress.stage("bending plan"):
                from knotfab.wire.plan import write_bending_plan

                pictures = [folder.file(view.picture) for view in scene.views]
                plan = write_bending_plan(folder.work, made.knots, scene, pictures)
                verdict["checks"] += plan.checks
        drawings: list[str] = []
        if request.printing:
            with progress.stage("drawings"):
                drawings = write_drawings(folder, part, scene, targets, verdict)
        with progress.stage("report"):
            report = report_of(request, made, part.pose.knots, part.bodies, verdict, progress)
            add_fabrication(report, part.mounted, sliced, plan, request.printing)
            report["print"]["drawings"] = drawings
            add_binding(report, made)
            add_bounds(report, made)
            add_posing(report, part, flattening)
        return _finish(folder, request, report, targets)


def _finish(
    folder: OutputFolder, request: Request, report: dict[str, Any], targets: list[Target]
) -> Outcome:
    """Write the report, and move the whole to where its checks say that it belongs."""
    write_report_json(folder.file("report.json"), report)
    title = " and ".join(target.name for target in targets)
    write_report_html(folder.file("report.html"), report, find_pictures(folder.work), title)
    code = exit_code(report["checks"])
    if code == 0:
        folder.commit()
        return Outcome(0, report, request.out)
    folder.reject()
    return Outcome(code, report, request.out / "rejected")


def _begin_slicing(
    folder: OutputFolder, scene: Scene, request: Request, slicer: SlicerQueue
) -> dict[str, Future[Sliced | NotSliced]]:
    """The slicer at work on the other core, where the part is to be printed; by file."""
    if not request.printing:
        return {}
    write_profile(folder.work, scene)
    if "slicer" in request.skip:
        return {}
    files = _plate_files(folder) or [folder.file("part.3mf")]
    return {path.name: slicer.submit(path, scene) for path in files}


def _end_slicing(slicings: dict[str, Future[Sliced | NotSliced]]) -> Sliced | NotSliced | None:
    """What the slicer made of the files together, None where it was not asked."""
    found = {name: slicing.result() for name, slicing in slicings.items()}
    return sum_slicings(found) if found else None


def _plate_files(folder: OutputFolder) -> list[Path]:
    return sorted(folder.work.glob("plate-*.3mf"), key=lambda p: int(p.stem.split("-")[1]))


def _written_files(folder: OutputFolder) -> Files:
    part, knots, scene = (folder.file(n) for n in ("part.stl", "knots.json", "scene.toml"))
    return Files(part, knots, scene, folder.work, folder.file("failures.png"))


def _read_back(folder: OutputFolder) -> list[str]:
    """What lib3mf says of the files for the slicer, by name where there are several."""
    warnings = read_back_strict(folder.file("part.3mf"))
    for path in (*_plate_files(folder), *folder.work.glob(COLOURED)):
        warnings += [f"{path.name}: {warning}" for warning in read_back_strict(path)]
    return warnings


def _own_checks(made: Design, part: Part, warnings: list[str]) -> list[dict[str, Any]]:
    """What the maker itself knows: its certificate, its limits, the 3MF's reader, the mount's sag."""
    sag = part.mounted.check_sag()
    own = [check_3mf(warnings), check_certificate(made), check_limits(made)]
    return own if sag is None else [*own, sag]


def _draw(part: Part, scene: ResolvedScene, path: Path) -> None:
    vertices, faces = join_meshes(part.bodies)
    seen = vertices @ part.pose.matrix[:3, :3].T + part.pose.matrix[:3, 3]
    draw_part(seen, faces, path, place_eyes(scene.views))


def _reject_unbuilt(
    folder: OutputFolder,
    request: Request,
    made: Design,
    targets: list[Target],
    progress: Progress,
    why: str,
) -> Outcome:
    """Report knots about which no tube can be swept, or whose part fits no pose of the printer."""
    write_unbuilt(folder, made, targets)
    verdict = verdict_without_part(why)
    verdict["checks"] += [check_certificate(made), check_limits(made)]
    report = report_of(request, made, made.knots, [], verdict, progress)
    add_binding(report, made)
    return _finish(folder, request, report, targets)
