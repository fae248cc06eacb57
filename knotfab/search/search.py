"""The search, whole: depth, radius, the phases of the flow, and an end that is feasible or says why not."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from knotfab.effects.base import Decision, Situation
from knotfab.effects.survey import survey
from knotfab.knots import Knot, Knots
from knotfab.search.feasible import standing
from knotfab.search.inn import keep_largest, warp
from knotfab.search.objective import Objective, iou_of
from knotfab.search.phases import Phase, objective_of, repair, three_phases
from knotfab.search.picture import frame_mm
from knotfab.search.polyline import Rings
from knotfab.search.problem import Account, Infeasible, Problem, Report, SearchResult
from knotfab.search.settings import SearchSettings
from knotfab.search.start import circled, lifted
from knotfab.search.threads import one_thread
from knotfab.search.walking import evened, feasible, walked
from knotfab.template.filling import Template

__all__ = ["Account", "Infeasible", "Problem", "Report", "SearchResult", "search"]

Array = NDArray[np.float64]


@one_thread()
def search(
    problem: Problem,
    template: Template,
    radius: float,
    settings: SearchSettings,
    device: str = "cpu",
    report: Report | None = None,
    repairs: int = 4,
) -> SearchResult:
    """Knots whose shadow is the picture, from a filling template.

    Three phases: coarse picture, fine picture, and one that weighs the limits most; then repairs, each
    with less weight on the picture, until every limit holds. With `settings.method` "inn" the paper's
    network takes the place of the three phases, and with "inn+flow" it comes before them.

    Raises:
        Infeasible: a limit is still violated at the end: which, by how much and where.
    """
    limits = problem.limits(radius)
    account = Account()
    if settings.method != "flow" and settings.network_start == "circle":
        points, rings = circled(problem, template, limits, account)
        depth = None
    else:
        points, rings, depth = lifted(problem, template, limits, settings, account)
    pixel_mm = max(frame_mm(problem.view)) / settings.fine_px
    situation = Situation(problem.view, limits, points, rings, pixel_mm, settings.tolerance_px)
    effects = survey(situation)
    total = settings.coarse_iterations + settings.fine_iterations + settings.settle_iterations
    done = 0
    phases: tuple[Phase, ...] = three_phases(settings)
    seen: float | None = None
    if settings.method != "flow":
        total += settings.network_iterations
        share = settings.network_iterations / (
            settings.network_iterations if settings.method == "inn" else total
        )
        points, rings, seen = _warped(
            problem,
            situation,
            effects,
            settings,
            account,
            device,
            None if report is None else lambda part, iou: report(share * part, iou),
        )
        done = settings.network_iterations
    if settings.method == "inn":
        phases = phases[:0]
        points, rings = evened(points, rings, settings.settle_edge_radii * radius, account)
    for phase in phases:
        if phase.iterations == 0:
            continue
        last = done + phase.iterations == total and settings.settle_iterations > 0
        spacing = settings.settle_edge_radii if last else settings.edge_radii
        points, rings = evened(points, rings, spacing * radius, account)
        objective = objective_of(problem, limits, rings, effects, phase, settings, device)

        def tell(
            progress: float,
            _: float,
            base: int = done,
            n: int = phase.iterations,
            iou: float | None = seen,
        ) -> None:
            if report is not None:
                report((base + progress * n) / total, iou)

        points = walked(points, rings, objective, limits, phase.walk, account, device, tell)
        done += phase.iterations
        if report is not None or done == total:
            seen = iou_of(points, rings, objective.frame, objective.target, radius)
    state = standing(points, rings, limits)
    if state.violations and repairs > 0:
        # a violation calls for what the bound beforehand did not
        for name in state.broken:
            effects[name].simulated = True
    while state.violations and account.repairs < repairs:
        phase = repair(settings, account.repairs)
        account.repairs += 1
        points, rings = evened(points, rings, settings.settle_edge_radii * radius, account)
        objective = objective_of(problem, limits, rings, effects, phase, settings, device)
        met = partial(feasible, rings=rings, limits=limits)
        points = walked(points, rings, objective, limits, phase.walk, account, device, None, met)
        state = standing(points, rings, limits)
        seen = iou_of(points, rings, objective.frame, objective.target, radius)
    parts = zip(rings.split(points), account.types, strict=True)
    knots = Knots(tuple(Knot(part, kind) for part, kind in parts), radius)
    result = SearchResult(knots, state, account, effects, depth, seen or 0.0)
    if state.violations and repairs > 0:
        raise Infeasible(result)
    return result


def _warped(
    problem: Problem,
    situation: Situation,
    effects: dict[str, Decision],
    settings: SearchSettings,
    account: Account,
    device: str,
    report: Report | None,
) -> tuple[Array, Rings, float]:
    """The network's search from the curves of `situation`: polygons, and their IoU."""

    def objective_at(points: Array, rings: Rings, phase: Phase) -> Objective:
        keep_largest(effects, survey(replace(situation, points=points, rings=rings)))
        return objective_of(problem, situation.limits, rings, effects, phase, settings, device)

    found = warp(
        situation.points, situation.rings, objective_at, situation.limits, settings, device, report
    )
    account.accepted += found.steps
    account.least_margin_mm = min(account.least_margin_mm, found.least_margin)
    if found.proved:
        account.template += (
            f"; carried along the invertible network in {found.steps} steps, with "
            f"{found.refinements} doublings of its samples"
        )
    else:
        account.template += (
            "; the invertible network mapped it to where no sampling could be certified"
        )
    return found.points, found.rings, found.iou
