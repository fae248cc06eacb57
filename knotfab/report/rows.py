"""A report as rows, the most pressing first: terminal, page, batch and studio print them."""

from __future__ import annotations

from collections.abc import Iterator

from knotfab.design.sentence import GUESSED_TOLD, word_of_told
from knotfab.knots import count_in_words
from knotfab.report.effects import tell_move
from knotfab.report.summary import tell_share, told_iou
from knotfab_formats.report import Report, Row
from knotfab_formats.verdict import POOR, list_unmet

# how to ask for another way, and what it is like
_WAYS = {
    "rounded": ("--plate rounded", "in a rounded plate, which is its screen,"),
    "slicer": ("--supports slicer", "with the slicer's supports"),
    "none": ("--supports none", "without supports"),
}
_STRINGS = 15.0  # retractions a layer from which on strings are to be expected
SEEN_SHARE = 0.0005  # share of a frame that a holder darkens, from which on it is told
_PRESSING = ("fail", "warn", "do", "info")


def list_rows(report: Report) -> tuple[Row, ...]:
    """List what a person can know or do about a piece, the most pressing first."""
    found = [
        *_list_failures(report),
        *(Row(name="warning", status="warn", text=f"{text}.") for text in report.warnings or ()),
        *_list_losses(report),
        *_list_likeness(report),
        *_list_aside(report),
        *_list_piece(report),
        *_list_printing(report),
        *(Row(name="note", text=note) for note in report.notes),
        *_list_next(report),
    ]
    return tuple(sorted(found, key=lambda row: _PRESSING.index(row.status)))


def _list_failures(report: Report) -> Iterator[Row]:
    for check in list_unmet(report.checks):
        did = "did not run" if check.status == "skipped" else "failed"
        yield Row(
            name=check.name,
            value=check.measured,
            unit=check.unit,
            limit=check.limit,
            status="fail",
            text=f"{check.name} {did}: {check.detail}",
        )


def _list_losses(report: Report) -> Iterator[Row]:
    """Name what is lost, with the option that widens strokes where these are lost for want of width."""
    verdict, asked = report.verdict, report.settings.command
    poor = verdict is not None and verdict.word in POOR
    if (
        verdict is None
        or not verdict.reasons
        or not (poor or any(loss.what != "specks" for loss in verdict.lost))
    ):
        return
    strokes = [loss for loss in verdict.lost if loss.what in ("piece", "stroke", "text")]
    thin = "--thicken" not in asked and any(0.0 < s.size_mm < s.needed_mm for s in strokes)
    worst = verdict.lost[0] if verdict.lost else None
    said = "; ".join(verdict.reasons)
    remedy = "--thicken auto" if poor and thin else ""
    yield Row(
        name="losses",
        value=len(verdict.lost),
        status="warn" if poor else "info",
        where=(worst and worst.view) or "",
        remedy=remedy,
        text=said + (f": {remedy} widens what is thinner than the tube's shadow" if remedy else ""),
    )


def _list_likeness(report: Report) -> Iterator[Row]:
    """Tell the least likeness; of several views or frames, also where and the best."""
    views, mount = report.views, report.print.mount
    if not views:
        return
    standing = mount is not None and mount.kind == "stand"
    # a part that the desk hides below the frame is no fault of the picture
    ious = [told_iou(view.iou, view.iou_frame, standing) for view in views]
    least = min(range(len(views)), key=ious.__getitem__)
    view = views[least]
    said = f"{tell_share(ious[least])} alike" + (" in the frame" if standing else "")
    if len(views) > 1:
        said = f"{view.name}: {said}, the least of {len(views)}"
    if view.iou_drawn is not None:
        drawn = "it as bent" if view.bending is not None else "its strokes as wide as drawn"
        said += f", {tell_share(view.iou_drawn)} with {drawn}"
    if (off := view.misplacement) is not None and off.worst is not None:
        apart = None if mount is None else mount.threads_apart_mm
        said += f"; {off.worst.fitted:.0%} with {tell_move(off.worst, off, view.kind, apart)}"
    yield Row(name="likeness", value=ious[least], limit=view.bound, where=view.name, text=said)
    if (colours := report.colours) is not None:
        right = f"{tell_share(colours.share)} of the picture has its right colour"
        yield Row(name="colours", value=colours.share, text=right)


def _list_aside(report: Report) -> Iterator[Row]:
    """Say how much of the picture whoever sees the piece unlit reads, and from where most."""
    told = [view.told for view in report.views if view.told is not None]
    if not told or report.print.parts is not None:
        return
    found = max(told, key=lambda one: one.worst.share)
    share, mount = found.worst.share, report.print.mount
    way = f"{abs(found.worst.azimuth):.0f}° aside"
    if found.worst.elevation:
        way = (
            f"{abs(found.worst.elevation):.0f}° {'above' if found.worst.elevation > 0 else 'below'}"
        )
    of = "" if found.of == "whole" else f" in its {found.of}"
    board = mount is not None and mount.plate == "outline"
    remedy = "--plate rounded" if board and share >= GUESSED_TOLD else ""
    yield Row(
        name="aside",
        value=share,
        limit=GUESSED_TOLD,
        where=way,
        remedy=remedy,
        text=f"unlit, its picture {word_of_told(share)} from {way}{of} (told {share:.2f}; "
        f"from the door {found.door:.2f})" + (f"; {remedy} hides its outline" if remedy else ""),
    )


