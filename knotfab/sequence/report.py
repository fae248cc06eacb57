"""The report of a sequence: one view a frame, its motion and its certificate; checks taken together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from knotfab.base.progress import Progress
from knotfab.knots import count_in_words
from knotfab.limits.feasibility import LEAST
from knotfab.piece import WrittenPiece
from knotfab.report.report_json import assemble
from knotfab.sequence.chain import SequenceFrame
from knotfab.sequence.motion import Motion
from knotfab.sequence.zoetrope import Zoetrope
from knotfab.verify.checks import list_unmet
from knotfab.verify.verifier import Answer
from knotfab_formats.scene import Printer
from knotfab_validators.check import Check, Status, at_least, at_most

__all__ = ["Ring", "advise", "check_closing", "check_motion", "check_ring", "sequence_report"]

Record = dict[str, Any]
# keys of a piece's `print` that go with its frame; keys that are summed over all frames
_OF_FRAME = ("pose", "plates", "flatter", "support_access")
_SUMMED = ("time_s", "filament_m", "filament_g", "support_g")
_ORDER = ("fail", "skipped", "pass")
_FAR = 8.0  # tube radii that an outline goes: more than that is worth a frame in between


def check_motion(motions: Sequence[Motion]) -> Record:
    """`motion`: no vertex goes further between neighbours than the pictures' outlines and one radius."""
    worst = max(motions, key=lambda m: m.largest_mm - m.limit_mm)
    number = next(k for k, m in enumerate(motions, start=2) if m is worst)
    return Check(
        "motion",
        "pass" if all(m.held for m in motions) else "fail",
        True,
        worst.largest_mm,
        worst.limit_mm,
        "mm",
        f"the vertex that comes nearest to its bound, on the way to frame {number}: the "
        f"outlines of the two pictures are {worst.outline_mm:.3f} mm apart (Hausdorff distance), and "
        "one tube radius is added",
    ).to_dict()


def check_closing(motion: Motion) -> Record:
    """`closing`: the same from the last frame back to the first, which not every sequence needs."""
    loop = "so it may be played round and round" if motion.held else "too far to play it as a loop"
    status: Status = "pass" if motion.held else "fail"
    detail = f"from the last frame to the first, {loop}"
    largest, limit = motion.largest_mm, motion.limit_mm
    return Check("closing", status, False, largest, limit, "mm", detail).to_dict()


@dataclass(frozen=True)
class Ring:
    """The zoetrope as written, or `why` there is none; and the validators' verdict on its file to come."""

    spun: Zoetrope | None
    why: str
    answer: Answer | None


def check_ring(ring: Ring, printer: Printer) -> list[Record]:
    """`zoetrope_mesh`: zoetrope.stl is a sound mesh; `zoetrope`: whether the printer can print its tubes.

    The second is not required: the frames are as small as the bed asks, and the parts are there as well.
    """
    if ring.spun is None or ring.answer is None:
        return [Check("zoetrope", "fail", False, None, None, "mm", ring.why).to_dict()]
    spun, least = ring.spun, printer.min_tube_radius_mm
    found = ring.answer.result()["checks"]
    wrong = list_unmet(found)
    handles = next((c["measured"] for c in found if c["name"] == "mesh_genus"), None)
    mesh = at_most(
        "zoetrope_mesh",
        len(wrong),
        0,
        "checks",
        "; ".join(f"{c['name']}: {c['detail']}" for c in wrong)
        or f"zoetrope.stl is one closed surface that does not cross itself, with {handles} handles",
    )
    detail = (
        f"tube radius of the frames at {100 * spun.scale:.1f} % on a ring of {spun.diameter_mm:.1f} mm "
        f"across, {spun.height_mm:.1f} mm high"
    )
    if spun.tube_radius_mm < least:
        detail += "; thicker with fewer frames, less depth, a larger printer, or resin"
    if spun.gap_mm < printer.nozzle_mm:
        detail += (
            f"; gaps between strands may be as small as {spun.gap_mm:.2f} mm and close in the print: the "
            "knots are true in the single parts"
        )
    tubes = at_least("zoetrope", spun.tube_radius_mm, least, "mm", detail, required=False)
    return [mesh.to_dict(), tubes.to_dict()]


