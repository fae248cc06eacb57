"""The report on how a piece is laid on the bed: its pose, its plates, and what its supports need."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from knotfab.report.of_slicer import tell_flatter
from knotfab_formats.report import Flatter, Kept, PoseFigures, Print, SupportAccess

if TYPE_CHECKING:
    from knotfab.part.assemble import Part
    from knotfab.part.flatter import Flattening

__all__ = ["find_access", "lay_out"]


def lay_out(
    print_: Print,
    part: Part,
    flattening: Flattening | None,
    suffix: str = "",
    *,
    printing: bool = False,
    access: SupportAccess | None = None,
) -> tuple[Print, list[str]]:
    """Return the figures of a piece with its pose, plates if there are any, and supports; and notes on these.

    Args:
        suffix: suffix of the plates' files, such as "-01" of a sequence's frame.
        printing: it is printed: also what supports cost and whether they can be taken out.
        access: what `find_access` says of the part.
    """
    pose = _pose_figures(part, flattening)
    scene, notes = part.mounted.scene, list[str]()
    if printing and pose.box_cm3 is not None and scene.printer.process == "powder":
        notes.append(
            "It is printed in powder, which carries it: no supports, and any pose will do. Its box of "
            f"{pose.box_cm3:.0f} cm³ is what it takes of the powder bed."
        )
    if (shrinkage := pose.shrinkage_percent) is not None:
        larger = 100 / (1 - shrinkage / 100) - 100
        notes.append(
            f"All files are written {larger:.2f} % larger, for the material shrinks "
            f"by {shrinkage:g} %: switch off what your slicer or print service does about it."
        )
    notes += _tell_flattening(flattening)
    if printing:
        print_, told = _with_supports(print_, part, suffix, access)
        notes += told
    plates = None if part.plates is None else part.plates.figures(suffix)
    if part.plates is not None and plates is not None:
        names, cuts = part.plates.files(suffix), sum(plates.cuts_of_knots)
        joints = ""
        if plates.pin_diameter_mm is not None:
            joints = (
                f" {cuts} cuts are joined by pins of {plates.pin_diameter_mm[0]:.1f} mm and more: "
                "a drop of glue each."
            )
        notes.append(
            f"The printer does not hold the whole piece: print {names[0]} to {names[-1]}; "
            f"part{suffix}.3mf shows how they go together.{joints}"
        )
    return replace(print_, pose=pose, plates=plates), notes


def _pose_figures(part: Part, flattening: Flattening | None) -> PoseFigures:
    """Return how the piece lies, why, and what it was before it was made flatter."""
    account, powder = part.pose.account, part.mounted.scene.printer.process == "powder"
    if account is not None:
        pose = account.figures()
    else:
        by = "the volume of its box" if powder else "least height"
        pose = PoseFigures(
            chosen_by="the mount" if part.mounted.upright is not None else by,
            height_mm=round(float(part.pose.size_mm[2]), 2),
            box_cm3=round(float(part.pose.size_mm.prod()) / 1000, 1),
        )
    depth = distance = None
    if flattening is not None:
        first, kept = round(flattening.from_mm, 2), round(flattening.to_mm, 2)
        depth = Kept(first, kept, flattening.proposed_mm)
        if flattening.unheld:
            distance = Kept(round(flattening.wall_mm[0], 2), round(flattening.wall_mm[1], 2))
    return replace(
        pose,
        shrinkage_percent=part.mounted.scene.material.shrinkage_percent or None,
        depth_mm=depth,
        wall_distance_mm=distance,
    )


def _tell_flattening(flattening: Flattening | None) -> list[str]:
    """Tell that a piece was built anew, nearer to the wall or flatter, or would have to be."""
    if flattening is None:
        return []
    notes = []
    if flattening.unheld:
        first, kept = flattening.wall_mm
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
    return notes


def find_access(part: Part) -> SupportAccess | None:
    """Say whether the supports can be taken out; None without supports, or for a part cut into plates."""
    from knotfab.part.access import measure_access
    from knotfab.part.assemble import rules_of

    rules = rules_of(part.mounted.scene)
    wire = part.mounted.scene.material.process == "wire"
    if wire or part.plates is not None or not rules.supports or rules.powder:
        return None
    return measure_access(part.bodies, rules)


def _with_supports(
    print_: Print, part: Part, suffix: str, access: SupportAccess | None
) -> tuple[Print, list[str]]:
    """Return the figures with a coupon, flatter pieces and what supports need; and notes on these."""
    from knotfab.mount.coupon import plan_coupon
    from knotfab.part.access import tell_access
    from knotfab.part.assemble import rules_of
    from knotfab.part.flatter import estimate_flatter

    scene, notes, flatter = part.mounted.scene, list[str](), None
    coupon = plan_coupon(part.mounted, suffix)
    if coupon is not None:
        print_ = replace(print_, coupon=coupon.figures)
        notes.append(coupon.tell())
    if scene.material.process == "wire":
        return print_, notes
    seconds, grams, supports = print_.time_s, print_.filament_g, print_.support_g
    tall = part.pose.account is not None and part.plates is None and scene.piece.depth != 0
    # with several views less depth of one is less width of another
    if tall and len(scene.views) == 1 and seconds and grams and supports is not None:
        sliced = Flatter(1.0, seconds / 3600, grams, supports)
        knots = part.pose.knots.moved(part.pose.matrix)
        flatter = tuple(estimate_flatter(knots, sliced, rules_of(scene)))
        if not suffix:  # the table of a sequence has the note of each frame
            notes.append(tell_flatter(flatter))
    if access is not None and access.worst is not None and not suffix:
        notes.append(tell_access(access))
    return replace(print_, flatter=flatter, support_access=access), notes
