"""A report in a few lines: for a terminal, or a program that asked for the build."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from knotfab.knots import count_in_words
from knotfab.report.effects import tell_move
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
    list_unmet,
)

# names that `--skip` knows: the validators' checks, the rendering that some of them use, the slicer
_OF_PRINT = (*HELD, *PRINTING, *UPRIGHT, *TABLE)
CHECKS = ("shadow-render", "slicer", *SHADOWS, *KNOTS, *MESH, *FILES, *TUBE, *_OF_PRINT)

_TALLIED = {"pass": "passed", "fail": "failed", "warn": "not required and not met"}
_TALLIED |= {"skipped": "skipped", "info": "for information"}
_FEW = 4  # checks that are named
# z of `recognition` from which a picture may be guessed, and is read, from the side
_GUESSED, _PLAIN = 2.0, 3.0


def conclude(report: Report, verbose: bool = False) -> list[str]:
    """Say how good the piece is: warnings, failed checks, losses that a person sees, important notes.

    Args:
        verbose: whether to add the IoU.
    """
    verdict = report.verdict
    lost = [] if verdict is None else [loss.sentence for loss in verdict.lost]
    step = [] if report.next_step is None else [report.next_step.sentence]
    told = () if verdict is None else verdict.reasons
    reasons = [r for r in told if not any(one.startswith(r) for one in lost)]
    said = [*tell_unmet(report.checks), *reasons, *tell_result(report, verbose)]
    return [*(report.warnings or ()), *said, *lost, *report.notes, *step]


def tell_unmet(checks: Sequence[Check]) -> list[str]:
    """Say which required checks failed or did not run, one sentence each."""
    return [
        f"{check.name} {'did not run' if check.status == 'skipped' else 'failed'}: {check.detail}"
        for check in list_unmet(checks)
    ]


def tell_result(report: Report, verbose: bool = False) -> list[str]:
    """Describe shadow and piece: a line for each view, for the colours, and for size, weight and knots."""
    seen = [*tell_views(report, verbose), *tell_colours(report)[: None if verbose else 1]]
    return [*seen, tell_piece(report)]


def told_iou(iou: float, iou_frame: float | None, standing: bool) -> float:
    """Return the IoU to report for a view; what a stand darkens below the frame does not count."""
    return iou_frame if standing and iou_frame is not None else iou


def tell_word(report: Report) -> str:
    return "" if report.verdict is None else report.verdict.word


def tell_views(report: Report, verbose: bool = False) -> list[str]:
    """Say how alike each view's shadow and picture are, and how legible it is."""
    views, mount = report.views, report.print.mount
    standing = mount is not None and mount.kind == "stand"
    apart = None if mount is None else mount.threads_apart_mm
    # a part that the desk hides below the frame is no fault of the picture
    ious = [told_iou(view.iou, view.iou_frame, standing) for view in views]
    alike = [tell_share(iou) for iou in ious]
    if report.print.parts is not None and not verbose:
        worst = min(range(len(views)), key=lambda k: views[k].iou)
        best = max(range(len(views)), key=lambda k: views[k].iou)
        return [f"{alike[worst]} (frame {worst + 1}) to {alike[best]} alike (frame {best + 1})"]
    lines = []
    for view, iou, share in zip(views, ious, alike, strict=True):
        said = f"{share} alike" + (" in the frame" if standing else "")
        drawn = iou if view.iou_drawn is None else view.iou_drawn
        if view.bending is not None:
            said += f", {tell_share(drawn)} with it as bent"
        if view.bound is not None and view.bound > drawn:
            said += f" (at most {tell_share(view.bound)} without spill)"
        named = (view.recognition or {}).get("45")
        if (off := view.misplacement) is not None and off.worst is not None:
            moved = tell_move(off.worst, off, view.kind, apart)
            said += f"; {off.worst.fitted:.0%} with {moved}"
        said += "" if named is None else f"; from 45° aside {_tell_read(named.z)}"
        name = f"{view.name}: " if len(views) > 1 else ""
        lines.append(name + said + (f"; IoU {iou:.4f}" if verbose else ""))
    return lines


def _tell_read(z: float) -> str:
    """Say whether a picture can be read from the side."""
    word = "is not read" if z < _GUESSED else "may be guessed" if z < _PLAIN else "is read"
    return f"its picture {word} (z {z:.1f})"


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


def tell_piece(report: Report) -> str:
    """Say the piece's size, weight, number of knots and thickness of its tube."""
    piece, knots = report.print, report.knots
    size = " × ".join(f"{s:.0f}" for s in piece.bounding_box_mm or ())
    weight = f"{piece.mass_g:.0f} g"
    if (filament := piece.filament_g) and (supports := piece.support_g):
        weight = f"{filament - supports:.0f} g, with supports {filament:.0f} g of filament"
    made = f"{size} mm, {weight}" if piece.mass_g else "no part"
    # the frames of a sequence have the same knots
    where = "" if piece.parts is None else f" in {piece.parts} frames"
    count = len(knots) // (piece.parts or 1)
    return f"{made}; {tell_knots(count, report.settings.tube_radius_mm, where)}"


def tell_knots(count: int, radius_mm: float, where: str = "") -> str:
    """Say how many knots there are, `where`, and how thick their tube is."""
    return f"{count_in_words(count)}{where} of a tube {2 * radius_mm:.1f} mm thick"


def last_line(report: Report) -> str:
    """Say verdict, hours, grams and supports, as far as they are known."""
    piece, said = report.print, list[str]()
    if report.verdict is not None:
        said.append(tell_word(report))
    if piece.time_s is not None:
        said.append(f"{piece.time_s / 3600:.1f} h")
    mass = piece.filament_g or piece.mass_g
    if mass:
        said.append(f"{mass:.0f} g")
    if piece.support_share is not None:
        said.append(f"{100 * piece.support_share:.0f}% of it supports")
    return ", ".join(said) + ": " if said else ""


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
