"""The report on how a piece is laid on the bed: its pose, its plates, and what its supports need."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from knotfab.report.of_slicer import tell_flatter

if TYPE_CHECKING:
    from knotfab.part.access import Access
    from knotfab.part.assemble import Part
    from knotfab.part.flatter import Flattening

__all__ = ["add_posing", "find_access"]

_VIEWS_FLATTENED = 1  # with several views less depth of one is less width of another


def add_posing(
    report: dict[str, Any],
    part: Part,
    flattening: Flattening | None,
    suffix: str = "",
    *,
    printing: bool = False,
    access: Access | None = None,
) -> None:
    """Add `print.pose`, `print.plates` where there are any, and the notes that go with them.

    Args:
        suffix: suffix of the plates' files, such as "-01" of a sequence's frame.
        printing: it is printed: also what supports cost and whether they can be taken out.
        access: what `find_access` says of the part.
    """
    account = part.pose.account
    powder = part.mounted.scene.printer.process == "powder"
    by = "the volume of its box" if powder else "least height"
    if part.mounted.upright is not None:
        by = "the mount"
    pose: dict[str, Any] = {"chosen_by": by}
    pose["height_mm"] = round(float(part.pose.size_mm[2]), 2)
    pose["box_cm3"] = round(float(part.pose.size_mm.prod()) / 1000, 1)
    if account is not None:
        pose = account.to_dict()
    report["print"]["pose"] = pose
    notes: list[str] = report["notes"]
    if powder and printing:
        notes.append(
            "It is printed in powder, which carries it: no supports, and any pose will do. Its box of "
            f"{pose['box_cm3']:.0f} cm³ is what it takes of the powder bed."
        )
    if shrinkage := part.mounted.scene.material.shrinkage_percent:
        pose["shrinkage_percent"] = shrinkage
        larger = 100 / (1 - shrinkage / 100) - 100
        notes.append(
            f"All files are written {larger:.2f} % larger, for the material shrinks "
            f"by {shrinkage:g} %: switch off what your slicer or print service does about it."
        )
    if flattening is not None:
        pose["depth_mm"] = {
            "first": round(flattening.from_mm, 2),
            "kept": round(flattening.to_mm, 2),
            "proposed": flattening.proposed_mm,
        }
        if flattening.unheld:
            first, kept = flattening.wall_mm
            pose["wall_distance_mm"] = {"first": round(first, 2), "kept": round(kept, 2)}
            notes.append(
                f"At {first:.0f} mm from the wall, {flattening.from_mm:.0f} mm deep, {flattening.unheld}: "
                f"so it was rebuilt at {kept:.0f} mm, {flattening.to_mm:.0f} mm deep."
            )
        elif flattening.to_mm < flattening.from_mm:
            notes.append(
                f"Its depth was lowered from {flattening.from_mm:.0f} to {flattening.to_mm:.0f} mm, "
                "as no pose kept the printer's limit for supports."
            )
        if flattening.proposed_mm is not None:
            notes.append(
                "No pose keeps the printer's limit for supports: a depth of about "
                f"{flattening.proposed_mm:g} mm would (--depth {flattening.proposed_mm:g})."
            )
    if printing:
        _add_printing(report, part, suffix, access)
    if part.plates is None:
        return
    plates = part.plates.to_dict(suffix)
    report["print"]["plates"] = plates
    names, cuts = part.plates.files(suffix), sum(plates["cuts_of_knots"])
    joints = ""
    if cuts:
        joints = (
            f" {cuts} cuts are joined by pins of {plates['pin_diameter_mm'][0]:.1f} mm and more: "
            "a drop of glue each."
        )
    notes.append(
        f"The printer does not hold the whole piece: print {names[0]} to {names[-1]}; "
        f"part{suffix}.3mf shows how they go together.{joints}"
    )


def find_access(part: Part) -> Access | None:
    """Say whether the supports can be taken out; None without supports, or for a part cut into plates."""
    from knotfab.part.access import measure_access
    from knotfab.part.assemble import rules_of

    rules = rules_of(part.mounted.scene)
    wire = part.mounted.scene.material.process == "wire"
    if wire or part.plates is not None or not rules.supports or rules.powder:
        return None
    return measure_access(part.bodies, rules)


def _add_printing(report: dict[str, Any], part: Part, suffix: str, access: Access | None) -> None:
    """Add `print.support_access`, `print.flatter`, and the notes on what the supports are and cost."""
    from knotfab.mount.coupon import plan_coupon
    from knotfab.part.assemble import rules_of
    from knotfab.part.flatter import Printing, estimate_flatter

    scene, figures, notes = part.mounted.scene, report["print"], report["notes"]
    coupon = plan_coupon(part.mounted, suffix)
    if coupon is not None:
        figures["coupon"] = coupon.to_dict()
        notes.append(coupon.tell())
    if scene.material.process == "wire":
        return
    rules = rules_of(scene)
    if "time_s" in figures and part.pose.account is not None:
        sliced = Printing(
            1.0, figures["time_s"] / 3600, figures["filament_g"], figures["support_g"]
        )
        open_depth = part.plates is None and scene.piece.depth != "flat"
        if len(scene.views) == _VIEWS_FLATTENED and open_depth:
            knots = part.pose.knots.moved(part.pose.matrix)
            found = estimate_flatter(knots, sliced, rules)
            figures["flatter"] = [one.to_dict() for one in found]
            if not suffix:  # a frame's figures stand in the table
                notes.append(tell_flatter(figures["flatter"]))
    if access is not None:
        figures["support_access"] = access.to_dict()
        if access.worst is not None and not suffix:
            notes.append(access.tell())
