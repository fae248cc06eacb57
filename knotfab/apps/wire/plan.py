"""Make the bending plan of a piece: fit the wire, write the files, read them back and judge them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotfab.apps.wire.arcs import BendList, Wire, list_bends
from knotfab.apps.wire.files import (
    draw_views,
    file_of_bender,
    fill_template,
    read_bends,
    write_bends,
    write_templates,
)
from knotfab.apps.wire.files import require_bender as require_bender
from knotfab.apps.wire.fit import fit_wires
from knotfab.apps.wire.judge import Judge, PieceShadow, cast_shadows, replay
from knotfab.apps.wire.residual import DEPTH_FACTOR, FitLimits, GridLikeness, Work
from knotfab.base.apps import VERSION
from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.knots import Knots
from knotfab.picture.opening import opening_iou, thickest_radius
from knotfab.picture.silhouette import trace_polygon
from knotfab.render.pages import PAPERS
from knotfab.report.report import WirePlan
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Material
from knotfab_formats.report import BendingPlan, BentWire
from knotfab_formats.scene import ResolvedView, SettledScene
from knotfab_formats.verdict import Check, list_unmet

TOLERANCE_RADII = 1.1  # wire radii that the wire may be off the knot, across the light's rays
ENOUGH_IOU = 0.95  # least IoU of the picture with what strands as thick as the wire can fill of it
LARGEST = 64.0  # times the frame's width: no wider frame is proposed
IOU_LOSS = 0.02  # IoU that straights and bends of one radius may cost
_FIT_SHARES = 0.97, 0.8, 0.65, 0.45  # shares of the tolerance to fit within, tried in turn
_SLEEVE_MM = 8.0  # length of a crimp or a soldered tube over both ends


def bend_radius_mm(material: Material) -> float:
    """Return the radius (mm) of the wire's centre line when bent about the bender's pin."""
    return material.tool_radius_mm + 0.5 * material.wire_diameter_mm


def write_bending_plan(
    folder: Path,
    knots: Knots,
    scene: SettledScene,
    pictures: Sequence[Path],
    suffix: str = "",
    ends: float = np.inf,
) -> WirePlan:
    """Write the bending plan and the templates of a wire piece, and judge the wire that these files give.

    One knot's plan is `bends.csv`; those of several are `bends-1.csv`, `bends-2.csv`, …. Each is also
    written for the scene's bender (`fill_template`). The templates are `bending-templates-a4.pdf` and
    `bending-templates-letter.pdf`.

    Args:
        knots: in scene coordinates.
        pictures: the file that each view's shadow is compared with.
        suffix: in the names of the files, such as "-01" for a frame of a sequence.
        ends: when the fit stops (`time.perf_counter()`), if it has not reached its own limit of work
            before. The best plan found until then is written.

    Raises:
        InputError: the material is not a wire, or its diameter is not the tube's.
        SceneError: no straights and bends of the tool's radius follow the knots.
    """
    material = scene.material
    _require_wire(material, knots.radius_mm)
    tolerance = TOLERANCE_RADII * knots.radius_mm
    shadows = cast_shadows(scene, pictures, knots)
    # with several views, what lies along the rays of one lies across those of another
    light = shadows[0].geometry.light if len(shadows) == 1 else None
    curves = [k.points for k in knots.knots]
    numbers = [""] if len(curves) == 1 else [f"-{k + 1}" for k in range(len(curves))]
    names = [f"bends{suffix}{number}.csv" for number in numbers]
    floor = max(0.0, scene.accuracy.iou_floor - IOU_LOSS)
    types = tuple(k.type for k in knots.knots)
    judge = Judge(curves, shadows, material, tolerance, floor, types)
    work = Work(ends=ends)
    rows, hidden = _fit(judge, names, light, work)
    tolerances = f"{tolerance:g} mm in any direction"
    if light is not None:
        along = f"{tolerance * DEPTH_FACTOR:g} mm along"
        tolerances = f"{tolerance:g} mm across the light's rays, {along}"
    total = sum(r.length_mm for r in rows)
    for name, row in zip(names, rows, strict=True):
        header = _write_header(name, row, material, total, tolerances)
        write_bends(folder / name, row, header)
    # from here on the plan is what the files say
    plans = [read_bends(folder / name) for name in names]
    bender = scene.piece.bender
    told = [file_of_bender(bender, name) for name in names]
    for name, plan, own in zip(names, plans, told, strict=True):
        text = fill_template(bender, plan.bends, name, material)
        (folder / own).write_text(text, encoding="utf-8", newline="")
    verdict = judge.bend_again(plans, names, hidden)
    facts = _list_facts(verdict.knots, material, tolerance)
    pages = _write_pages(folder, suffix, plans, shadows[0], material, facts)
    length = sum(k.length_mm for k in verdict.knots)
    frames = [measure_frame(s.mask, s.view, material) for s in shadows]
    frame = min(frames, key=lambda f: f.most_iou)
    checks = (*verdict.checks, frame.check(material))
    figures = BendingPlan(
        status="fail" if list_unmet(checks) else "pass",
        files=(*names, *told, *pages),
        length_mm=length,
        mass_g=_weigh(length, material),
        bends=sum(k.bends for k in verdict.knots),
        iou=min(verdict.ious.values()),
        iou_of_views=verdict.ious,
        least_distance_mm=verdict.least_distance_mm,
        tolerance_mm=tolerance,
        pages=pages,
        frame_width_mm=frame.width_mm,
        enough_frame_width_mm=frame.enough_mm,
        knots=verdict.knots,
    )
    return WirePlan(figures, checks, work.over)


def _require_wire(material: Material, radius_mm: float) -> None:
    if material.process != "wire" or material.wire_diameter_mm <= 0:
        raise InputError(
            f"material {material.name!r}",
            "it is no wire, so there is nothing to bend",
            "Name a wire, such as steel-wire-2mm, in [material].",
        )
    if abs(2 * radius_mm - material.wire_diameter_mm) > 1e-6:
        raise InputError(
            f"material {material.name!r}",
            f"it is {material.wire_diameter_mm:g} mm thick, but the tube is {2 * radius_mm:g} mm",
            f"Set tube_radius_mm = {0.5 * material.wire_diameter_mm:g}.",
        )


def _fit(
    judge: Judge, names: list[str], light: Array | None, work: Work
) -> tuple[list[BendList], list[bool]]:
    """Fit the wires within ever smaller tolerances until all checks pass.

    Returns:
        The plan of each wire in the best fit, and whether a sleeve over its joint is hidden.

    Raises:
        SceneError: bends overlap even in the best fit.
    """
    material, shadows = judge.material, judge.shadows
    likenesses = [GridLikeness.for_view(s.geometry, s.target, s.radius) for s in shadows]
    best: tuple[tuple[bool, int, float], list[BendList], list[bool]] | None = None
    for share in _FIT_SHARES:
        limits = FitLimits(
            bend_radius_mm(material),
            material.min_straight_mm,
            material.max_bend_deg,
            material.wire_diameter_mm,
            share * judge.tolerance,
            light,
            work,
        )
        wires = fit_wires(judge.curves, limits, likenesses)
        joints = [_choose_joint(wire, shadows) for wire in wires]
        rows = [
            list_bends(wire, cut, material.springback_percent)
            for wire, (cut, _) in zip(wires, joints, strict=True)
        ]
        hidden = [h for _, h in joints]
        tried = judge.bend_again(rows, names, hidden)
        failed = sum(check.status != "pass" for check in tried.checks)
        overlap = any(bend.feed_mm < 0 for row in rows for bend in row.bends)
        rank = (overlap, failed, -min(tried.ious.values()))
        if best is None or rank < best[0]:
            best = (rank, rows, hidden)
        if failed == 0 or work.over:
            break
    assert best is not None
    if best[0][0]:
        raise SceneError(
            "the bending plan",
            f"{f'it ended at {work.over}: ' if work.over else ''}two bends overlap in the best so far",
            "Give a smaller --size, whose wire is shorter."
            if work.over
            else "Give a larger --size, or a wire whose tool_radius_mm is smaller.",
        )
    return best[1:]


def _write_pages(
    folder: Path,
    suffix: str,
    plans: Sequence[BendList],
    shadow: PieceShadow,
    material: Material,
    facts: list[str],
) -> dict[str, int]:
    """Write the templates on each paper size. Returns the number of pages of each file."""
    lines = [replay(p) for p in plans]
    drawings = [
        d
        for k, (line, begins) in enumerate(lines)
        for d in draw_views(
            "wire" if len(lines) == 1 else f"wire {k + 1}",
            line,
            begins,
            shadow.geometry.right,
            shadow.geometry.up,
            material.wire_diameter_mm,
        )
    ]
    pages = {}
    for key, paper in PAPERS.items():
        path = folder / f"bending-templates-{key}{suffix}.pdf"
        pages[path.name] = write_templates(path, paper, drawings, facts)
    return pages


def _weigh(length_mm: float, material: Material) -> float:
    area = np.pi * (0.5 * material.wire_diameter_mm) ** 2
    return float(length_mm * area * 1e-3 * material.density_g_cm3)


def _choose_joint(wire: Wire, shadows: Sequence[PieceShadow]) -> tuple[int, bool]:
    """Choose the straight to cut in its middle, and return whether a sleeve over the joint is hidden.

    It is the longest straight on which all shadows hide a sleeve 1.5 times as thick as the wire, or else the
    longest of all.
    """
    following = np.roll(wire.entry, -1, axis=0)
    middle = 0.5 * (wire.exit + following)
    along = following - wire.exit
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    hidden = np.ones(len(middle), dtype=bool)
    for share in (-0.5, 0.0, 0.5):
        place = middle + share * _SLEEVE_MM * along
        for shadow in shadows:
            hidden &= shadow.hides(place) >= 1.5 * shadow.radius
    good = hidden & (wire.straight >= _SLEEVE_MM)
    if not good.any():
        longest = int(wire.straight.argmax())
        return longest, bool(good[longest])
    return int(np.where(good, wire.straight, -np.inf).argmax()), True


def _write_header(
    name: str, rows: BendList, material: Material, total: float, tolerances: str
) -> dict[str, str]:
    return {
        "made by": f"knotfab {VERSION}",
        "wire": f"{material.name}, {material.wire_diameter_mm:g} mm thick",
        "length": f"{rows.length_mm:.1f} mm for {name}, {total:.1f} mm for all",
        "bends": str(rows.count),
        "tool": f"pin of {material.tool_radius_mm:g} mm radius; radius_mm is the centre line's",
        "tolerance": tolerances,
        "springback": f"{material.springback_percent:g} % of the angle bent to",
        "how": "feed the straight, turn the wire about itself (clockwise as seen along the feed), "
        "bend to tool_angle_deg; distance_mm is where the bend begins, along the straight wire",
    }


def _list_facts(found: tuple[BentWire, ...], material: Material, tolerance: float) -> list[str]:
    length = sum(k.length_mm for k in found)
    lines = [
        f"{material.name}: {material.wire_diameter_mm:g} mm wire, {length:.0f} mm in all, "
        f"{sum(k.bends for k in found)} bends, {_weigh(length, material):.0f} g",
        f"Bend about a pin of {material.tool_radius_mm:g} mm radius; the wire springs back by "
        f"{material.springback_percent:g} %.",
        "",
    ]
    for k in found:
        lines += [
            f"{k.file}: {k.length_mm:.1f} mm, {k.bends} bends up to {k.largest_bend_deg:.0f} degrees, "
            f"shortest straight {k.shortest_straight_mm:.1f} mm.",
            f"    One degree of error in one bend moves the other end by up to "
            f"{k.end_moves_mm_per_deg:.1f} mm: lay the wire on the templates after every few bends.",
        ]
    lines += [
        "",
        "Front view: as the wire lies before you with the (first) light behind your head, without "
        "perspective.",
        "A number is a bend of the list; in brackets its height in mm above the lowest point of the wire.",
        "Side view: the same wire from its right; the light is at the left of the page.",
        "The blue square is the joint: both ends meet there in the middle of a straight.",
        "Pages of one view overlap by 10 mm: lay the crosses on each other.",
        f"The wire may be {tolerance:g} mm beside the line.",
    ]
    return lines


@dataclass(frozen=True)
class WireFrame:
    """How much of one view's picture a wire can draw in a frame `width_mm` wide.

    `most_iou` is the IoU of the picture and its morphological opening by the wire's shadow. `enough_mm` is
    the least width at which that reaches `ENOUGH_IOU`; None if there is none.
    """

    view: str
    width_mm: float
    most_iou: float
    enough_mm: float | None

    def check(self, material: Material) -> Check:
        """Check `wire_frame`, which is advice: the picture's own IoU floor decides."""
        from knotfab_validators.check import at_least

        wide = f"a frame {self.width_mm:g} mm wide"
        text = (
            f"IoU of the picture and what strands {material.wire_diameter_mm:g} mm thick can fill of "
            f"it in {wide} (view {self.view})"
        )
        if self.most_iou < ENOUGH_IOU:
            text += ": too small for this wire"
            if self.enough_mm is not None:
                text += f"; {self.enough_mm:.0f} mm and more would do"
        return at_least("wire_frame", self.most_iou, ENOUGH_IOU, "", text, required=False)


def measure_frame(mask: Mask, view: ResolvedView, material: Material) -> WireFrame:
    """Measure how much of the silhouette (H, W) strands as thick as the wire can fill at most.

    No strand fits into strokes thinner than the wire's shadow, so the opening of the silhouette by half of
    that is left. A wire in a frame s times as wide is relatively s times as thin.
    """
    polygon = trace_polygon(mask)
    shadow = 0.5 * material.wire_diameter_mm * view.px_per_mm(mask.shape[1])
    drawn = thickest_radius(polygon, ENOUGH_IOU, shadow / LARGEST, shadow * LARGEST)
    enough = None if drawn is None else view.frame_width_mm * shadow / drawn
    return WireFrame(view.name, view.frame_width_mm, opening_iou(polygon, shadow), enough)
