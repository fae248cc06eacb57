"""A build's own checks, and the report put together from all findings."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from knotfab.base.apps import VERSION
from knotfab.design.design import Design
from knotfab.geometry.tube import Mesh, box_of, mesh_volume
from knotfab.knots import Knots
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.report.effects import list_effects, list_limits
from knotfab.report.for_maker import report_slicing
from knotfab.request import Request
from knotfab.scene.catalogue import title_of
from knotfab_formats.errors import in_digits, plain
from knotfab_formats.libraries import list_parts
from knotfab_formats.piece import Piece
from knotfab_formats.print_figures import MountFigures, Print
from knotfab_formats.report import (
    Certificate,
    KnotFigures,
    NextStep,
    RadiusChoice,
    RadiusTrial,
    Report,
    Settings,
)
from knotfab_formats.search import PRESETS
from knotfab_formats.verdict import Check, Verdict, View, exit_code
from knotfab_validators.check import at_most
from knotfab_validators.shadows.verdict_rules import worst_verdict


def check_3mf(warnings: list[str]) -> Check:
    """Check `3mf`: what lib3mf's strict reader says of the files for the slicer."""
    good = "lib3mf reads part.3mf back in strict mode without a warning"
    detail = "; ".join(warnings) or good
    return at_most("3mf", len(warnings), 0, "warnings", detail)


def check_certificate(made: Design) -> Check:
    """Check `isotopy`: the search's own proof that every step it took was an isotopy."""
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
    """Check `limits`, as the search measured them, and whether keeping them cost the IoU."""
    broken = made.result.feasibility.violations
    detail = "; ".join(broken) or "bend, clearance, region and length, as the search measured them"
    floor = made.scene.accuracy.iou_floor
    if made.unmet is not None and not broken and made.result.iou_estimate < float(floor):
        broken = made.unmet.violations
        detail = "; ".join(broken) + " in the piece that draws the picture. This one keeps them all"
    return at_most("limits", len(broken), 0, "limits broken", detail)


def check_price(print_: Print, asked: Piece) -> list[Check]:
    """Check `hours` and `grams`, where a scene limits them: what the slicer says that the piece takes."""
    hours = None if print_.time_s is None else print_.time_s / 3600
    found = []
    for name, most, took in (
        ("hours", asked.max_hours, hours),
        ("grams", asked.max_grams, print_.filament_g),
    ):
        if most is not None and took is None:
            why = "no slicer has told what the piece takes"
            found.append(Check(name, "skipped", False, None, most, name, why))
        elif most is not None and took is not None:
            remedy = f"a smaller --size or --max-{name} {in_digits(took * 1.02, 3)} would do"
            found.append(at_most(name, took, most, name, remedy if took > most else ""))
    return found


def tell_binding(made: Design) -> list[str]:
    """Say which limits keep the picture from its IoU and what each costs, one sentence each."""
    if made.unmet is None and not made.binding:
        return []
    alone = "No limit alone is to blame: without any one of them the picture is drawn no better."
    return [price.sentence for price in made.binding] or [alone]


def print_of(made: Design, bodies: Sequence[Mesh], views: Sequence[View]) -> Print:
    """Measure a piece's volume, mass and box. Its mount, pose and slicing are filled in later."""
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
) -> Report:
    """Assemble the report of a build from what was made and the validators' `verdict` on its files.

    Args:
        placed: the knots as they are in their file; they are reported as they will have shrunk.
        checks: the validators', and the build's own. views: the validators', with what the build
            adds.
    """
    from knotfab.part.assemble import shrink_of

    placed = placed.moved(shrink_of(made.scene))
    bound = made.unmet is not None or made.binding
    return Report(
        status="fail" if exit_code(checks) else "pass",
        verdict=worst_verdict(views),
        views=tuple(views),
        checks=tuple(checks),
        effects=list_effects(made.result, verdict),
        limits=list_limits(made.result),
        knots=_list_knots(placed),
        print=print_,
        settings=_list_settings(request, made, placed, print_.mount),
        colours=verdict.colours,
        notes=tuple(notes),
        binding=made.binding if bound else None,
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


def _list_settings(
    request: Request, made: Design, placed: Knots, mount: MountFigures | None
) -> Settings:
    from knotfab_validators.tube.thickness import thickness

    parts = list_parts()
    versions = {"knotfab": VERSION, "python": platform.python_version()}
    for name in parts:
        with suppress(PackageNotFoundError):  # a copy beside its distribution, or a stand-in
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
        parts=parts,
    )


