"""The main job: from a picture to a folder with a part that was verified after it was written."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab import __version__
from knotfab.design import Design, design
from knotfab.effects.penumbra import PENUMBRA
from knotfab.errors import MachineError, SceneError
from knotfab.knots import Knots
from knotfab.output import OutputFolder
from knotfab.part.pose import PrintPose, choose_pose
from knotfab.part.stl import write_stl
from knotfab.part.threemf import read_back_strict, write_3mf
from knotfab.progress import Progress
from knotfab.report.pictures import draw_part
from knotfab.report.report_html import Picture, write_report_html
from knotfab.report.report_json import assemble, write_report_json
from knotfab.scene.load import dump_scene
from knotfab.scene.model import Pose, Scene
from knotfab.sweep.tube import mesh_volume, sweep, tube_manifold
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
                )
                # the other core draws meanwhile
                drawn = _draw(folder, bodies, pose, scene.views[0].light_distance_mm, request.skip)
                warnings = read_back_strict(folder.file("part.3mf"))
                verdict = verifier.verdict()
        if not request.printing:
            for check in verdict["checks"]:
                if check["name"] == "build_volume":
                    check["detail"] = "checked with --print"
        verdict["checks"].append(_check_3mf(warnings))
        verdict["checks"] += [_check_certificate(made), _check_limits(made)]
        account = made.result.account
        if warnings or not account.certified or made.result.standing.violations:
            verdict["status"], verdict["exit_code"] = "fail", 1
        with progress.stage("report"):
            report = _report(request, made, pose.knots, bodies, verdict, progress)
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
        "checks": [_check_part(why), _check_certificate(made), _check_limits(made)],
        "views": [],
        "seconds": {},
    }
    report = _report(request, made, made.knots, [], verdict, progress)
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


def _check_3mf(warnings: list[str]) -> dict[str, Any]:
    return {
        "name": "3mf",
        "status": "fail" if warnings else "pass",
        "required": True,
        "measured": len(warnings),
        "limit": 0,
        "unit": "warnings",
        "detail": "; ".join(warnings)
        or "lib3mf reads part.3mf back in strict mode without a warning",
    }


def _check_certificate(made: Design) -> dict[str, Any]:
    """The maker's own proof of the knot type: every step of the search an isotopy."""
    a = made.result.account
    return {
        "name": "isotopy",
        "status": "pass" if a.certified else "fail",
        "required": True,
        "measured": round(a.least_margin_mm, 6),
        "limit": 0.0,
        "unit": "mm",
        "detail": f"the template is {a.template}; {a.accepted} steps and {a.resamplings} resamplings "
        f"were certified, {a.shortened} of them shortened; {a.refused} steps and "
        f"{a.resamplings_refused} resamplings were refused and not taken. Least margin between a step "
        "and a crossing is the measured value",
    }


def _check_part(why: str) -> dict[str, Any]:
    return {
        "name": "part",
        "status": "fail",
        "required": True,
        "measured": None,
        "limit": None,
        "unit": "",
        "detail": why,
    }


def _check_limits(made: Design) -> dict[str, Any]:
    """The search's own measure of its hard limits."""
    broken = made.result.standing.violations
    return {
        "name": "limits",
        "status": "fail" if broken else "pass",
        "required": True,
        "measured": len(broken),
        "limit": 0,
        "unit": "limits broken",
        "detail": "; ".join(broken)
        or "bend, clearance, region and length, as the search measured them",
    }


def _report(
    request: Request,
    made: Design,
    placed: Knots,
    bodies: list[Mesh],
    verdict: dict[str, Any],
    progress: Progress,
) -> dict[str, Any]:
    from knotfab.search.feasible import bend_radii
    from knotfab.search.polyline import rings_of_sizes
    from knotfab_validators.thickness import thickness

    scene, result = made.scene, made.result
    knots = []
    for knot in placed.knots:
        rings = rings_of_sizes((len(knot.points),))
        bend = float(bend_radii(knot.points, rings).min())
        knots.append(
            {
                "type": knot.type,
                "vertices": len(knot.points),
                "length_mm": knot.length_mm,
                "thickness_mm": thickness([knot.points]).value,
                "min_bend_radius_mm": bend,
            }
        )
    volume = sum(mesh_volume(v, f) for v, f in bodies)
    sized = None
    if bodies:
        sized = np.max([v.max(0) for v, _ in bodies], 0) - np.min([v.min(0) for v, _ in bodies], 0)
    effects = [d.to_dict() for d in result.effects.values()]
    for effect in effects:
        if effect["name"] == PENUMBRA.name:
            _penumbra_line(effect, verdict)
    depth = verdict["views"][0].get("depth_ratio") if verdict["views"] else None
    warnings = ["Nothing holds the knots: this piece has no mount yet."]
    if len(placed.knots) > 1:
        warnings.append(
            f"Its {len(placed.knots)} knots are loose pieces; the file keeps them in place."
        )
    return assemble(
        notes=warnings,
        views=verdict["views"],
        checks=verdict["checks"],
        effects=effects,
        timings={**progress.timings, "total": progress.total},
        knots=knots,
        print_={
            "volume_mm3": volume,
            "mass_g": volume * 1e-3 * scene.material.density_g_cm3,
            "bounding_box_mm": None if sized is None else sized.tolist(),
            "depth_ratio": depth,
            "printer": scene.printer.name,
        },
        settings={
            "accuracy": scene.accuracy.name,
            "seed": made.settings.seed,
            "command": request.command,
            "tube_radius_mm": made.knots.radius_mm,
            "tube_radius": _radius_note(made),
            "search": made.settings.model_dump(),
            "time_budget_s": request.time_budget_s,
            "device": request.device,
            "mount": "none",
            "opening_iou": made.opening_iou,
            "thickness_mm": thickness([k.points for k in placed.knots]).value,
            "certificate": result.account.__dict__,
            "versions": {
                "knotfab": __version__,
                "python": platform.python_version(),
                **{
                    n: version(n)
                    for n in ("torch", "numpy", "scipy", "shapely", "pyvista", "manifold3d")
                },
            },
        },
    )


def _penumbra_line(effect: dict[str, Any], verdict: dict[str, Any]) -> None:
    """What the verification, which simulates this effect, did and found."""
    found = verdict["views"][0].get("penumbra") if verdict["views"] else None
    if found is not None:
        effect.update(simulated=True, magnitude=found["widest_px"])
        effect["seconds"] = round(float(verdict["seconds"].get("penumbra", 0.0)), 4)
    elif effect["simulated"]:
        effect.update(
            simulated=False, reason="nothing was rendered, so the lamp was not averaged over"
        )


def _radius_note(made: Design) -> dict[str, Any]:
    """What the radius costs: every radius tried, with the IoU of its short search."""
    if made.radius is None:
        return {"chosen_by": "the scene", "trials": []}
    return {
        "chosen_by": "trying: the thickest whose short search comes near the best",
        "trials": [
            {
                "radius_mm": t.radius_mm,
                "template_iou": t.template_iou,
                "search_iou": None if np.isnan(t.trial_iou) else t.trial_iou,
            }
            for t in made.radius.trials
        ],
    }


def _pictures(folder: OutputFolder, drawn: bool) -> list[Picture]:
    """The report's pictures that exist, with their captions."""
    found = []
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
