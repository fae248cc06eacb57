"""The main job: from a picture to a folder with a part that was verified after it was written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.design import Design, design
from knotfab.errors import MachineError, SceneError
from knotfab.output import OutputFolder
from knotfab.part.pose import PrintPose, choose_pose
from knotfab.part.stl import write_stl
from knotfab.part.threemf import read_back_strict, write_3mf
from knotfab.progress import Progress
from knotfab.report.of_build import (
    check_3mf,
    check_certificate,
    check_limits,
    check_part,
    report_of,
)
from knotfab.report.pictures import draw_part
from knotfab.report.report_html import Picture, write_report_html
from knotfab.report.report_json import write_report_json
from knotfab.scene.load import dump_scene
from knotfab.scene.model import Pose, Scene
from knotfab.sweep.tube import sweep, tube_manifold
from knotfab.target.read import Target, read_target
from knotfab.verify import Verifier

__all__ = ["Outcome", "Request", "build", "part_of"]

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[np.int32]]

_ANY_SIZE = (1e6, 1e6, 1e6)
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


@dataclass(frozen=True)
class Outcome:
    """Exit code by the contract, the report, and the folder that was written."""

    exit_code: int
    report: dict[str, Any]
    folder: Path


def build(request: Request, progress: Progress | None = None) -> Outcome:
    """Search, sweep, pose, write, verify and report (contract: files in DIR).

    A piece that fails a required check is written whole to DIR/rejected and leaves an earlier good
    result as it was.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    _require_device(request.device)
    with OutputFolder(request.out) as folder:
        with progress.stage("picture"):
            view = request.scene.views[0]
            target = read_target(request.source, invert=view.invert, base=request.base)
        with Verifier(graphics="shadow-render" not in request.skip) as verifier:
            left = None
            if request.time_budget_s is not None:
                left = max(1.0, request.time_budget_s - progress.total - _RESERVE_S)
            made = design(request.scene, target, request.device, progress, left)
            with progress.stage("part"):
                try:
                    bodies, pose = part_of(made, request.printing)
                except SceneError as error:
                    return _reject_unbuilt(folder, request, made, target, progress, str(error))
                scene = made.scene.model_copy(update={"pose": _pose(pose.matrix)})
                _write_part(folder, bodies, pose, scene, target)
            with progress.stage("verify"):
                skip = set(request.skip) | ({"build_volume"} if not request.printing else set())
                verifier.begin(
                    folder.file("part.stl"),
                    folder.file("knots.json"),
                    folder.file("scene.toml"),
                    skip,
                    folder.work,
                    folder.file("failures.png"),
                )
                # the other core draws meanwhile
                drawn = _draw(folder, bodies, pose, scene.views[0].light_distance_mm, request.skip)
                warnings = read_back_strict(folder.file("part.3mf"))
                verdict = verifier.verdict()
        if not request.printing:
            for check in verdict["checks"]:
                if check["name"] == "build_volume":
                    check["detail"] = "checked with --print"
        verdict["checks"].append(check_3mf(warnings))
        verdict["checks"] += [check_certificate(made), check_limits(made)]
        account = made.result.account
        if warnings or not account.certified or made.result.standing.violations:
            verdict["status"], verdict["exit_code"] = "fail", 1
        with progress.stage("report"):
            report = report_of(request, made, pose.knots, bodies, verdict, progress)
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


def _reject_unbuilt(
    folder: OutputFolder,
    request: Request,
    made: Design,
    target: Target,
    progress: Progress,
    why: str,
) -> Outcome:
    """Report knots about which no tube can be swept, or whose part fits no pose of the printer."""
    scene = made.scene.model_copy(update={"pose": _pose(np.eye(4))})
    made.knots.write(folder.file("knots.json"))
    folder.write(scene.views[0].picture, target.png_bytes)
    folder.write("scene.toml", dump_scene(scene))
    verdict: dict[str, Any] = {
        "checks": [check_part(why), check_certificate(made), check_limits(made)],
        "views": [],
        "seconds": {},
    }
    report = report_of(request, made, made.knots, [], verdict, progress)
    write_report_json(folder.file("report.json"), report)
    write_report_html(folder.file("report.html"), report, [], target.name)
    folder.reject()
    return Outcome(1, report, request.out / "rejected")


def _require_device(name: str) -> None:
    if name == "cpu":
        return
    import torch

    if not torch.cuda.is_available():
        raise MachineError(
            f"--device {name}",
            "torch finds no CUDA device here",
            "Use --device cpu, or install a torch with CUDA (knotfab doctor says what is here).",
        )


def part_of(made: Design, printing: bool) -> tuple[list[Mesh], PrintPose]:
    """One watertight tube per knot, in print pose.

    Raises:
        SceneError: the piece does not fit the printer.
    """
    radius = made.knots.radius_mm
    tubes = [sweep(k.points, radius, made.settings.mesh_sides) for k in made.knots.knots]
    for (vertices, faces), knot in zip(tubes, made.knots.knots, strict=True):
        tube_manifold(vertices, faces, np.pi * radius**2 * knot.length_mm)
    view = made.scene.views[0]
    assert view.frame_width_mm is not None and view.frame_height_mm is not None
    room = made.scene.printer.build_volume_mm if printing else _ANY_SIZE
    pose = choose_pose(made.knots, tubes, room, (view.frame_width_mm, view.frame_height_mm))
    return list(pose.tubes), pose


def _pose(matrix: Array) -> Pose:
    a, b, c, d = (tuple(float(x) for x in row) for row in matrix)
    return Pose(matrix=(a, b, c, d))


def _write_part(
    folder: OutputFolder, bodies: list[Mesh], pose: PrintPose, scene: Scene, target: Target
) -> None:
    write_stl(folder.file("part.stl"), bodies)
    write_3mf(folder.file("part.3mf"), bodies, title=f"knotfab {target.name}")
    pose.knots.write(folder.file("knots.json"))
    folder.write(scene.views[0].picture, target.png_bytes)
    folder.write("scene.toml", dump_scene(scene))


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
