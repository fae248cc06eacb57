"""The search: from curves of known type to knots that draw every picture and keep every limit.

There is one search. One view is the case of several; a free view has its pose among the unknowns; a frame
of a sequence starts from the frame before, with terms that hold it near; and the paper's network differs
from the flow in moving curves.
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
from knotfab.knots import Knots
from knotfab.limits.feasibility import Feasibility
from knotfab.problem import CertificateLog, Problem, Report, SearchResult, Start, Watch
from knotfab.search.flow import FlowSettings, Phase, Plan, plan_of
from knotfab.search.objective import Chamfer, Pose, Term, Weights
from knotfab.search.state import SearchState, begin, resample_state, run_phase
from knotfab_formats.search import SearchSettings

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
    device: str = "cpu",
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
        device: where the pictures are drawn, and where the network runs: "cpu", "cuda".
        plan: instead of the one that follows from the settings and the number of views.
        report: called with (share of the search that is done, least IoU, measured now and then).
        watch: called each iteration with the knots as they stand; it changes no result.

    Returns:
        The result says itself whether it is feasible, or which limit is violated, by how much and where.
    """
    plan = plan or plan_of(settings, 1 if problem.apart_mm is not None else len(problem.views))
    state = begin(problem, start, radius, settings, terms, pose, plan.keep_vertices, log, device)
    state.watch = watch
    if pose is not None:
        pose.keep(state.points)
    done = 0.0  # share of the search
    if plan.network:
        network = settings.network_iterations
        done = network / (network + sum(phase.iterations for phase in plan.phases))
        load_app("network").search_network(
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


# A search that watches the clock: how many iterations each phase gets is settled when it begins.


_TRIED = 6  # iterations by which a phase is timed before it begins; they are taken back
_LEAST = (20, 16, 12)  # iterations of the phases, that a verified part needs
_MOST = 5.0  # factor of the settings' iterations: more has nothing to gain
_OVERHEAD = 0.5  # a share of an iteration that even a picture of no pixels would cost
_MENDING = 0.4  # the last phase's extra cost, for its closer vertices and repairs, as a share


@dataclass
class Pace:
    """Iterations of the phases by the seconds that are left.

    A phase is timed by a few iterations that are taken back, and gets its share of what is left by then: so
    the last one, which ends feasible, makes up for what the others took too much. The number of iterations
    alone decides what a phase does: a search that is given the same numbers does the same.

    Args:
        left: seconds that the search may still take, where it ends with so many vertices.
    """

    left: Callable[[int], float]
    iterations: dict[int, int] = field(default_factory=dict)  # keyed by the phase's number

    def fit(self, state: SearchState, phases: Sequence[Phase], number: int) -> Phase:
        """Return the phase of this number with as many iterations as there is time for."""
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
        """Return seconds of an iteration of a phase from where the search stands, which is left as it is."""
        spent = []
        # the first loads what is compiled; what every phase does at its beginning falls out of the others
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
    """Weigh an iteration against others of the same search: by its pixels, plus a constant."""
    return _OVERHEAD * 256.0**2 + phase.pixels**2


# Repair a violated limit after the phases: stretches alone first, then the whole curve.


_REACH = 4.0  # tube radii of a stretch about a violation
_ITERATIONS = 60
_STRETCHED = 0.87  # a share of the spacing: an edge half as long again as that is cut in two
_RATE, _RATE_END = 0.04, 0.005  # root-mean-square step of the vertices that move, in tube radii


def repair(state: SearchState, plan: Plan) -> None:
    """Mend and repair until every limit holds, or the plan's rounds are used up."""
    if plan.repairs == 0 or not state.wanting(state.points):
        return
    # most often a few bends are left, and the whole curve need not give way for them
    mended = mend_stretches(state, plan.repair(0), plan.mendings)
    while state.log.repairs < plan.repairs and state.wanting(state.points):
        resample_state(state, state.settings.settle_edge_radii * state.radius)
        phase = plan.repair(state.log.repairs)
        state.log.repairs += 1
        run_phase(state, phase, until_kept=True)
    state.log.repairs += mended


def mend_stretches(state: SearchState, phase: Phase, rounds: int) -> int:
    """Mend what violates a limit where it can be, by the weights of `phase`; the rounds that took.

    Every round lets go of the stretches that violate a limit then. Too great a length is no matter of
    a stretch, and stays. Steps are certified as everywhere. Edges that a round has stretched are cut in
    two: by the bend radius they may turn further, and their mitres would stand out.
    """
    edge_mm = _STRETCHED * state.settings.settle_edge_radii * state.radius
    for done in range(rounds):
        _cut_long_edges(state, edge_mm)
        feasibility = state.feasibility()
        loose = find_stretches(state.points, state.rings, feasibility)
        if not feasibility.violations or not loose.any():
            return done
        # the flow's rates are root mean squares over all vertices, moved or not
        share = float(np.sqrt(loose.mean()))
        walk = FlowSettings(iterations=_ITERATIONS, rate=_RATE * share, rate_end=_RATE_END * share)
        run_phase(state, replace(phase, walk=walk), until_kept=True, loose=loose)
    _cut_long_edges(state, edge_mm)
    return rounds


def _cut_long_edges(state: SearchState, edge_mm: float) -> None:
    if not state.keep_vertices:
        state.points, state.rings = subdivide(state.points, state.rings, edge_mm)


def find_stretches(points: Array, rings: Polylines, feasibility: Feasibility) -> NDArray[np.bool_]:
    """Find [N] True near a violated bend, the narrowest violated gap or the place furthest outside."""
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


# A search to look back on: its knots, now and then.


class History:
    """The kept states of a search, `most` at most, spread evenly over its iterations.

    It is handed to the search as its `watch`. When it is full every other state is dropped, and half as
    many are taken from there on, so that few more are made than are kept.
    """

    def __init__(self, most: int = 24) -> None:
        self.states: list[Knots] = []
        self._most, self._every, self._seen = most, 1, 0

    def __call__(self, knots: Callable[[], Knots], certified: bool) -> None:
        """Take the knots as they stand, where their turn has come."""
        if self._seen % self._every == 0:
            self.states.append(knots())
        self._seen += 1
        if len(self.states) > self._most:
            self.states = self.states[::2]
            self._every *= 2
