"""The slicer's part of a report: its check, its table, and what was proven by whom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from knotfab.slicer.result import NotSliced, Sliced
from knotfab_formats.report import Flatter, Print, Proven, SlicerFigures
from knotfab_formats.verdict import Check, Status
from knotfab_validators.check import at_most

__all__ = [
    "OPENING",
    "PROVEN",
    "check_slicing",
    "report_slicing",
    "tell_flatter",
    "tell_kept",
    "tell_unsliced",
    "with_slicing",
]

# PrusaSlicer ends with exit code 0 for a mesh with holes, for one that overlaps itself and for a part
# outside the bed, and it leaves out what is thinner than a line without a word.
PROVEN = (
    Proven("closed surfaces without self-intersection", "knotfab, from part.stl"),
    Proven("shadow, clearances, knot types, thickness", "knotfab, from part.stl and knots.json"),
    Proven("size and place of the one object in part.3mf", "knotfab, from what PrusaSlicer read"),
    Proven(
        "the whole surface is printed, and every shell where it belongs", "knotfab, from the G-code"
    ),
    Proven("part and supports inside the build volume", "knotfab, from the G-code"),
    Proven("filament and layers agree with the mesh", "knotfab, from the G-code"),
    Proven("toolpaths can be made of part.3mf, each layer has some", "PrusaSlicer"),
    Proven("printing time, filament, supports", "PrusaSlicer's estimate, for a cautious machine"),
)

OPENING = (
    "part.3mf is one object with its shells in their places, and holds no settings. Bambu Studio and "
    "OrcaSlicer therefore say that it is not from them and that they load its geometry only: that is "
    "right. Choose printer, filament and supports there; slicer.ini has them for PrusaSlicer."
)


def tell_kept(result: Sliced | NotSliced | None) -> list[str]:
    """Say why no G-code lies in the folder, though it was asked for; nothing where it does."""
    if not isinstance(result, NotSliced):
        return []
    remedy = f" {result.remedy}" if result.remedy else ""
    return [f"No G-code is kept: {result.reason.rstrip('.')}.{remedy}"]


def tell_unsliced(result: Sliced | NotSliced | None) -> list[str]:
    """Return why hours and supports of a piece that is printed are not known; nothing where they are."""
    if not isinstance(result, NotSliced) or result.kind == "process":
        return []
    return [f"Hours and supports are not known: {result.reason}. {result.remedy}".strip()]


def check_slicing(result: Sliced | NotSliced) -> Check:
    """Return the check `slicer`.

    It fails for a part that PrusaSlicer refuses or dies of, for a warning that nothing settles, and
    for G-code that does not print the part. Where there was no slicer to ask, or no answer in
    time, it is skipped and not required.
    """
    if isinstance(result, Sliced):
        problems = result.problems
        good = f"{result.program} {result.version} slices part.3mf; " + "; ".join(
            c.detail for c in result.checks if c.name in ("surface", "bed")
        )
        detail = "; ".join(problems) or good
        return at_most("slicer", len(problems), 0, "problems", detail)
    failed = result.kind in ("refused", "crashed")
    parts = [result.reason]
    if result.said and result.said not in result.reason:
        parts.append(f"it said: {result.said}")
    if result.remedy:
        parts.append(f"remedy: {result.remedy}")
    status: Status = "fail" if failed else "skipped"
    return Check("slicer", status, failed, 1 if failed else None, 0, "problems", "; ".join(parts))


def report_slicing(result: Sliced | NotSliced) -> SlicerFigures:
    """Return the report's table `slicer`; its figures are None where the part was not sliced."""
    if isinstance(result, NotSliced):
        figures = (
            "program",
            "version",
            "time_s",
            "filament_m",
            "filament_g",
            "support_m",
            "layers",
        )
        return SlicerFigures(
            **dict.fromkeys(figures),
            reason=result.reason,
            remedy=result.remedy,
            warnings=(),
            checks=(),
            proven=tuple(one for one in PROVEN if one.by.startswith("knotfab, from part.stl")),
        )
    return SlicerFigures(**vars(result), proven=PROVEN)


def with_slicing(print_: Print, result: Sliced | NotSliced | None) -> Print:
    """Add to a printed piece's figures how its files are opened, and what the slicer says it takes."""
    if not isinstance(result, Sliced):
        return replace(print_, opening=OPENING)
    return replace(
        print_,
        opening=OPENING,
        time_s=result.time_s,
        filament_m=result.filament_m,
        filament_g=result.filament_g,
        support_g=result.filament_g * result.support_share,
        support_share=result.support_share,
    )


def tell_flatter(flatter: Sequence[Flatter]) -> str:
    """Tell what less depth would take, in one sentence."""
    less = []
    for other in flatter:
        share = other.depth_share
        how = f"with {share:.0%} of its depth" if share else "flat"
        less.append(f"{how} {_hours(other.hours)} and {other.grams:.0f} g")
    return f"A flatter piece would take, by an estimate: {', '.join(less)}."


def _hours(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min"
