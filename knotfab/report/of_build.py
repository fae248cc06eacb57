"""A build's own checks, and the report put together from all findings."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from knotfab import __version__
from knotfab.design.design import Design
from knotfab.geometry.meshes import Mesh, box_of
from knotfab.geometry.tube import mesh_volume
from knotfab.knots import Knots
from knotfab.report.of_effects import limits_as_effects, list_effects, list_limits
from knotfab.report.of_slicer import report_slicing
from knotfab.request import Request
from knotfab.scene.own_data import title_of
from knotfab.slicer.result import NotSliced, Sliced
from knotfab_formats.records import plain
from knotfab_formats.report import (
    Certificate,
    KnotFigures,
    MountFigures,
    Print,
    RadiusChoice,
    RadiusTrial,
    Report,
    Settings,
)
from knotfab_formats.verdict import Check, Verdict, View, exit_code
from knotfab_validators.check import at_most
from knotfab_validators.shadows.recognition import worst_verdict

if TYPE_CHECKING:
    from knotfab.wire.plan import WirePlan

__all__ = [
    "check_3mf",
    "check_certificate",
    "check_limits",
    "print_of",
    "report_of",
    "tell_binding",
    "tell_mount",
    "tell_plan",
    "write_report_json",
]


def check_3mf(warnings: list[str]) -> Check:
    """Check `3mf`: what lib3mf's strict reader says of the files for the slicer."""
    good = "lib3mf reads part.3mf back in strict mode without a warning"
    detail = "; ".join(warnings) or good
    return at_most("3mf", len(warnings), 0, "warnings", detail)


def check_certificate(made: Design) -> Check:
    """Check `isotopy`: the maker's own proof of the knot type: every step of the search an isotopy."""
    a = made.result.log
    return Check(
        "isotopy",
        "pass" if a.certified else "fail",
        True,
        round(a.least_margin_mm, 6),
        0.0,
        "mm",
        f"the template is {a.template}; {a.accepted} steps and {a.resamplings} resamplings "
        f"were certified, {a.shortened} of them shortened; {a.refused} steps and "
        f"{a.resamplings_refused} resamplings were refused and not taken. Least margin between a step "
        "and a crossing is the measured value",
    )


def check_limits(made: Design) -> Check:
    """Check `limits`: the search's own measure of them; failed too where they cost the picture its IoU."""
    broken = made.result.feasibility.violations
    detail = "; ".join(broken) or "bend, clearance, region and length, as the search measured them"
    floor = made.scene.accuracy.iou_floor
    if made.unmet is not None and not broken and made.result.iou_estimate < float(floor):
        broken = made.unmet.violations
        detail = "; ".join(broken) + " in the piece that draws the picture. This one keeps them all"
    return at_most("limits", len(broken), 0, "limits broken", detail)


def tell_binding(made: Design) -> list[str]:
    """Say which limits keep the picture from its IoU, and what each costs, a sentence each."""
    if made.unmet is None and not made.binding:
        return []
    alone = "No limit alone is to blame: without any one of them the picture is drawn no better."
    return [price.sentence for price in made.binding] or [alone]


def print_of(made: Design, bodies: Sequence[Mesh], views: Sequence[View]) -> Print:
    """Return what is known of a piece before its mount, its pose and its slicing are told."""
    scene, volume = made.scene, sum(mesh_volume(v, f) for v, f in bodies)
    box = None
    if bodies:
        low, high = box_of(bodies)
        x, y, z = (high - low).tolist()
        box = (x, y, z)
    ratios = [view.depth_ratio for view in views if view.depth_ratio is not None]
    return Print(
        volume_mm3=volume,
        mass_g=volume * 1e-3 * scene.material.density_g_cm3,
        bounding_box_mm=box,
        depth_ratio=min(ratios, default=None),  # as the flattest view sees it
        printer=scene.printer.name,
        printer_title=title_of("printer", scene.printer.name),
    )


def report_of(
    request: Request,
    made: Design,
    placed: Knots,
    verdict: Verdict,
    checks: Sequence[Check],
    views: Sequence[View],
    print_: Print,
    notes: Sequence[str],
    sliced: Sliced | NotSliced | None = None,
    plan: WirePlan | None = None,
) -> Report:
    """Return the report of a build: what was made, and what the validators' `verdict` says of its files.

    Args:
        placed: the knots as they are in their file; they are reported as they will have shrunk.
        checks: the validators', and the build's own. views: the validators', with what the build adds.
    """
    from knotfab.part.assemble import shrink_of

    placed = placed.moved(shrink_of(made.scene))
    limits = list_limits(made.result)
    bound = made.unmet is not None or made.binding
    return Report(
        status="fail" if exit_code(checks) else "pass",
        verdict=worst_verdict(views),
        views=tuple(views),
        checks=tuple(checks),
        effects=(*list_effects(made.result, verdict), *limits_as_effects(limits)),
        limits=limits,
        knots=_list_knots(placed),
        print=print_,
        settings=_settings(request, made, placed, print_.mount),
        colours=verdict.colours,
        notes=tuple(notes),
        binding=made.binding if bound else None,
        bending_plan=None if plan is None else plan.figures,
        slicer=None if sliced is None else report_slicing(sliced),
    )


