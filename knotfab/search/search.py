"""Search from curves of known type for knots that draw every picture and keep every limit.

All builds share one search. A free view adds its pose to the unknowns, a frame of a sequence starts from an
earlier frame with terms that hold it near, and the paper's network is another way to move the curves.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.base.apps import load_app
from knotfab.base.arrays import Array
from knotfab.geometry.carry import subdivide
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import Polylines
from knotfab.limits.feasibility import Feasibility
from knotfab.problem import CertificateLog, Problem, Report, Start, Watch
from knotfab.search.flow import FlowSettings, Phase, Plan, plan_of
from knotfab.search.objective import Chamfer, Pose, Term, Weights
from knotfab.search.state import SearchResult, SearchState, begin_search, resample_state, run_phase
from knotfab_formats.search import SearchSettings

_SEEN_EVERY = 10  # iterations between measurements of the reported IoU
# iterations of each phase that brings a far start near, whatever the time budget
_APPROACH_ITERATIONS = 80
_APPROACH_RATES = 0.25, 0.2, 0.12  # step sizes of these phases, in tube radii


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
    begun: SearchState | None = None,
    device: str = "cpu",
    report: Report | None = None,
    watch: Watch | None = None,
) -> SearchResult:
    """Carry a start by certified steps to knots that draw every picture of the problem.

    The three phases have a coarse picture, a fine one, and high weights of the limits. While a limit is
    violated, mending and repairs follow, which give the picture less and less weight. With `settings.method`
    "inn" the paper's network replaces the three phases, and with "inn+flow" it precedes them.

    Args:
        radius: of the tube, mm.
        terms: further terms of the objective; those that are hard limits are repaired like limits.
        pose: the free pose of one view, or free directions of several. It is found in all phases but the
            last, before which the knots are turned into the axes of a single view.
        pace: sets the iterations of each phase by the clock; None: as the settings say.
        begun: the state in which a search from this start has ended, to go on from.
        log: the certified steps that led to the start, to be continued.
        device: where the paper's network runs: "cpu" or "cuda".
        plan: replaces the one that follows from the settings and the number of views.
        report: called with (share done, least IoU, which is measured now and then).
        watch: called each iteration with the present knots; it changes no result.

    Returns:
        The result, feasible or not; it says which limit is violated, by how much and where.
    """
    plan = plan or plan_of(settings, 1 if problem.apart_mm is not None else len(problem.views))
    state = begun or begin_search(
        problem, start, radius, settings, terms, pose, plan.keep_vertices, log, device
    )
    state.settings, state.watch = settings, watch
    if pose is not None:
        pose.keep(state.points)
    done = 0.0  # share of the search
    if plan.network:
        network = settings.network_iterations
        done = network / (network + sum(phase.iterations for phase in plan.phases))
        load_app("network").search_network(
            state, None if report is None else lambda part, iou: report(done * part, iou)
        )
    elif start.far and begun is None:
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
    walked = state.iterations + (settings.network_iterations if plan.network else 0)
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
        _tell_end(state, walked, pace is not None),
        state,
    )


def _tell_end(state: SearchState, walked: int, timed: bool) -> str:
    """Tell what ended a search: its iterations, then repairs until every limit held or none was left."""
    told = (
        f"the {walked} iterations that there was time for" if timed else f"all {walked} iterations"
    )
    if repairs := state.log.repairs:
        broken = state.breaks_limits(state.points)
        until = "the most there are, in vain" if broken else "until every limit held"
        told += f", then {repairs} round{'s' * (repairs > 1)} of repairs, {until}"
    return told


def _run_phases(
    state: SearchState, phases: tuple[Phase, ...], report: Report | None, pace: Pace | None = None
) -> None:
    """Run the phases that have iterations, and resample the curves before each."""
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
    """Fix the free pose, if there is one, and turn the knots into its axes."""
    if state.pose is None:
        return
    state.problem, state.points, state.numbers = state.pose.settle(state.problem, state.points)
    if state.numbers is not None:
        state.radius = state.numbers.radius_mm
    state.pose = None


def _approach(state: SearchState) -> None:
    """Move a start that is far from the pictures to them, by certified steps down the chamfer distance."""
    weights = Weights(image=0.0, clearance=60.0, bend=30.0)
    kept = state.terms
    state.terms += (Chamfer.for_views(state.problem.views, state.radius),)
    for rate in _APPROACH_RATES:
        walk = FlowSettings(
            iterations=_APPROACH_ITERATIONS, rate=rate, rate_end=0.3 * rate, smoothing=4.0
        )
        resample_state(state, state.settings.edge_radii * state.radius)
        run_phase(state, Phase(32, walk, weights, (1.0, 1.0), balanced=False))
    state.terms = kept


# A search by the clock.

_TRIED = 6  # iterations by which a phase is timed before it begins; their result is discarded
_LEAST = (20, 16, 12)  # least iterations of the phases from which a part is verified
_MOST = 5.0  # most iterations over the settings'; more gain nothing
_OVERHEAD = 0.5  # cost of an iteration apart from pixels, in units of a 256 px picture
_MENDING = 0.4  # extra cost of the last phase, for its closer vertices and for repairs


@dataclass
class Pace:
    """Set the iterations of the phases by the time that is left.

    Each phase is timed by a few iterations that are discarded, and then gets its share of the time left. So
    the last phase makes up for others that took too long. A phase depends on the clock only through its
    number of iterations, so a search with the same numbers does the same.

    Args:
        left: returns the seconds left for a search that ends with this many vertices.
    """

    left: Callable[[int], float]
    iterations: dict[int, int] = field(default_factory=dict)  # keyed by the phase's number

    def fit(self, state: SearchState, phases: Sequence[Phase], number: int) -> Phase:
        """Return phase `number` with as many iterations as there is time for."""
        each = self._seconds_each(state, phases[number])
        ahead = [
            phase.iterations * each * _cost(phase) / _cost(phases[number])
            for phase in phases[number:]
        ]
        ahead[-1] *= 1.0 + _MENDING
        factor = float(np.clip(self.left(len(state.points)) / sum(ahead), 0.0, _MOST))
        asked = phases[number]
        count = max(_LEAST[number], round(factor * asked.iterations))
        self.iterations[number] = count
        return replace(asked, walk=replace(asked.walk, iterations=count))

    def _seconds_each(self, state: SearchState, phase: Phase) -> float:
        """Measure the seconds per iteration of a phase, without changing the state."""
        spent = []
        # the first run loads compiled code; the difference of the others leaves out what each run begins with
        for count in (1, 1, 1 + _TRIED):
            tried = replace(
                state,
                log=copy.copy(state.log),
                guards=copy.deepcopy(state.guards),
                pose=copy.deepcopy(state.pose),
                balance=copy.deepcopy(state.balance),
                watch=None,
            )
            begun = time.perf_counter()
            run_phase(tried, replace(phase, walk=replace(phase.walk, iterations=count)))
            spent.append(time.perf_counter() - begun)
        return max(spent[2] - spent[1], 0.1 * spent[2]) / _TRIED


def _cost(phase: Phase) -> float:
    """Return the relative cost of an iteration: its pixels, plus a constant."""
    return _OVERHEAD * 256.0**2 + phase.pixels**2


# Repairs after the phases.

_REACH = 4.0  # half the length of a stretch around a violation, in tube radii
_ITERATIONS = 60  # of each mending
# length that edges are cut by, over the spacing; edges 1.5 times as long are halved
_STRETCHED = 0.87
_RATE, _RATE_END = 0.04, 0.005  # root-mean-square step of the vertices that move, in tube radii


def repair(state: SearchState, plan: Plan) -> None:
    """Mend and repair until every limit holds, or the plan's rounds are used up."""
    if plan.repairs == 0 or not state.breaks_limits(state.points):
        return
    # usually a few bends are left, for which the whole curve need not move
    mended = mend_stretches(state, plan.repair(0), plan.mendings)
    while state.log.repairs < plan.repairs and state.breaks_limits(state.points):
        resample_state(state, state.settings.settle_edge_radii * state.radius)
        phase = plan.repair(state.log.repairs)
        state.log.repairs += 1
        run_phase(state, phase, until_kept=True)
    state.log.repairs += mended