def _radius_choice(made: Design) -> RadiusChoice:
    """Say how the radius was chosen: all that were tried, with the IoU of their starts."""
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


# Where a build's time went, and what the next better accuracy would buy and cost.

_MEASURED = Path(__file__).with_name("next_step.json")
_SHARE = 0.07  # a shorter stage, as a share of the whole, is not worth a word
_WORK = (
    *("method", "coarse_px", "fine_px"),
    *("coarse_iterations", "fine_iterations", "settle_iterations"),
)


def plan_next_step(report: Report, timings: Mapping[str, float]) -> NextStep | None:
    """Estimate what the next better accuracy would bring, in IoU and seconds.

    The stages are taken to last as many times longer as they did on the pictures that were
    measured, and the error to shrink as it did there, for several views down to the bound of their
    visual hull. None under a time budget, for the best accuracy, and for a search with its own settings.
    """
    settings, views = report.settings, report.views
    # a stand outside the picture is not what a better search would draw better
    ious = [view.iou_drawn if view.iou_drawn is not None else view.iou_frame for view in views]
    if settings.time_budget_s is not None or not ious:
        return None
    study = _study()
    names = [step["accuracy"] for step in study["steps"]]
    if settings.accuracy not in names[:-1]:
        return None
    if not _as_preset(settings, len(views) if settings.sequence is None else 1):
        return None
    here = names.index(settings.accuracy)
    own, better = study["steps"][here], study["steps"][here + 1]
    # no search draws what other views forbid
    bound = views[ious.index(min(ious))].bound
    gain = max((1.0 if bound is None else bound) - min(ious), 0.0) * (
        1.0 - better["error"] / own["error"]
    )
    more = sum(
        timings.get(stage, 0.0) * (better["seconds"].get(stage, seconds) / seconds - 1.0)
        for stage, seconds in own["seconds"].items()
    )
    # the least IoU that a sentence can say
    bought = f"about {100 * gain:.1f}%" if gain > 5e-4 else "hardly"
    longer = f"in about {more:.0f} s more" if more >= 0.5 else "in about the same time"
    return NextStep(
        accuracy=better["accuracy"],
        iou_gain=gain,
        seconds_more=more,
        sentence=f"--accuracy {better['accuracy']} would come {bought} nearer to the picture {longer}.",
    )


def _as_preset(settings: Settings, views: int) -> bool:
    """Return whether a search had the iterations and pixels of its accuracy for this many views."""
    preset = PRESETS[settings.accuracy]
    preset = preset.scaled(views) if views > 1 else preset
    return all(getattr(settings.search, key) == getattr(preset, key) for key in _WORK)


def tell_stages(timings: Mapping[str, float]) -> str:
    """Say how many seconds a build took, and which stages took most of them."""
    total = timings["total"]
    most = sorted(((s, name) for name, s in timings.items() if name != "total"), reverse=True)
    stages = ", ".join(f"{name} {s:.1f}" for s, name in most if s > _SHARE * total)
    return f"{total:.1f} s" + (f": {stages}" if stages else "")


@cache
def _study() -> dict[str, Any]:
    """Read the measured mean error, 1 - IoU, and the seconds by stage of each accuracy."""
    found: dict[str, Any] = json.loads(_MEASURED.read_text("utf-8"))
    return found
