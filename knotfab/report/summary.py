"""A report in a few lines: for a terminal, or a program that asked for the build."""

from __future__ import annotations

from collections.abc import Iterable

from knotfab_formats.report import Report
from knotfab_formats.verdict import (
    FILES,
    HELD,
    KNOTS,
    MESH,
    PRINTING,
    SHADOWS,
    TABLE,
    TUBE,
    UPRIGHT,
    Check,
    Verdict,
)

# names that `--skip` knows: the validators' checks, the rendering that some of them use, the slicer
_OF_PRINT = (*HELD, *PRINTING, *UPRIGHT, *TABLE)
CHECKS = ("shadow-render", "slicer", *SHADOWS, *KNOTS, *MESH, *FILES, *TUBE, *_OF_PRINT)

_TALLIED = {"pass": "passed", "fail": "failed", "warn": "not required and not met"}
_TALLIED |= {"skipped": "skipped", "info": "for information"}
_FEW = 4  # checks that are named


def told_iou(iou: float, iou_frame: float | None, standing: bool) -> float:
    """Return the IoU to report for a view; what a stand darkens below the frame does not count."""
    return iou_frame if standing and iou_frame is not None else iou


def tell_colours(report: Report) -> list[str]:
    """Say how well several lamps mix the picture's colours, in sentences; nothing where none do."""
    found = report.colours
    if found is None:
        return []
    count, moved, picture = len(found.lamps), found.misregistration, found.picture
    said = [
        f"{tell_share(found.share)} of the picture has the right one of the {2**count} colours that "
        f"{count} lamps mix: {tell_share(found.share_inside)} of it inside its areas, "
        f"{tell_share(found.share_along)} along their outlines"
    ]
    off = f"what is seen is ΔE {found.delta_e:.1f} from these colours on average"
    if picture is not None:
        off += f", and {picture.delta_e:.1f} from the picture as it came, of which lamps can mix "
        off += f"{tell_share(picture.masks_share)} as it is taken apart"
    uneven = f"uneven light alone makes {found.delta_e_lit:.1f} where no lamp is hidden"
    said.append(f"{off}; {uneven} (2 is seen side by side, 10 at a glance)")
    if moved.lamp_mm is not None:
        said.append(
            f"a lamp may stand {moved.lamp_mm:.0f} mm beside its place until a strand's shadow is half of "
            f"its width off; with every lamp {moved.moved_mm:.0f} mm off, {tell_share(moved.share)} of "
            f"the picture has its right colour ({tell_share(moved.unmoved)} with none)"
        )
    beside = [lamp.name for lamp in found.lamps if lamp.spill_beside > 0]
    if beside:
        said.append(
            f"on an open wall the light of {', '.join(beside)} shows shadows beside the picture"
        )
    return said


def tell_share(share: float) -> str:
    """Write a share in percent with one decimal; only the whole is 100%."""
    return "100%" if share == 1 else f"{min(100 * share, 99.9):.1f}%"


def rank_check(name: str) -> int:
    """Return the place of a check in a report: as in `CHECKS`, and others after these."""
    return CHECKS.index(name) if name in CHECKS else len(CHECKS)


def mark_of(check: Check) -> str:
    """Return a check's status, or "warn" if it fails without being required."""
    fails = check.status == "fail" and not check.required
    return "warn" if fails else check.status


def tally_checks(checks: Iterable[Check]) -> str:
    """Count checks by outcome, and name those not passed: "35 passed, 1 skipped: slicer"."""
    names: dict[str, list[str]] = {}
    for check in checks:
        names.setdefault(mark_of(check), []).append(check.name)
    told = []
    for mark, word in _TALLIED.items():
        if found := names.get(mark, []):
            which = f": {', '.join(found)}" if mark != "pass" and len(found) <= _FEW else ""
            told.append(f"{len(found)} {word}{which}")
    return ", ".join(told)


def verdict_without_part(why: str) -> Verdict:
    """Make the verdict on a piece that could not be made into a part: failed, because of `why`."""
    return Verdict(
        status="fail",
        exit_code=1,
        conclusion="",
        size_mm=None,
        notes=(),
        checks=(Check("part", "fail", True, None, None, "", why),),
        views=(),
        colours=None,
        picture=None,
        seconds={},
    )