def sequence_report(
    reports: Sequence[Record],
    pieces: Sequence[WrittenPiece],
    frames: Sequence[SequenceFrame],
    motions: Sequence[Motion],
    checks: Sequence[Record],
    spun: Zoetrope | None,
    progress: Progress,
) -> Record:
    """report.json of a sequence, from the frames' own reports.

    Args:
        reports: the report of each frame, as for a piece of its own. pieces: as written and verified.
        motions: into frames 2, 3, … and, last, back to the first.
        checks: checks of the sequence as a whole.
    """
    views = []
    each = zip(reports, frames, pieces, strict=True)
    for number, (report, frame, piece) in enumerate(each, start=1):
        account = frame.made.result.log
        for view in report["views"]:
            views.append(
                {
                    **view,
                    "frame": number,
                    "pieces": piece.targets[0].pieces,
                    "knots": len(piece.made.knots.knots),
                    "part": f"part-{number:02d}.stl",
                    "status": report["status"],
                    "motion": None if number == 1 else _motion(motions[number - 2]),
                    "began_as": None if frame.origin is None else frame.origin + 1,
                    "transported": frame.transported,
                    "certificate": {**account.__dict__, "certified": account.certified},
                    "mount": report["print"].get("mount", {"kind": "none"}),
                    **{
                        k: report["print"][k]
                        for k in (*_OF_FRAME, *_SUMMED)
                        if k in report["print"]
                    },
                    "notes": _own_notes(report, reports),
                    **{k: report[k] for k in ("bending_plan",) if k in report},
                    "failed": [c["name"] for c in list_unmet(report["checks"])],
                }
            )
    first = reports[0]
    volume = sum(r["print"]["volume_mm3"] for r in reports)
    mass = sum(r["print"]["mass_g"] for r in reports)
    print_ = {k: v for k, v in first["print"].items() if k not in _OF_FRAME}
    print_ |= {"volume_mm3": volume, "mass_g": mass, "parts": len(reports)}
    for key in _SUMMED:
        if key in print_:
            print_[key] = sum(r["print"][key] for r in reports)
    if print_.get("filament_g"):
        print_["support_share"] = print_["support_g"] / print_["filament_g"]
    print_["drawings"] = [name for r in reports for name in r["print"].get("drawings", ())]
    if spun is not None:
        print_["zoetrope"] = {
            "scale": spun.scale,
            "tube_radius_mm": spun.tube_radius_mm,
            "diameter_mm": spun.diameter_mm,
            "height_mm": spun.height_mm,
            "gap_mm": spun.gap_mm,
            "posts": list(spun.posts),
        }
    settings = {
        k: v for k, v in first["settings"].items() if k not in ("certificate", "thickness_mm")
    }
    settings["thickness_mm"] = min(r["settings"]["thickness_mm"] for r in reports)
    settings["sequence"] = {
        "frames": len(reports),
        "closing": _motion(motions[-1]),
        "verification_s": round(sum(sum(p.verdict["seconds"].values()) for p in pieces), 2),
    }
    knotted = count_in_words(len(pieces[0].made.knots.knots))
    report = assemble(
        views=views,
        checks=[*_together([r["checks"] for r in reports]), *checks],
        effects=_effects(reports),
        limits=_limits(reports),
        timings={**progress.timings, "total": progress.total},
        knots=[knot for r in reports for knot in r["knots"]],
        print_=print_,
        settings=settings,
        notes=[
            f"{len(reports)} frames of {knotted}, each a part of its own (part-NN.stl); the "
            "picture that moves is sequence.gif.",
            *advise(views, pieces[0].made.knots.radius_mm),
            *_shared_notes(reports),
        ],
    )
    prices = [
        {**price, "frame": number}
        for number, frame in enumerate(reports, start=1)
        for price in frame.get("binding", ())
    ]
    return {**report, "binding": prices} if any("binding" in r for r in reports) else report