def mend_stretches(state: SearchState, phase: Phase, rounds: int) -> int:
    """Move only the stretches that violate a limit, with the weights of `phase`; return the rounds taken.

    Each round frees the stretches that violate a limit then. Excess length has no stretch, so it remains.
    Edges that a round has stretched are halved, since their mitres would stand out.
    """
    edge_mm = _STRETCHED * state.settings.settle_edge_radii * state.radius
    for done in range(rounds):
        _cut_long_edges(state, edge_mm)
        feasibility = state.feasibility()
        loose = find_stretches(state.points, state.rings, feasibility)
        if not feasibility.violations or not loose.any():
            return done
        # the flow's rates are root mean squares over all vertices, including fixed ones
        share = float(np.sqrt(loose.mean()))
        walk = FlowSettings(iterations=_ITERATIONS, rate=_RATE * share, rate_end=_RATE_END * share)
        run_phase(state, replace(phase, walk=walk), until_kept=True, loose=loose)
    _cut_long_edges(state, edge_mm)
    return rounds


def _cut_long_edges(state: SearchState, edge_mm: float) -> None:
    if not state.keep_vertices:
        state.points, state.rings = subdivide(state.points, state.rings, edge_mm)


def find_stretches(points: Array, rings: Polylines, feasibility: Feasibility) -> NDArray[np.bool_]:
    """Mark the vertices near violated bends, the narrowest gap or the place furthest outside, (N,)."""
    limits = feasibility.limits
    places = [points[bend_radii(points, rings) < limits.bend_radius]]
    if "clearance" in feasibility.broken:
        places.append(feasibility.gap_at[None])
    if "region" in feasibility.broken:
        places.append(feasibility.outside_at[None])
    every = np.concatenate(places)
    if len(every) == 0:
        return np.zeros(len(points), dtype=bool)
    apart, _ = cKDTree(every).query(points)
    return np.asarray(apart < _REACH * limits.radius)
