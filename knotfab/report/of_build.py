"""A build's own checks, and the report put together from all findings."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab import __version__
from knotfab.base.progress import Progress
from knotfab.design.design import Design
from knotfab.geometry.meshes import Mesh, box_of
from knotfab.geometry.tube import mesh_volume
from knotfab.knots import Knots
from knotfab.picture.read import Target
from knotfab.report.of_bounds import list_views
from knotfab.report.of_effects import list_effects, list_limits
from knotfab.report.of_slicer import OPENING, print_figures, report_slicing
from knotfab.report.report_json import assemble
from knotfab.request import Request
from knotfab.scene.own_data import title_of
from knotfab.slicer.result import NotSliced, Sliced
from knotfab_validators.check import Check, at_most

if TYPE_CHECKING:
    from knotfab.mount.mount import Mounted
    from knotfab.wire.plan import WirePlan

__all__ = [
    "add_fabrication",
    "add_slicing",
    "check_3mf",
    "check_certificate",
    "check_limits",
    "report_of",
    "tell_binding",
]

Record = dict[str, Any]


def check_3mf(warnings: list[str]) -> Record:
    """`3mf`: what lib3mf's strict reader says of the files for the slicer."""
    good = "lib3mf reads part.3mf back in strict mode without a warning"
    detail = "; ".join(warnings) or good
    return at_most("3mf", len(warnings), 0, "warnings", detail).to_dict()


def check_certificate(made: Design) -> Record:
    """`isotopy`: the maker's own proof of the knot type: every step of the search an isotopy."""
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
    ).to_dict()


def check_limits(made: Design) -> Record:
    """`limits`: the search's own measure of them; failed too where they cost the picture its IoU."""
    broken = made.result.feasibility.violations
    detail = "; ".join(broken) or "bend, clearance, region and length, as the search measured them"
    floor = made.scene.accuracy.iou_floor
    if made.unmet is not None and not broken and made.result.iou_estimate < float(floor):
        broken = made.unmet.violations
        detail = "; ".join(broken) + " in the piece that draws the picture. This one keeps them all"
    return at_most("limits", len(broken), 0, "limits broken", detail).to_dict()


def tell_binding(made: Design) -> list[str]:
    """Say which limits keep the picture from its IoU, and what each costs, a sentence each."""
    if made.unmet is None and not made.binding:
        return []
    alone = "No limit alone is to blame: without any one of them the picture is drawn no better."
    return [price.sentence for price in made.binding] or [alone]