def _list_piece(report: Report) -> Iterator[Row]:
    """Tell size, hours, grams and knots."""
    piece = report.print
    count = count_in_words(len(report.knots) // (piece.parts or 1))
    knots = f"{count} of a tube {2 * report.settings.tube_radius_mm:.1f} mm thick"
    mass = piece.filament_g or piece.mass_g
    if not piece.mass_g:
        yield Row(name="piece", text=f"no part; {knots}")
        return
    said = [" × ".join(f"{side:.0f}" for side in piece.bounding_box_mm or ()) + " mm"]
    said += [] if piece.time_s is None else [f"{piece.time_s / 3600:.1f} h"]
    full = "" if piece.filament_g or not piece.supports else "at most "  # tubes print with a core
    said += [
        f"{full}{mass:.0f} g"
        + (f", {piece.support_g:.0f} g of it supports" if piece.support_g else "")
    ]
    where = "" if piece.parts is None else f"{piece.parts} frames, "
    yield Row(name="piece", value=mass, unit="g", text=f"{where}{', '.join(said)}; {knots}")


def _list_printing(report: Report) -> Iterator[Row]:
    """Say how to print the piece and what to do with it before it hangs."""
    piece, mount = report.print, report.print.mount
    loose = len(report.knots) > 1 and piece.parts is None
    if mount is not None and mount.kind == "none":
        kind = "wall" if len(report.views) == 1 else "stand"
        kept = " Its knots are loose pieces, which the file keeps in place." if loose else ""
        yield Row(
            name="mount",
            value="none",
            remedy=f"--mount {kind}",
            text=f"Nothing holds it: --mount {kind} adds what does.{kept}",
        )
    if mount is not None and mount.kind == "hang" and mount.second_thread_mm is None:
        said = "It hangs on one thread and can turn: hold it still until you see its picture."
        if (dark := mount.predicted_intrusion or 0.0) >= SEEN_SHARE:
            said += f" Its eyelet and rods darken {dark:.1%} of a frame."
        yield Row(name="thread", value=1, status="do", text=said)
    if mount is not None and mount.foot == "dowel":
        said = f"Its {mount.pegs} pegs go into holes drilled in the wall."
        yield Row(name="holes", value=mount.pegs, status="do", text=said)
    if (roots := piece.roots) is not None and not roots.screws:
        said = "No screw fits its shadow: double-sided tape along its strips holds it "
        said += f"({roots.area_cm2:.0f} cm²)."
        yield Row(name="tape", value=roots.area_cm2, unit="cm²", status="do", text=said)
    supports = piece.supports
    if supports is None or report.status != "pass":
        return
    said = "Print it as it lies, "
    said += "supports off" if supports.way == "none" else f"with supports: {supports.why}"
    if (plate := piece.plate) is not None:
        said += f"; change the filament before layer {plate.change_layer} for a light screen"
    if (bars := piece.bars) is not None:
        said += f"; its {bars.count} threads, up to {bars.longest_mm:.1f} mm long, lie in the shadow, and "
        said += "whoever likes takes them off"
    yield Row(name="supports", value=supports.way, status="do", text=f"{said}.")
    sliced = report.slicer
    each = 0.0 if sliced is None else (sliced.retractions or 0) / max(sliced.layers or 1, 1)
    if sliced is not None and each >= _STRINGS:
        times = f"{sliced.retractions:,}".replace(",", "\u202f")
        said = f"The nozzle leaves a leg {times} times, {each:.0f} a layer: dry the filament, and "
        said += "blow off strings with warm air."
        yield Row(
            name="strings",
            value=sliced.retractions,
            unit="retractions",
            limit=_STRINGS,
            status="do",
            text=said,
        )
    if len(supports.ways) > 1:
        taken, other = supports.ways[:2]
        remedy, how = _WAYS[other.way]
        if other.way == "slicer" and not (mount is not None and mount.kind == "hang"):
            how += ", and no holder,"
        yield Row(
            name="otherwise",
            value=other.price,
            unit="h",
            limit=taken.price,
            remedy=remedy,
            text=f"The next best: {how} it would take about {other.grams:.0f} g and {other.hours:.1f} h, a "
            f"price of {other.price:.1f} h for {taken.price:.1f} h ({remedy}).",
        )


def _list_next(report: Report) -> Iterator[Row]:
    if (step := report.next_step) is not None:
        yield Row(
            name="next",
            value=step.iou_gain,
            remedy=f"--accuracy {step.accuracy}",
            text=step.sentence,
        )