def advise(views: Sequence[Record], radius: float) -> list[str]:
    """A sentence for each frame that fails: which checks, and what to do about it."""
    found = []
    for number, view in enumerate(views, start=1):
        failed = view["failed"]
        if not failed:
            continue
        # the motion into a frame stands with it
        ways = [(v["motion"]["outline_mm"], k) for k, v in enumerate(views, start=1) if v["motion"]]
        far, into = max((way for way in ways if way[1] in (number, number + 1)), default=(0.0, 0))
        if "limits" in failed:
            remedy = "give that limit more room in the scene, or draw this frame simpler"
        elif view["pieces"] > view["knots"]:
            remedy = (
                f"its {view['pieces']} pieces lie apart, and the strand that joins them shows: let them "
                "touch, or build each of them as a sequence of its own"
            )
        elif far > _FAR * radius:
            remedy = (
                f"the outline goes {far:.0f} mm from frame {into - 1} to frame {into}, "
                f"{far / radius:.0f} tube radii: draw a frame in between"
            )
        elif "outline" in failed:
            remedy = "parts of it are stretched: let it differ less from its neighbours, or draw it larger"
        else:
            remedy = "draw parts that touch in it further apart, or build with --accuracy standard or fine"
        found.append(f"Frame {number} fails ({', '.join(failed)}): {remedy}.")
    return found


def _own_notes(report: Record, reports: Sequence[Record]) -> list[str]:
    """Return the notes of a frame that are not those of every frame."""
    return [note for note in report.get("notes", ()) if note not in _shared_notes(reports)]


def _shared_notes(reports: Sequence[Record]) -> list[str]:
    """The notes that every frame has."""
    first, *others = (report.get("notes", ()) for report in reports)
    return [note for note in first if all(note in notes for notes in others)]


def _motion(motion: Motion) -> Record:
    return {
        "largest_mm": motion.largest_mm,
        "mean_mm": motion.mean_mm,
        "outline_mm": motion.outline_mm,
        "limit_mm": motion.limit_mm,
        "held": motion.held,
    }


def _together(all_checks: Sequence[Sequence[Record]]) -> list[Record]:
    """One line a check for all frames: the worst status, and the figures of a frame that has it."""
    names = list(dict.fromkeys(c["name"] for checks in all_checks for c in checks))
    found = []
    for name in names:
        lines = [
            (number, c)
            for number, checks in enumerate(all_checks, start=1)
            for c in checks
            if c["name"] == name
        ]
        status = min((c["status"] for _, c in lines), key=_ORDER.index)
        same = [(number, c) for number, c in lines if c["status"] == status]
        sign = -1.0 if status == "fail" else 1.0
        number, worst = min(same, key=lambda line: sign * _room(line[1]))
        which = ", ".join(str(n) for n, _ in same)
        said = f"frame {number} of {len(all_checks)} has least room: {worst['detail']}"
        if status == "fail":
            said = f"frames {which}: {worst['detail']}"
        elif status == "skipped":
            said = worst["detail"]
        found.append({**worst, "status": status, "detail": said})
    return found


def _room(check: Record) -> float:
    """Measure how close a check is to its limit; whichever side the limit is on, less is closer."""
    measured, limit = check["measured"], check["limit"]
    if not isinstance(measured, int | float) or not isinstance(limit, int | float):
        return 0.0
    return abs(float(measured) - float(limit))


def _effects(reports: Sequence[Record]) -> list[Record]:
    """Each effect at its largest magnitude; calls, seconds and stages of all frames together."""
    limits = {line["name"] for r in reports for line in r["limits"]}
    every = [e for r in reports for e in r["effects"] if e["name"] not in limits]
    found = []
    for name in dict.fromkeys(line["name"] for line in every):
        line = _sum_lines(reports, "effects", name, lambda e: (e["simulated"], e["magnitude"]))
        stages = [stage for e in every if e["name"] == name for stage in e["where"]]
        found.append({**line, "where": list(dict.fromkeys(stages))})
    return found


def _limits(reports: Sequence[Record]) -> list[Record]:
    """Each limit in the frame that comes nearest to it or goes furthest beyond."""
    names = dict.fromkeys(line["name"] for r in reports for line in r["limits"])

    def beyond(line: Record) -> float:
        over = float(line["measured"]) - float(line["limit"])
        return -over if line["name"] in LEAST else over

    return [_sum_lines(reports, "limits", name, beyond) for name in names]


def _sum_lines(
    reports: Sequence[Record], section: str, name: str, worst: Callable[[Any], Any]
) -> Record:
    """The worst of all frames' lines of a name, with the calls and seconds of all."""
    lines = [line for r in reports for line in r[section] if line["name"] == name]
    seconds = round(sum(line["seconds"] for line in lines), 4)
    calls = sum(line["calls"] for line in lines)
    return {**max(lines, key=worst), "calls": calls, "seconds": seconds}
