"""The main job: from a picture to a folder with a part that was verified after it was written."""

from __future__ import annotations

import tempfile
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.design.design import Design, design_knots
from knotfab.errors import MachineError, SceneError
from knotfab.files.folder import OutputFolder
from knotfab.files.threemf import read_back_strict
from knotfab.flatten import flattened
from knotfab.mount.prefetch import prefetch_modeller
from knotfab.part.assemble import Part, part_of, pose_of, write_part
from knotfab.part.pose import PrintPose
from knotfab.progress import Progress
from knotfab.report.drawings import write_drawings
from knotfab.report.of_bounds import add_bounds
from knotfab.report.of_build import (
    add_binding,
    add_fabrication,
    check_3mf,
    check_certificate,
    check_limits,
    check_part,
    report_of,
)
from knotfab.report.pictures import draw_part
from knotfab.report.posing import add_posing
from knotfab.report.report_html import Picture, write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.scene.load import dump_scene
from knotfab.scene.model import Scene
from knotfab.slicer.plates import PlateSlicing
from knotfab.slicer.report import slicer_check
from knotfab.slicer.run import Slicing
from knotfab.target.read import Target, read_targets
from knotfab.verify.verifier import Verifier

__all__ = ["PRINTER_CHECKS", "Outcome", "Request", "build", "require_device"]

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[np.int32]]

# The validators' checks that are of no concern to a piece that is not to be printed.
PRINTER_CHECKS = (
    *("build_volume", "feature", "gap", "overhang", "support_volume", "bridge"),
    *("floating", "islands", "standing"),
    *("plate_mesh", "plates", "plates_volume"),
)
_RESERVE_S = 5.0  # of a time budget, for what follows the search


@dataclass(frozen=True)
class Request:
    """What `knotfab build` was asked."""

    scene: Scene
    source: str  # the picture: a file, an SVG or text:…
    out: Path
    base: Path | None = None  # where a scene's relative picture lies
    printing: bool = False
    device: str = "cpu"
    skip: frozenset[str] = frozenset()
    time_budget_s: float | None = None
    command: str = ""
    more: tuple[str, ...] = ()  # the pictures of the second view and on
    targets: tuple[Target, ...] = ()  # the pictures of all views, where they have been read already


@dataclass(frozen=True)
class Outcome:
    """Exit code by the contract, the report, and the folder that was written."""

    exit_code: int
    report: dict[str, Any]
    folder: Path


def build(request: Request, progress: Progress | None = None) -> Outcome:
    """Search, sweep, mount, pose, write, verify, slice and report (contract: files in DIR).

    A piece that fails a required check is written whole to DIR/rejected and leaves an earlier good
    result as it was.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    require_device(request.device)
    with OutputFolder(request.out) as folder:
        with progress.stage("picture"):
            sources = (request.source, *request.more)
            inverts = [view.invert for view in request.scene.views]
            targets = list(request.targets or read_targets(sources, inverts, base=request.base))
            target = targets[0]
        with Verifier(graphics="shadow-render" not in request.skip) as verifier:
            left = None
            if request.time_budget_s is not None:
                left = max(1.0, request.time_budget_s - progress.total - _RESERVE_S)
            if len(targets) == 1 and request.printing and request.scene.mount.kind != "none":
                prefetch_modeller()
            made = design_knots(request.scene, targets, request.device, progress, left)
            if made.region_stl is not None and made.scene.region.file is not None:
                folder.write(made.scene.region.file, made.region_stl)
            try:
                part = part_of(made, request.printing, target, progress)
                flattening = None
                if len(targets) == 1:
                    made, part, flattening = flattened(request, target, made, part, progress)
            except SceneError as error:
                return _reject_unbuilt(folder, request, made, targets, progress, str(error))
            with progress.stage("part"):
                pose = pose_of(part.pose.matrix, part.plates)
                scene = part.mounted.scene.model_copy(update={"pose": pose})
                write_part(folder, part, scene, targets)
            with _slicing(folder, scene, request) as slicing:
                with progress.stage("verify"):
                    verdict, drawn = _verified(verifier, folder, part, scene, request)
                with progress.stage("slicer"):
                    sliced = None if slicing is None else slicing.result()
        verdict["checks"] += _own_checks(made, part, _read_back(folder))
        if sliced is not None:
            verdict["checks"].append(slicer_check(sliced))
        plan = None
        if scene.material.process == "wire":
            with progress.stage("bending plan"):
                from knotfab.wire.plan import write_bending_plan

                pictures = [folder.file(view.picture) for view in scene.views]
                plan = write_bending_plan(folder.work, made.knots, scene, pictures)
                verdict["checks"] += plan.checks
        if any(c["required"] and c["status"] == "fail" for c in verdict["checks"]):
            verdict["status"], verdict["exit_code"] = "fail", 1
        drawings: list[str] = []
        if request.printing:
            with progress.stage("drawings"):
                drawings = write_drawings(folder, part, scene, target, verdict)
        with progress.stage("report"):
            report = report_of(request, made, part.pose.knots, part.bodies, verdict, progress)
            add_fabrication(report, part.mounted, sliced, plan, request.printing)
            report["print"]["drawings"] = drawings
            add_binding(report, made)
            add_bounds(report, made)
            add_posing(report, part, flattening)
            write_report_json(folder.file("report.json"), report)
            write_report_html(
                folder.file("report.html"), report, _pictures(folder, drawn), target.name
            )
        code = int(verdict["exit_code"])
        if code == 0:
            folder.commit()
            return Outcome(0, report, request.out)
        folder.reject()
        return Outcome(code, report, request.out / "rejected")


def _slicing(
    folder: OutputFolder, scene: Scene, request: Request
) -> AbstractContextManager[Slicing | PlateSlicing | None]:
    """The slicer at work on the other core, where the part is to be printed."""
    if not request.printing or "slicer" in request.skip:
        return nullcontext()
    plates = _plate_files(folder)
    if plates:
        return PlateSlicing(plates, scene, Path(tempfile.gettempdir()))
    return Slicing(folder.file("part.3mf"), scene, Path(tempfile.gettempdir()))


def _plate_files(folder: OutputFolder) -> list[Path]:
    return sorted(folder.work.glob("plate-*.3mf"), key=lambda p: int(p.stem.split("-")[1]))


def _read_back(folder: OutputFolder) -> list[str]:
    """What lib3mf says of the files for the slicer, by name where there are several."""
    warnings = read_back_strict(folder.file("part.3mf"))
    for path in _plate_files(folder):
        warnings += [f"{path.name}: {warning}" for warning in read_back_strict(path)]
    return warnings


def _verified(
    verifier: Verifier, folder: OutputFolder, part: Part, scene: Scene, request: Request
) -> tuple[dict[str, Any], bool]:
    """The validators' verdict on the written files, and whether the part was drawn meanwhile."""
    skip = set(request.skip) | (set() if request.printing else set(PRINTER_CHECKS))
    verifier.begin(
        folder.file("part.stl"),
        folder.file("knots.json"),
        folder.file("scene.toml"),
        skip,
        folder.work,
        folder.file("failures.png"),
    )
    light = scene.views[0].light_distance_mm
    drawn = _draw(folder, part.bodies, part.pose, light, request.skip)
    verdict = verifier.verdict()
    if not request.printing:
        for check in verdict["checks"]:
            if check["name"] in PRINTER_CHECKS and check["name"] not in request.skip:
                check["detail"] = "checked with --print"
    return verdict, drawn


