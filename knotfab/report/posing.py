"""The report on how a piece is laid on the bed: its pose, its plates, and what its supports need."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knotfab.part.assemble import Part
    from knotfab.part.flatter import Flattening

__all__ = ["add_posing"]


def add_posing(
    report: dict[str, Any], part: Part, flattening: Flattening | None, suffix: str = ""
) -> None:
    """Add `print.pose`, `print.plates` where there are any, and the notes that go with them.

    Args:
        suffix: of the plates' files, such as "-01" of a sequence's frame.
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
    if powder:
        notes.append(
            "It is printed in powder, which carries it: no supports, and any pose will do. Its box of "
            f"{pose['box_cm3']:.0f} cm³ is what it takes of the powder bed."
        )
    if flattening is not None:
        pose["depth_mm"] = {
            "first": round(flattening.from_mm, 2),
            "kept": round(flattening.to_mm, 2),
            "proposed": flattening.proposed_mm,
        }
        if flattening.to_mm < flattening.from_mm:
            notes.append(
                f"Its depth was lowered from {flattening.from_mm:.0f} to {flattening.to_mm:.0f} mm, "
                "as no pose kept the printer's limit for supports."
            )
        if flattening.proposed_mm is not None:
            notes.append(
                "No pose keeps the printer's limit for supports: a depth of about "
                f"{flattening.proposed_mm:g} mm would (--depth {flattening.proposed_mm:g})."
            )
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
