"""The search: from curves of known type to knots that draw every picture and keep every limit.

There is one search. One view is the case of several; a free view has its pose among the unknowns; a frame
of a sequence starts from the frame before, with terms that hold it near; and the paper's network differs
from the flow in moving curves.
"""

from __future__ import annotations

from collections.abc import Callable

from knotfab.problem import CertificateLog, Problem, Report, SearchResult, Start, Watch
from knotfab.render.forms import COMPILED, Forms
from knotfab.search.chamfer import Chamfer
from knotfab.search.flow import FlowSettings
from knotfab.search.objective import Term, Weights
from knotfab.search.pace import Pace
from knotfab.search.phases import Phase, Plan, plan_of
from knotfab.search.pose import Pose
from knotfab.search.repair import repair
from knotfab.search.state import SearchState, begin, resample_state, run_phase
from knotfab_formats.search import SearchSettings

__all__ = ["search"]

_SEEN_EVERY = 10  # iterations between measurements of the IoU that is reported
# iterations of each: no setting, since those of a time budget are not known yet
_APPROACH_ITERATIONS = 80
# rates of the phases that bring a far start near, in tube radii
_APPROACH_RATES = 0.25, 0.2, 0.12


def search(
    problem: Problem,
    start: Start,
    radius: float,
    settings: SearchSettings,
    *,
    terms: tuple[Term, ...] = (),
    pose: Pose | None = None,
    plan: Plan | None = None,
    log: CertificateLog | None = None,
    pace: Pace | None = None,
    forms: Forms = COMPILED,
    report: Report | None = None,
    watch: Watch | None = None,
) -> SearchResult:
    """Return knots that draw every picture of the problem, carried there from the start by certified steps.

    Three phases: coarse picture, fine picture, and one that weighs the limits most; then, while a limit
    is violated, mending and repairs, which give the picture ever less weight. With `settings.method`
    "inn" the paper's network takes the place of the three phases, with "inn+flow" it comes before them.

    Args:
        radius: radius of the tube, mm.
        terms: further parts of the objective; those that are hard limits are repaired as limits are.
        pose: pose of the one view, or directions of several, where these are unknowns: found along in all
            phases but the last, before which the knots are turned into the axes of the one view found.
        pace: settles the iterations of each phase by the clock; None: those that the settings say.
        log: the certified steps that led to the start, to be continued.
        forms: what draws pictures, and what moves, where the settings ask for other than the core has.
        plan: instead of the one that follows from the settings and the number of views.
        report: called with (share of the search that is done, least IoU, measured now and then).
        watch: called each iteration with the knots as they stand; it changes no result.

    Returns:
        The result says itself whether it is feasible, or which limit is violated, by how much and where.
    """
    plan = plan or plan_of(settings, 1 if problem.apart_mm is not None else len(problem.views))
    state = begin(problem, start, radius, settings, terms, pose, plan.keep_vertices, log, forms)
    state.watch = watch
    if pose is not None:
        pose.keep(state.points)
    done = 0.0  # share of the search
    if plan.network:
        network = settings.network_iterations
        done = network / (network + sum(phase.iterations for phase in plan.phases))
        forms.search_network(
            state, None if report is None else lambda part, iou: report(done * part, iou)
        )
    elif start.far:
        _approach(state)
    if not plan.phases:
        _settle_pose(state)
        resample_state(state, settings.settle_edge_radii * state.radius)
    _run_phases(
        state,
        plan.phases,
        None if report is None else lambda part, iou: report(done + (1.0 - done) * part, iou),
        pace,
    )
    _settle_pose(state)
    repair(state, plan)
    return SearchResult(
        state.knots_at(state.points, state.rings),
        state.feasibility(),
        state.log,
        state.effects,
        start.depth,
        state.ious(),
        tuple(v.view for v in state.problem.views),
        state.numbers,
        state.guards,
    )


def _run_phases(
    state: SearchState, phases: tuple[Phase, ...], report: Report | None, pace: Pace | None = None
) -> None:
    """Run the phases that have iterations, each from evenly spaced vertices on."""
    settings = state.settings
    total, done = sum(phase.iterations for phase in phases), 0
    seen: float | None = None
    for number, phase in enumerate(phases):
        if number == len(phases) - 1:
            _settle_pose(state)
        if phase.iterations == 0:
            continue
        last = done + phase.iterations == total and settings.settle_iterations > 0
        spacing = settings.settle_edge_radii if last else settings.edge_radii
        resample_state(state, spacing * state.radius)
        walked = phase if pace is None else pace.fit(state, phases, number)

        def tell(
            progress: float,
            measure_iou: Callable[[], float],
            base: int = done,
            n: int = phase.iterations,
            steps: int = walked.iterations,
        ) -> None:
            nonlocal seen
            if report is not None:
                if round(progress * (steps - 1)) % _SEEN_EVERY == 0:
                    seen = measure_iou()
                report((base + progress * n) / total, seen)

        run_phase(state, walked, tell)
        done += phase.iterations


def _settle_pose(state: SearchState) -> None:
    """End the search for the pose: from here on the knots stand in the axes of the view found."""
    if state.pose is None:
        return
    state.problem, state.points, state.numbers = state.pose.settle(state.problem, state.points)
    if state.numbers is not None:
        state.radius = state.numbers.radius_mm
    state.pose = None


def _approach(state: SearchState) -> None:
    """Bring a start that is far from the pictures near, by the chamfer distance, certified as ever."""
    weights = Weights(image=0.0, clearance=60.0, bend=30.0)
    kept = state.terms
    state.terms += (Chamfer.of(state.problem.views, state.radius),)
    for rate in _APPROACH_RATES:
        walk = FlowSettings(
            iterations=_APPROACH_ITERATIONS,
            rate=rate,
            rate_end=0.3 * rate,
            smoothing=4.0,
        )
        resample_state(state, state.settings.edge_radii * state.radius)
        run_phase(state, Phase(32, walk, weights, (1.0, 1.0), balanced=False))
    state.terms = kept