def _own_checks(made: Design, part: Part, warnings: list[str]) -> list[dict[str, Any]]:
    """What the maker itself knows: its certificate, its limits, the 3MF's reader, the mount's sag."""
    sag = part.mounted.check_sag()
    own = [check_3mf(warnings), check_certificate(made), check_limits(made)]
    return own if sag is None else [*own, sag]


def _reject_unbuilt(
    folder: OutputFolder,
    request: Request,
    made: Design,
    targets: list[Target],
    progress: Progress,
    why: str,
) -> Outcome:
    """Report knots about which no tube can be swept, or whose part fits no pose of the printer."""
    scene = made.scene.model_copy(update={"pose": pose_of(np.eye(4))})
    made.knots.write(folder.file("knots.json"))
    for view, target in zip(scene.views, targets, strict=True):
        folder.write(view.picture, target.png_bytes)
    folder.write("scene.toml", dump_scene(scene))
    verdict: dict[str, Any] = {
        "checks": [check_part(why), check_certificate(made), check_limits(made)],
        "views": [],
        "seconds": {},
    }
    report = report_of(request, made, made.knots, [], verdict, progress)
    add_binding(report, made)
    write_report_json(folder.file("report.json"), report)
    write_report_html(folder.file("report.html"), report, [], targets[0].name)
    folder.reject()
    return Outcome(1, report, request.out / "rejected")


def require_device(name: str) -> None:
    """Refuse a device that this machine has not.

    Raises:
        MachineError: torch finds none of that kind.
    """
    if name == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise MachineError(
            f"--device {name}",
            "torch finds no CUDA device here",
            "Use --device cpu, or install a torch with CUDA (knotfab doctor says what is here).",
        )


def _draw(
    folder: OutputFolder, bodies: list[Mesh], pose: PrintPose, light_mm: float, skip: frozenset[str]
) -> bool:
    """The part from several sides, for the report; decoration, so a lack of graphics is no error."""
    if "shadow-render" in skip:
        return False
    vertices = np.concatenate([v for v, _ in bodies])
    shift = np.cumsum([0] + [len(v) for v, _ in bodies[:-1]])
    faces = np.concatenate([f + s for (_, f), s in zip(bodies, shift, strict=True)])
    seen = vertices @ pose.matrix[:3, :3].T + pose.matrix[:3, 3]
    return draw_part(seen, faces, folder.file("part.png"), light_mm)


def _pictures(folder: OutputFolder, drawn: bool) -> list[Picture]:
    """The report's pictures that exist, with their captions."""
    found = []
    failures = folder.work / "failures.png"
    if failures.is_file():
        found.append(Picture(failures, "part", "where the part fails its checks"))
    for path in sorted(folder.work.glob("compare-*.png")):
        name = path.stem.removeprefix("compare-")
        found.append(
            Picture(
                path, "compare", "target, shadow of the written file, and where they differ", name
            )
        )
    if drawn:
        caption = "from the light, and turned by 30, 60 and 90 degrees"
        found.append(Picture(folder.file("part.png"), "part", caption))
    return found
