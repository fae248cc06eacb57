"""Report effects and limits, one line each, and warn if the scene switches an effect off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import radians, sin
from typing import TYPE_CHECKING

from knotfab.render.pages import length
from knotfab_formats.report import EffectLine, LimitLine
from knotfab_formats.verdict import Misplacement, Sag, Verdict, View, WorstMove

if TYPE_CHECKING:
    from knotfab.base.arrays import Array, Mask
    from knotfab.design.design import Design
    from knotfab.effects.base import Decision
    from knotfab.picture.read import Target
    from knotfab.search.state import SearchResult
    from knotfab_formats.scene import ResolvedScene

# how the report's keys read
LAMP_WAYS = {"right": "to the side", "up": "up or down", "towards": "nearer or farther"}
TURN_WAYS = {"up": "left or right", "right": "forward or back", "axis": "like a wheel"}
_GAIN = 0.01  # a gain of brightness error from which on a nearer wall is worth a word


def list_effects(result: SearchResult, verdict: Verdict) -> tuple[EffectLine, ...]:
    """List for each effect what the design did, and what the verification measured."""
    lines = []
    for name, decision in result.effects.items():
        runs = [getattr(view, name, None) for view in verdict.views]
        verified = sum(getattr(run, "samples", 0) for run in runs)
        calls, where = decision.calls + verified, tuple(decision.where)
        seconds = round(decision.seconds, 4)
        if verified:
            where = (*where, "verification")
            seconds = round(seconds + verdict.seconds.get(name, 0.0), 4)
        lines.append(
            EffectLine(
                name=name,
                simulated=calls > 0,
                forced=decision.forced is not None,
                where=where,
                magnitude=decision.magnitude,
                threshold=decision.threshold,
                unit=decision.effect.unit,
                calls=calls,
                seconds=seconds,
                reason=decision.reason
                + ("; nothing ran it" if decision.simulated and not calls else ""),
            )
        )
    return tuple(lines)


def list_limits(result: SearchResult) -> tuple[LimitLine, ...]:
    """List for each limit what was measured at the end, and how often its term was called."""
    return tuple(
        LimitLine(
            name=name,
            limit=limit,
            measured=measured,
            unit="mm",
            calls=result.guards[name].calls,
            seconds=round(result.guards[name].seconds, 4),
        )
        for name, (measured, limit) in result.feasibility.figures.items()
    )


def tell_warnings(effects: Mapping[str, Decision]) -> list[str]:
    """Warn about each effect that is switched off although the scene calls for it."""
    return [decision.warning for decision in effects.values() if decision.warning is not None]


def judge_made(
    made: Design, scene: ResolvedScene, moves: Array | None, upwards: Array | None
) -> None:
    """Judge the effects again, now that the piece is mounted and posed.

    The written mesh is judged, whose mitres and corners stand out of the round tube.

    Args:
        scene: with its mount resolved. moves: (N, 3) how far its mount lets each vertex sag, mm.
        upwards: (3,) the printer's, in the scene; None where it is not printed.
    """
    from knotfab.effects.base import EffectContext, World
    from knotfab.effects.survey import survey
    from knotfab.geometry.tube import reach_mm

    knots, settings, world = made.knots, made.settings, World.from_scene(scene)
    reach = max(reach_mm(k.points, knots.radius_mm, settings.mesh_sides) for k in knots.knots)
    context = EffectContext(
        made.scene.views, knots.points, reach, settings.tolerance_px, world, moves, upwards
    )
    for name, fresh in survey(context, {}).items():
        if name in made.result.effects:
            made.result.effects[name].keep_largest(fresh)


def list_sags(made: Design, moves: Array | None, masks: Sequence[Mask]) -> list[Sag | None]:
    """Measure how much of the knots' shadow each view keeps when the mount sags.

    None without a mount, or where it sags too little to be simulated.

    Args:
        moves: (N, 3) of each vertex, mm. masks: (H, W) the views' pictures.
    """
    from knotfab.effects.shifts import SAG, measure_sag

    decision, knots = made.result.effects.get(SAG.name), made.knots
    if decision is None or moves is None or len(moves) == 0 or not decision.simulated:
        return [None for _ in made.scene.views]
    sags: list[Sag | None] = []
    for view, mask in zip(made.scene.views, masks, strict=True):
        with decision.called("report"):
            sags.append(measure_sag(view, mask, knots.points, moves, knots.rings, knots.radius_mm))
    return sags


def tell_move(
    move: WorstMove, off: Misplacement, kind: str, threads_apart_mm: float | None = None
) -> str:
    """Describe a misplacement, as "the lamp 5 mm to the side"; `kind` is the view's.

    Args:
        threads_apart_mm: distance of the two threads that the piece hangs on.
    """
    if move.of == "turn":
        if threads_apart_mm is None or move.way == "right":
            return f"the piece turned by {off.turn_deg:g}° {TURN_WAYS[move.way]}"
        apart = length(threads_apart_mm * sin(radians(off.turn_deg)))
        how = "nearer the wall" if move.way == "up" else "longer"
        return f"one thread {apart} mm {how} than the other"
    if move.of == "tilt":
        return f"the wall tilted by {off.tilt_deg:g}° {TURN_WAYS[move.way]}"
    what = "eye" if kind == "eye" else "lamp"
    return f"the {what} {off.lamp_mm:g} mm {LAMP_WAYS[move.way]}"


def list_views(
    views: Sequence[View], made: Design, targets: Sequence[Target], sags: Sequence[Sag | None]
) -> list[View]:
    """Add to each of the validators' views what the maker knows of its picture and effects.

    That is the rule by which the picture was read; for several views the `bound`, the best IoU of a part
    without spill; and the file of what is drawn, if that was bent. A part may have no views.
    """
    bounds = {v.name: b.iou for v, b in zip(made.scene.views, made.bounds, strict=False)}
    files = {view.name: view.drawn_picture for view in made.scene.views}
    each = zip(views, targets, sags, strict=False)
    return [
        replace(
            view,
            silhouette=target.rule,
            picture_notes=tuple(target.notes) or None,
            bound=bounds.get(view.name),
            drawn=files[view.name] if bounds and view.bending is not None else None,
            sag=sag,
        )
        for view, target, sag in each
    ]


def tell_bounds(made: Design, targets: Sequence[Target]) -> list[str]:
    """Say how several pictures were made to agree, and where they contradict each other.

    For one view there is nothing to say: nothing contradicts a single picture.
    """
    from knotfab.design.agree import tell_bending
    from knotfab.design.hull import contradictions

    if not made.bounds:
        return []
    bent = any(target.bending is not None for target in targets)
    said = [f"The pictures are {tell_bending(targets, made.bounds)}."] if bent else []
    return [*said, *contradictions(made.scene.views, made.bounds)]