def report_of(
    request: Request,
    made: Design,
    placed: Knots,
    bodies: list[Mesh],
    verdict: Record,
    targets: Sequence[Target],
    progress: Progress,
) -> Record:
    """The report of a build: what was made, and what the validators' `verdict` says of its files.

    Args:
        placed: the knots as they are in their file; they are reported as they will have shrunk.
        targets: the pictures of all views.
    """
    from knotfab.geometry.measures import bend_radii, measure_curvature
    from knotfab.geometry.polylines import polylines_of_sizes
    from knotfab.part.assemble import shrink_of
    from knotfab_validators.tube.thickness import thickness

    scene, result = made.scene, made.result
    placed = placed.moved(shrink_of(scene))
    knots = []
    for knot in placed.knots:
        rings = polylines_of_sizes((len(knot.points),))
        bend = float(bend_radii(knot.points, rings).min())
        curved = measure_curvature(knot.points, placed.radius_mm)
        knots.append(
            {
                "type": knot.type,
                "vertices": len(knot.points),
                "length_mm": knot.length_mm,
                "thickness_mm": thickness([knot.points]).value,
                "min_bend_radius_mm": bend,
                "mean_curvature_radii": round(curved.mean, 4),
                "curvature_90_radii": round(curved.quantile_90, 4),
                "turns": round(curved.turns, 2),
            }
        )
    volume = sum(mesh_volume(v, f) for v, f in bodies)
    sized = None
    if bodies:
        low, high = box_of(bodies)
        sized = high - low
    ratios = [v["depth_ratio"] for v in verdict["views"] if v.get("depth_ratio") is not None]
    report = assemble(
        views=list_views(verdict["views"], made, targets),
        checks=verdict["checks"],
        effects=list_effects(result, verdict),
        limits=list_limits(result),
        timings={**progress.timings, "total": progress.total},
        knots=knots,
        print_={
            "volume_mm3": volume,
            "mass_g": volume * 1e-3 * scene.material.density_g_cm3,
            "bounding_box_mm": None if sized is None else sized.tolist(),
            "depth_ratio": min(ratios, default=None),  # the flattest view's
            "printer": scene.printer.name,
            "printer_title": title_of("printer", scene.printer.name),
        },
        colours=verdict.get("colours"),
        settings={
            "accuracy": scene.accuracy.name,
            "seed": made.settings.seed,
            "command": request.command,
            "preview": list(request.preview),
            "tube_radius_mm": made.knots.radius_mm,
            "tube_radius": _radius_note(made),
            "search": made.settings.model_dump(),
            "time_budget_s": request.time_budget_s,
            "device": request.device,
            "mount": "none",
            "opening_iou": made.opening_iou,
            **({"start_ious": list(made.start_ious)} if made.bounds else {}),
            "thickness_mm": thickness([k.points for k in placed.knots]).value,
            "certificate": result.log.__dict__,
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
    if made.unmet is not None or made.binding:
        report["binding"] = [price.to_dict() for price in made.binding]
    return report


def add_fabrication(
    report: Record,
    mounted: Mounted,
    sliced: Sliced | NotSliced | None,
    plan: WirePlan | None,
    printing: bool,
) -> None:
    """Add the mount, the slicer's reading and the bending plan to a report, and its notes."""
    mount = mounted.report()
    report["settings"]["mount"] = mount["kind"]
    report["print"]["mount"] = mount
    views = mounted.scene.views
    hangs = len(views) == 1 and views[0].wall_radius_mm == "flat"
    report["notes"] = _notes(len(report["knots"]), mount, hangs)
    add_slicing(report, sliced, printing and plan is None)
    if plan is not None:
        report["bending_plan"] = plan.to_dict()
        report["notes"].append(
            f"{plan.length_mm / 1000:.2f} m of wire, {plan.mass_g:.0f} g, in "
            f"{sum(k.bends for k in plan.knots)} bends: see bends*.csv and the templates."
        )


def add_slicing(report: Record, sliced: Sliced | NotSliced | None, printed: bool) -> None:
    """Add how to open the files where they are to be `printed`, and the slicer's reading."""
    if printed:
        report["print"]["opening"] = OPENING
    if printed and isinstance(sliced, NotSliced) and sliced.kind != "process":
        why = f"Hours and supports are not known: {sliced.reason}. {sliced.remedy}".strip()
        report.setdefault("notes", []).append(why)
    if sliced is not None:
        report["slicer"] = report_slicing(sliced)
        report["print"].update(print_figures(sliced))


def _notes(knots: int, mount: Record, hangs: bool) -> list[str]:
    """Collect the notes that a reader must not miss."""
    loose = f"Its {knots} knots are loose pieces; the file keeps them in place."
    if mount["kind"] == "none":
        without = "Nothing holds the knots: this piece has no mount"
        kind = "wall" if hangs else "stand"
        how = f"; --mount {kind} adds one."
        return [without + how, loose] if knots > 1 else [without + how]
    if mount.get("foot") == "dowel":
        each = " Each knot has its own." if knots > 1 else ""
        return [f"Its {mount['pegs']} pegs go into holes drilled in the wall.{each}"]
    return []


def _radius_note(made: Design) -> Record:
    """Tell the radius's cost: every radius tried, with the IoU of its template and of its start."""
    if made.radius is None:
        return {"chosen_by": "the scene", "trials": []}
    return {
        "chosen_by": "trying: the thickest whose template, or start, comes near the best",
        "trials": [
            {
                "radius_mm": t.radius_mm,
                "template_iou": t.template_iou,
                "start_iou": None if np.isnan(t.trial_iou) else t.trial_iou,
            }
            for t in made.radius.trials
        ],
    }
