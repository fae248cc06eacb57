"""The slicer's part of a report: its check, its table, and what was proven by whom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from knotfab.slicer.result import CrossCheck, NotSliced, Sliced

__all__ = [
    "OPENING",
    "PROVEN",
    "check_slicing",
    "print_figures",
    "report_slicing",
    "tell_flatter",
    "tell_kept",
]

# PrusaSlicer ends with exit code 0 for a mesh with holes, for one that overlaps itself and for a part
# outside the bed, and it leaves out what is thinner than a line without a word.
PROVEN: tuple[tuple[str, str], ...] = (
    ("closed surfaces without self-intersection", "knotfab, from part.stl"),
    ("shadow, clearances, knot types, thickness", "knotfab, from part.stl and knots.json"),
    ("size and place of the one object in part.3mf", "knotfab, from what PrusaSlicer read"),
    ("the whole surface is printed, and every shell where it belongs", "knotfab, from the G-code"),
    ("part and supports inside the build volume", "knotfab, from the G-code"),
    ("filament and layers agree with the mesh", "knotfab, from the G-code"),
    ("toolpaths can be made of part.3mf, each layer has some", "PrusaSlicer"),
    ("printing time, filament, supports", "PrusaSlicer's estimate, for a cautious machine"),
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


def check_slicing(result: Sliced | NotSliced) -> dict[str, Any]:
    """The check `slicer` in the report's form.

    It fails for a part that PrusaSlicer refuses or dies of, for a warning that nothing settles, and
    for G-code that does not print the part. Where there was no slicer to ask, or no answer in
    time, it is skipped and not required.
    """
    check: dict[str, Any] = {"name": "slicer", "limit": 0, "unit": "problems"}
    if isinstance(result, Sliced):
        problems = result.problems
        check.update(status="fail" if problems else "pass", required=True, measured=len(problems))
        good = f"{result.program} {result.version} slices part.3mf; " + "; ".join(
            c.detail for c in result.checks if c.name in ("surface", "bed")
        )
        return {**check, "detail": "; ".join(problems) or good}
    failed = result.kind in ("refused", "crashed")
    parts = [result.reason]
    if result.said and result.said not in result.reason:
        parts.append(f"it said: {result.said}")
    if result.remedy:
        parts.append(f"remedy: {result.remedy}")
    check.update(
        status="fail" if failed else "skipped", required=failed, measured=1 if failed else None
    )
    return {**check, "detail": "; ".join(parts)}


def report_slicing(result: Sliced | NotSliced) -> dict[str, Any]:
    """The report's table `slicer`; its figures are None where the part was not sliced."""
    proven = [{"what": what, "by": by} for what, by in PROVEN]
    if isinstance(result, NotSliced):
        figures = ("version", "time_s", "filament_m", "filament_g", "support_m", "layers")
        ours = [record for record in proven if record["by"].startswith("knotfab, from part.stl")]
        return {
            "program": None,
            **dict.fromkeys(figures),
            "reason": result.reason,
            "remedy": result.remedy,
            "warnings": [],
            "checks": [],
            "proven": ours,
        }
    return {
        "program": result.program,
        "version": result.version,
        "time_s": result.time_s,
        "filament_m": result.filament_m,
        "filament_g": result.filament_g,
        "support_m": result.support_m,
        "layers": result.layers,
        "objects": result.objects,
        "warnings": [
            {"text": w.text, "explanation": w.explanation, "settled": w.settled}
            for w in result.warnings
        ],
        "checks": [_record(check) for check in result.checks],
        "proven": proven,
        "command": result.command,
        "profile": result.profile,
        "seconds": result.seconds,
    }


def print_figures(result: Sliced | NotSliced) -> dict[str, float]:
    """Collect the slicer's figures for the report's `print`: none where the part was not sliced."""
    if isinstance(result, NotSliced):
        return {}
    return {
        "time_s": result.time_s,
        "filament_m": result.filament_m,
        "filament_g": result.filament_g,
        "support_g": result.filament_g * result.support_share,
        "support_share": result.support_share,
    }


def tell_flatter(flatter: Sequence[dict[str, Any]]) -> str:
    """Tell what less depth would take, in one sentence."""
    less = []
    for other in flatter:
        share = other["depth_share"]
        how = f"with {share:.0%} of its depth" if share else "flat"
        less.append(f"{how} {_hours(other['hours'])} and {other['grams']:.0f} g")
    return f"A flatter piece would take, by an estimate: {', '.join(less)}."


def _hours(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.0f} min"


def _record(check: CrossCheck) -> dict[str, Any]:
    return {
        "name": check.name,
        "status": "pass" if check.passed else "fail",
        "measured": check.measured,
        "limit": check.limit,
        "unit": check.unit,
        "detail": check.detail,
    }
