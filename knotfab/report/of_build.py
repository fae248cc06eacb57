"""What a build says of itself: its own checks, and the report put together from all that was found."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotfab import __version__
from knotfab.design import Design
from knotfab.effects.penumbra import PENUMBRA
from knotfab.knots import Knots
from knotfab.progress import Progress
from knotfab.report.report_json import assemble
from knotfab.sweep.tube import mesh_volume

if TYPE_CHECKING:
    from knotfab.build import Request

__all__ = ["check_3mf", "check_certificate", "check_limits", "check_part", "report_of"]

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def check_3mf(warnings: list[str]) -> dict[str, Any]:
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


def check_certificate(made: Design) -> dict[str, Any]:
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


def check_part(why: str) -> dict[str, Any]:
    return {
        "name": "part",
        "status": "fail",
        "required": True,
        "measured": None,
        "limit": None,
        "unit": "",
        "detail": why,
    }


def check_limits(made: Design) -> dict[str, Any]:
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


def report_of(
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
