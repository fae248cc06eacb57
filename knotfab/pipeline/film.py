"""Make a sequence: each frame is a piece, made and reported as any, and one report tells of all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.design.film import Chain, SequenceFrame, measure_motion
from knotfab.knots import count_in_words, read_knots
from knotfab.limits.feasibility import LEAST
from knotfab.part.slicer_process import sum_slicings
from knotfab.picture.frames import count_knots, tell_apart
from knotfab.pipeline.finish import prefer_other_way, report_piece
from knotfab.pipeline.piece import Settled, WrittenPiece
from knotfab.pipeline.plan import plan_places, tell_outcome
from knotfab.pipeline.workshop import Workshop
from knotfab.plan import Steps, Try
from knotfab.report.for_maker import report_slicing, tell_unsliced, with_slicing
from knotfab.report.report import check_certificate, check_limits
from knotfab.report.supports import sum_supports
from knotfab.request import Request
from knotfab.scene.load import dump_scene
from knotfab_formats.print_figures import MountFigures, Print
from knotfab_formats.report import (
    Certificate,
    EffectLine,
    FrameView,
    LimitLine,
    Motion,
    Report,
    SequenceFigures,
)
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.verdict import Check, Status, exit_code, list_unmet
from knotfab_validators.shadows.verdict_rules import worst_verdict

PICTURES = "picture-frame-*"  # how scene.toml names the frames' pictures
_OF_FRAME = ("pose", "bars", "feet")  # keys of `print` told by frame
_SLICED = ("time_s", "filament_m", "filament_g", "support_g")  # those that the slicer tells
_FAR = 8.0  # tube radii of outline motion beyond which a frame in between is advised
Line = TypeVar("Line", EffectLine, LimitLine)
Named = TypeVar("Named", Check, EffectLine, LimitLine)


def plan_film(
    shop: Workshop, request: Request, why: str = ""
) -> Steps[tuple[list[WrittenPiece], Report]]:
    """Plan all frames as the same moving knots, each written and verified as a separate part.

    Each frame has the files of a single piece, numbered (part-01.stl, …), and its own mount; scene.toml and
    report are of all. Frames are verified and sliced while later ones are searched.

    Returns:
        The frames, and the report of all.

    Raises:
        SceneError: a frame has no part or breaks a limit, and the request has another scene to build.
    """
    folder, progress, targets = shop.folder, shop.progress, request.targets
    knots = count_knots(targets, request.scene.piece.knots)
    if (apart := tell_apart(targets, knots)) is not None:
        progress.say(apart)
    found: dict[int, tuple[SequenceFrame, WrittenPiece]] = {}
    left = request.budget(progress.total)
    chain = Chain(request.scene, targets, request.device, progress, left)
    for number in chain.order:
        frame, one = (yield from chain.plan(number, why)), [targets[number]]
        why = ""
        try:
            settled: Settled | str = yield from plan_places(request, one, frame.made, progress)
        except SceneError as error:
            if request.otherwise is not None:
                raise
            settled = str(error)
        made = frame.made if isinstance(settled, str) else settled[0]
        prefer_other_way(request, (check_certificate(made), check_limits(made)))
        suffix = "-" + one[0].name.removeprefix("frame-")
        found[number] = frame, shop.write(request, one, frame.made, settled, suffix)
    frames, pieces = zip(*(found[number] for number in sorted(found)), strict=True)
    write_scene(folder, request.scene, pieces[0].scene)
    reports: list[Report] = []
    for piece in pieces:
        report = partial(report_piece, piece, folder, request, progress)
        reports.append((yield Try(f"piece of {piece.targets[0].name}", report, tell_outcome)))
    with progress.stage("motion"):
        motions = _measure_motions(folder, pieces, chain.outlines_mm)
    closing = [check_closing(motions[-1])] if request.scene.sequence.loop else []
    with progress.stage("report"):
        whole = reports, pieces, frames, motions, [check_motion(motions[:-1]), *closing]
        return list(pieces), _sequence_report(*whole, request)


def _measure_motions(
    folder: OutputFolder, pieces: Sequence[WrittenPiece], outlines_mm: Sequence[float]
) -> list[Motion]:
    """Measure from the written knots the motion into frames 2, 3, … and, last, back to frame 1."""
    points = []
    for piece in pieces:
        assert piece.scene.pose is not None
        written = read_knots(folder.file(f"knots{piece.suffix}.json"))
        points.append(written.moved(np.array(piece.scene.pose.matrix)).points)
    ways = zip(points, [*points[1:], points[0]], outlines_mm, strict=True)
    return [measure_motion(*way, pieces[0].made.knots.radius_mm) for way in ways]


def write_scene(folder: OutputFolder, asked: ResolvedScene, first: ResolvedScene) -> Path:
    """Write a scene.toml from which `knotfab build --sequence` makes the same sequence again.

    It has the first frame's resolved settings, but the mount and the IoU floor of `asked`, since these
    follow from each frame.

    Args:
        asked: the scene as the user wrote it.
    """
    keys = first.model_dump(by_alias=True, exclude={"pose", "mount"})
    view = first.views[0].as_written().but(name=asked.views[0].name, picture=PICTURES)
    keys["views"] = [view.model_dump()]
    keys["accuracy"]["iou_floor"] = asked.accuracy.iou_floor
    whole = ResolvedScene.model_validate({**keys, "mount": asked.mount})
    return folder.write("scene.toml", dump_scene(whole))


def check_motion(motions: Sequence[Motion]) -> Check:
    """Check `motion`: from frame to frame no vertex moves farther than outlines on the wall plus a radius."""
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
    )


def check_closing(motion: Motion) -> Check:
    """Check `closing`: the same from the last frame back to the first; not required."""
    loop = "so it may be played round and round" if motion.held else "too far to play it as a loop"
    status: Status = "pass" if motion.held else "fail"
    detail = f"from the last frame to the first, {loop}"
    largest, limit = motion.largest_mm, motion.limit_mm
    return Check("closing", status, False, largest, limit, "mm", detail)


def _sequence_report(
    reports: Sequence[Report],
    pieces: Sequence[WrittenPiece],
    frames: Sequence[SequenceFrame],
    motions: Sequence[Motion],
    checks: Sequence[Check],
    request: Request,
) -> Report:
    """Make the report of a sequence from those of its frames and the motions to the next, the last back.

    Args:
        checks: of the sequence as a whole.
    """
    views = _list_views(reports, pieces, frames, motions)
    together = (*_merge_checks(reports), *checks)
    slicings = {f"part{p.suffix}.3mf": p.sliced for p in pieces if p.sliced is not None}
    sliced = sum_slicings(slicings) if slicings else None
    print_, settings = _sum_prints(reports), reports[0].settings
    limits, effects = merge_lines([r.limits for r in reports], _excess), list_effects(reports)
    knotted = count_in_words(len(pieces[0].made.knots.knots))
    prices = tuple(
        replace(price, frame=number)
        for number, frame in enumerate(reports, start=1)
        for price in frame.binding or ()
    )
    return Report(
        status="fail" if exit_code(together) else "pass",
        verdict=worst_verdict(views),
        views=views,
        checks=together,
        effects=effects,
        limits=limits,
        knots=tuple(knot for r in reports for knot in r.knots),
        print=with_slicing(print_, sliced) if request.printing else print_,
        settings=replace(
            settings,
            certificate=None,
            thickness_mm=min(r.settings.thickness_mm for r in reports),
            sequence=SequenceFigures(
                frames=len(reports), closing=motions[-1], loop=request.scene.sequence.loop
            ),
        ),
        notes=(
            f"{len(reports)} frames of {knotted}, each a part of its own (part-NN.stl).",
            *advise(views, pieces[0].made.knots.radius_mm),
            *_shared_notes(reports),
            *(tell_unsliced(sliced) if request.printing else ()),
        ),
        binding=prices if any(r.binding is not None for r in reports) else None,
        slicer=None if sliced is None else report_slicing(sliced),
    )


def _list_views(
    reports: Sequence[Report],
    pieces: Sequence[WrittenPiece],
    frames: Sequence[SequenceFrame],
    motions: Sequence[Motion],
) -> tuple[FrameView, ...]:
    views, shared = [], _shared_notes(reports)
    each = zip(reports, frames, pieces, strict=True)
    for number, (report, frame, piece) in enumerate(each, start=1):
        log = frame.made.result.log
        for view in report.views:
            views.append(
                FrameView(
                    **vars(view),
                    frame=number,
                    pieces=piece.targets[0].pieces,
                    knots=len(piece.made.knots.knots),
                    part=f"part-{number:02d}.stl",
                    status=report.status,
                    motion=None if number == 1 else motions[number - 2],
                    began_as=None if frame.way is None else frame.way.origin + 1,
                    certificate=Certificate(**vars(log), certified=log.certified),
                    mount=report.print.mount or MountFigures(kind="none"),
                    **{key: getattr(report.print, key) for key in (*_OF_FRAME, *_SLICED)},
                    notes=tuple(n for n in report.notes if n not in shared),
                    failed=tuple(check.name for check in list_unmet(report.checks)),
                )
            )
    return tuple(views)


def _sum_prints(reports: Sequence[Report]) -> Print:
    """Sum what all frames take, but for what the slicer tells, which `with_slicing` adds."""
    first, prints = reports[0].print, [r.print for r in reports]
    own: dict[str, Any] = dict.fromkeys((*_OF_FRAME, *_SLICED, "support_share"))
    own |= {key: sum(getattr(one, key) for one in prints) for key in ("volume_mm3", "mass_g")}
    drawings = tuple(name for one in prints for name in one.drawings or ())
    supports = sum_supports([one.supports for one in prints])
    return replace(first, **own, supports=supports, parts=len(prints), drawings=drawings)


def advise(views: Sequence[FrameView], radius: float) -> list[str]:
    """Return for each failed frame a sentence that names the checks and a remedy."""
    found = []
    for number, view in enumerate(views, start=1):
        if not view.failed:
            continue
        # of the motions into and out of this frame, the larger
        ways = [(v.motion.outline_mm, k) for k, v in enumerate(views, start=1) if v.motion]
        far, into = max((way for way in ways if way[1] in (number, number + 1)), default=(0.0, 0))
        remedy = "let it differ less from its neighbours, draw it simpler or larger"
        if view.pieces > view.knots:
            remedy = (
                f"its {view.pieces} pieces lie apart, and the strand that joins them shows: let them "
                "touch, or build each of them as a sequence of its own"
            )
        elif far > _FAR * radius:
            remedy = (
                f"the outline goes {far:.0f} mm from frame {into - 1} to frame {into}, "
                f"{far / radius:.0f} tube radii: draw a frame in between"
            )
        found.append(f"Frame {number} fails ({', '.join(view.failed)}): {remedy}.")
    return found


def _shared_notes(reports: Sequence[Report]) -> list[str]:
    first, *others = (report.notes for report in reports)
    return [note for note in first if all(note in notes for notes in others)]


def _merge_checks(reports: Sequence[Report]) -> list[Check]:
    """Merge each check over all frames: the worst status, with the figures of the worst frame that has it."""

    def room(check: Check) -> float:
        """Return the distance from the limit, on either side; 0 if they are not numbers."""
        near, limit = check.measured, check.limit
        if isinstance(near, int | float) and isinstance(limit, int | float):
            return abs(near - limit)
        return 0.0

    found = []
    of = {id(check): number for number, r in enumerate(reports, start=1) for check in r.checks}
    for checks in _by_name(r.checks for r in reports):
        status = min((c.status for c in checks), key=("fail", "skipped", "pass").index)
        same = [c for c in checks if c.status == status]
        worst = (max if status == "fail" else min)(same, key=room)
        said = worst.detail
        if status == "fail":
            said = f"frames {', '.join(str(of[id(c)]) for c in same)}: {said}"
        elif status == "pass":
            said = f"frame {of[id(worst)]} of {len(reports)} has least room: {said}"
        found.append(replace(worst, status=status, detail=said))
    return found


def list_effects(reports: Sequence[Report]) -> tuple[EffectLine, ...]:
    """List each effect once for all frames."""
    every = [report.effects for report in reports]
    return merge_lines(every, lambda line: (line.simulated, line.magnitude))


def _excess(line: LimitLine) -> float:
    return (line.measured - line.limit) * (-1.0 if line.name in LEAST else 1.0)


def merge_lines(frames: Iterable[Iterable[Line]], size: Callable[[Line], Any]) -> tuple[Line, ...]:
    """Return each line as in the frame where it is largest, with what it cost in all frames."""
    merged = []
    for lines in _by_name(frames):
        more: dict[str, Any] = {"calls": sum(line.calls for line in lines)}
        more["seconds"] = round(sum(line.seconds for line in lines), 4)
        stages = [stage for line in lines for stage in getattr(line, "where", ())]
        more |= {"where": tuple(dict.fromkeys(stages))} if stages else {}
        merged.append(replace(max(lines, key=size), **more))
    return tuple(merged)


def _by_name(frames: Iterable[Iterable[Named]]) -> list[list[Named]]:
    found: dict[str, list[Named]] = {}
    for line in (line for lines in frames for line in lines):
        found.setdefault(line.name, []).append(line)
    return list(found.values())
