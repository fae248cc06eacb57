"""The search of a sequence: each frame's knot from that of the frame before, by certified steps alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Decision, Limits, Situation
from knotfab.effects.survey import survey
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings
from knotfab.problem import Account, Problem
from knotfab.render.picture import frame_mm, picture_at
from knotfab.render.threads import one_thread
from knotfab.scene.settings import SearchSettings
from knotfab.search.feasibility import Standing, standing
from knotfab.search.flow import FlowSettings
from knotfab.search.objective import Objective, iou_of
from knotfab.search.phases import Phase, objective_of, repair, three_phases
from knotfab.search.steps import walked
from knotfab.sequence.doubling import doubled
from knotfab.sequence.motion import Anchor, outline_motion
from knotfab.sequence.transport import transport

__all__ = ["FrameResult", "finish", "follow"]

Array = NDArray[np.float64]

_HOLD = 4.0  # weight of the motion bound in the objective
_REPAIRS = 6
_ROOM = 1.04  # times the bend radius that the part must keep
_TAUT = 0.05  # weight of the length beyond what the picture's area calls for


@dataclass
class FrameResult:
    """One frame's knot: `points` (N, 3) mm, scene coordinates, in the same order in all frames."""

    points: Array
    standing: Standing
    iou_estimate: float
    account: Account
    beyond_mm: float  # of the motion bound, at worst; negative where it is kept
    transported: float = 1.0  # share of the displacement that could be certified
    effects: dict[str, Decision] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether every limit holds, the motion's among them."""
        return not self.standing.violations and self.beyond_mm <= 0


def _phases(settings: SearchSettings) -> tuple[Phase, ...]:
    """Half as many iterations as from a template: the transport has done the rest."""
    return three_phases(settings.scaled(0.5), rates=(0.12, 0.06, 0.02))


def _repair(settings: SearchSettings, number: int) -> Phase:
    """Few vertices take all of a step that is measured over all: short ones end where they should."""
    rate = 0.01 * 0.7**number
    walk = FlowSettings(iterations=60, rate=rate, rate_end=0.1 * rate)
    return replace(repair(settings, number), walk=walk)


@one_thread()
def follow(
    before: Array,
    rings: Rings,
    problems: tuple[Problem, Problem],
    radius: float,
    settings: SearchSettings,
    taut_mm: float,
    anchors: Sequence[Anchor],
    device: str = "cpu",
    report: Callable[[float, float], None] | None = None,
) -> FrameResult:
    """A frame's knot from that of an earlier one, `before` (N, 3).

    Transport along the displacement between the two silhouettes, then the flow on the new picture with
    the motion bound in its objective; vertices keep their number and order.

    Args:
        problems: of the earlier frame and of this one.
        taut_mm: a longer knot is drawn taut: no vertices can be added, and long edges show.
        anchors: frames that this one must stay near.
    """
    old, new = problems
    # room for the vertices that `finish` adds: the spline bends more than the polygon in places
    new = replace(new, bend_radius=_ROOM * new.limits(radius).bend_radius)
    account = Account(template="the knot of an earlier frame")
    outline = outline_motion(old.polygon, new.polygon)
    moved = transport(
        before,
        rings,
        old.polygon,
        new.polygon,
        new.view.light_distance_mm,
        radius,
        outline + 0.5 * radius,
    )
    account.accepted, account.refused = moved.steps, moved.refused
    account.least_margin_mm = moved.least_margin
    result = _flowed(
        moved.points,
        rings,
        new,
        radius,
        settings,
        taut_mm,
        anchors,
        _phases(settings),
        account,
        device,
        report,
    )
    result.transported = moved.reached
    return result


@one_thread()
def finish(
    points: Array,
    rings: Rings,
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    anchors: Sequence[Anchor],
    account: Account,
    device: str = "cpu",
) -> FrameResult:
    """A frame for its part: twice as many vertices, and the limits repaired where that broke one."""
    fine, both, verdict = doubled(points, rings)
    if verdict.valid:
        account.resamplings += 1
        account.least_margin_mm = min(account.least_margin_mm, verdict.margin)
    else:
        account.resamplings_refused += 1
    return _flowed(
        fine, both, problem, radius, settings, np.inf, anchors, (), account, device, None
    )


def _flowed(
    points: Array,
    rings: Rings,
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    taut_mm: float,
    anchors: Sequence[Anchor],
    phases: Sequence[Phase],
    account: Account,
    device: str,
    report: Callable[[float, float], None] | None,
) -> FrameResult:
    limits = problem.limits(radius)
    pixel_mm = max(frame_mm(problem.view)) / settings.fine_px
    effects = survey(
        Situation(problem.view, limits, points, rings, pixel_mm, settings.tolerance_px)
    )
    for name in ("bend", "clearance"):
        effects[name].simulated = True
    seen = None
    repairs = [_repair(settings, k) for k in range(_REPAIRS)]
    for number, phase in enumerate([*phases, *repairs]):
        last = number >= len(phases)
        if last and not _wanting(points, rings, limits, anchors):
            break
        objective = objective_of(
            problem.view, problem.mask, limits, rings, effects, phase, settings, device
        )
        hold = _HOLD * (phase.weights.clearance if last else 1.0)

        def held(
            x: Tensor,
            near: Neighbours,
            progress: float,
            base: Objective = objective,
            weight: float = hold,
        ) -> Tensor:
            loss = base(x, near, progress)
            for anchor in anchors:
                loss = loss + weight * anchor.term(x, radius)
            length = (x[base.following] - x).norm(dim=-1).sum()
            excess = (length - taut_mm).clamp_min(0) / radius
            taut: Tensor = loss + _TAUT * excess**2
            return taut

        done = (lambda x: not _wanting(x, rings, limits, anchors)) if last else None
        points = walked(points, rings, held, limits, phase.walk, account, device, report, done)
        account.repairs += last
        seen = objective.iou(points)
    if seen is None:
        frame, target, _ = picture_at(problem.view, problem.mask, settings.fine_px, True, device)
        seen = iou_of(points, rings, frame, target, radius)
    beyond = max((a.beyond(points) for a in anchors), default=-np.inf)
    return FrameResult(
        points, standing(points, rings, limits), seen, account, beyond, effects=effects
    )


def _wanting(points: Array, rings: Rings, limits: Limits, anchors: Sequence[Anchor]) -> bool:
    """Whether a limit, or the motion's bound, is not kept."""
    if any(a.beyond(points) > 0 for a in anchors):
        return True
    return bool(standing(points, rings, limits).violations)
