"""The search, whole: depth, radius, the phases of the flow, and an end that is feasible or says why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from knotfab.effects.base import Decision, Situation
from knotfab.effects.survey import survey
from knotfab.geometry.polylines import Rings
from knotfab.knots import Knot, Knots
from knotfab.problem import Account, Infeasible, Problem, Report, SearchResult
from knotfab.render.picture import frame_mm
from knotfab.render.threads import one_thread
from knotfab.scene.settings import SearchSettings
from knotfab.search.inn import keep_largest, warp
from knotfab.search.objective import Objective
from knotfab.search.phases import Phase, objective_of, three_phases
from knotfab.search.steps import evened, repaired, through
from knotfab.start.filling import Template
from knotfab.start.lift import circled, lifted

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

    def objective_at(rings: Rings, phase: Phase) -> Objective:
        return objective_of(
            problem.view, problem.mask, limits, rings, effects, phase, settings, device
        )

    phases = () if settings.method == "inn" else three_phases(settings)
    seen: float | None = None
    begun = 0.0  # share of the search that is over when the flow begins
    if settings.method != "flow":
        network = settings.network_iterations
        begun = network / (network + sum(phase.iterations for phase in phases))
        points, rings, seen = _warped(
            objective_at,
            situation,
            effects,
            settings,
            account,
            device,
            None if report is None else lambda part, iou: report(begun * part, iou),
        )
    if not phases:
        points, rings = evened(points, rings, settings.settle_edge_radii * radius, account)
    points, rings, drawn = through(
        points,
        rings,
        phases,
        objective_at,
        limits,
        settings,
        account,
        device,
        None if report is None else lambda part, iou: report(begun + (1.0 - begun) * part, iou),
        seen,
    )
    points, rings, state, mended = repaired(
        points, rings, effects, objective_at, limits, settings, account, device, repairs
    )
    last = mended or drawn
    if last is not None:
        seen = last.iou(points)
    parts = zip(rings.split(points), account.types, strict=True)
    knots = Knots(tuple(Knot(part, kind) for part, kind in parts), radius)
    result = SearchResult(knots, state, account, effects, depth, seen or 0.0)
    if state.violations and repairs > 0:
        raise Infeasible(result)
    return result


def _warped(
    objective_of_polygons: Callable[[Rings, Phase], Objective],
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
        return objective_of_polygons(rings, phase)

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