def _list_knots(placed: Knots) -> tuple[KnotFigures, ...]:
    from knotfab.geometry.measures import bend_radii, measure_curvature
    from knotfab.geometry.polylines import polylines_of_sizes
    from knotfab_validators.tube.thickness import thickness

    found = []
    for knot in placed.knots:
        rings = polylines_of_sizes((len(knot.points),))
        curved = measure_curvature(knot.points, placed.radius_mm)
        found.append(
            KnotFigures(
                type=knot.type,
                vertices=len(knot.points),
                length_mm=knot.length_mm,
                thickness_mm=thickness([knot.points]).value,
                min_bend_radius_mm=float(bend_radii(knot.points, rings).min()),
                mean_curvature_radii=round(curved.mean, 4),
                curvature_90_radii=round(curved.quantile_90, 4),
                turns=round(curved.turns, 2),
            )
        )
    return tuple(found)


def _settings(
    request: Request, made: Design, placed: Knots, mount: MountFigures | None
) -> Settings:
    from knotfab_validators.tube.thickness import thickness

    versions = {"knotfab": __version__, "python": platform.python_version()}
    for name in ("torch", "numpy", "scipy", "shapely", "pyvista", "manifold3d"):
        with suppress(PackageNotFoundError):  # torch is an extra
            versions[name] = version(name)
    return Settings(
        accuracy=made.scene.accuracy.name,
        seed=made.settings.seed,
        command=request.command,
        preview=request.preview,
        tube_radius_mm=made.knots.radius_mm,
        tube_radius=_radius_choice(made),
        search=made.settings,
        time_budget_s=request.time_budget_s,
        device=request.device,
        mount="none" if mount is None else mount.kind,
        opening_iou=made.opening_iou,
        start_ious=tuple(made.start_ious) if made.bounds else None,
        thickness_mm=thickness([k.points for k in placed.knots]).value,
        certificate=Certificate(**vars(made.result.log)),
        versions=versions,
    )


def _radius_choice(made: Design) -> RadiusChoice:
    """Tell the radius's cost: every radius tried, with the IoU of its template and of its start."""
    if made.radius is None:
        return RadiusChoice(chosen_by="the scene", trials=())
    return RadiusChoice(
        chosen_by="trying: the thickest whose template, or start, comes near the best",
        trials=tuple(
            RadiusTrial(radius_mm=t.radius_mm, template_iou=t.template_iou, start_iou=t.trial_iou)
            for t in made.radius.trials
        ),
    )


def write_report_json(path: Path, report: Report) -> None:
    """Write `report` as UTF-8 JSON that any parser reads: no NaN, no infinity."""
    text = json.dumps(plain(report), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def tell_plan(plan: WirePlan | None) -> list[str]:
    """Return how much wire a bending plan takes, where there is one."""
    if plan is None:
        return []
    cut = (
        f"The plan of its bends ended at {plan.cut}, and what is written is the best until then. A shorter "
        "wire (a smaller --size) is planned sooner."
    )
    return [
        f"{plan.length_mm / 1000:.2f} m of wire, {plan.mass_g:.0f} g, in "
        f"{sum(k.bends for k in plan.knots)} bends: see bends*.csv and the templates.",
        *([cut] if plan.cut else ()),
    ]


def tell_mount(knots: int, mount: MountFigures, hangs: bool) -> list[str]:
    """Return what a reader must not miss of a mount, or of a piece without one.

    Args:
        knots: how many. hangs: a wall mount could hold the piece.
    """
    loose = f"Its {knots} knots are loose pieces; the file keeps them in place."
    if mount.kind == "none":
        without = "Nothing holds the knots: this piece has no mount"
        kind = "wall" if hangs else "stand"
        how = f"; --mount {kind} adds one."
        return [without + how, loose] if knots > 1 else [without + how]
    if mount.foot == "dowel":
        each = " Each knot has its own." if knots > 1 else ""
        return [f"Its {mount.pegs} pegs go into holes drilled in the wall.{each}"]
    return []
