"""Hold the state of a search (vertices, objective, certificates), and run its single phases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.effects.base import Decision, EffectContext
from knotfab.effects.survey import survey
from knotfab.geometry.carry import resample, subdivide
from knotfab.geometry.measures import Neighbours
from knotfab.geometry.polylines import Polylines, polylines_of
from knotfab.knots import Knot, Knots
from knotfab.limits.feasibility import Feasibility, guard_limits, measure_feasibility
from knotfab.limits.terms import Guard, Limits
from knotfab.problem import (
    Braced,
    CertificateLog,
    DepthChoice,
    Problem,
    Start,
    ViewNumbers,
    Watch,
    brace,
)
from knotfab.render.image import ViewImage
from knotfab.search.flow import Between, Phase
from knotfab.search.objective import (
    TENSION_ARCHED,
    TENSION_LYING,
    Grace,
    Objective,
    Pose,
    Spill,
    Term,
)
from knotfab.search.upright import Upright
from knotfab_formats.scene import ResolvedView
from knotfab_formats.search import SearchSettings

_SHORT = 0.015  # IoU by which a goal is below the view's bound; settling and repairs cost some more
_GAIN = 30.0  # an update multiplies a share by e^0.3 for each 0.01 of shortfall beyond the mean
_KEPT = 0.9  # share of the logarithm that is kept at an update, so that shares fade back to equal
_MOST = 4.0  # largest share, and the inverse of the least
_BALANCED_EVERY = 20  # iterations between updates of the shares


def goals_of(bounds: Sequence[float]) -> tuple[float, ...]:
    """Return the IoU that each view should reach, from the visual hull's bounds."""
    return tuple(bound - _SHORT for bound in bounds)


@dataclass
class Balance:
    """Weights of three or more views, larger for views that fall short of their goals.

    `shares` (n,) have the mean 1, and fade back to equal when no view falls short. This is the multiplicative
    weights method (Arora, Hazan & Kale 2012, section 2) on the shortfalls, with a fading memory.
    """

    goals: tuple[float, ...]
    shares: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        self.shares = np.ones(len(self.goals))

    def update(self, ious: Sequence[float]) -> NDArray[np.float64]:
        """Update the shares by the present IoU of each view, and return them."""
        short = np.maximum(np.array(self.goals) - np.array(ious), 0.0)
        moved = self.shares**_KEPT * np.exp(_GAIN * (short - short.mean()))
        moved = np.clip(moved, 1.0 / _MOST, _MOST)
        self.shares = np.asarray(moved / moved.mean())
        return self.shares


@dataclass
class SearchState:
    """The vertices `points` (N, 3), mm, of the polylines `rings`, and all that the search depends on.

    `pose` is the free pose of one view, or the free directions of several, until it is settled.
    """

    problem: Problem
    radius: float
    settings: SearchSettings
    points: Array
    rings: Polylines
    log: CertificateLog
    effects: dict[str, Decision]
    guards: dict[str, Guard]
    terms: tuple[Term, ...] = ()
    pose: Pose | None = None
    keep_vertices: bool = False
    device: str = "cpu"  # where the paper's network runs
    balance: Balance | None = None
    numbers: ViewNumbers | None = None  # of the pose, once it is settled
    watch: Watch | None = None
    iterations: int = 0  # that the flow has run

    @property
    def limits(self) -> Limits:
        """The hard limits at the present radius."""
        return self.problem.limits(self.radius)

    def knots_at(self, points: Array, rings: Polylines) -> Knots:
        """Build knots, with their known types, from the vertices (N, 3) of polylines."""
        parts = zip(rings.split(points), self.log.types, strict=True)
        return Knots(tuple(Knot(part, kind) for part, kind in parts), self.radius)

    def feasibility(self) -> Feasibility:
        """Measure the hard limits on the present polylines."""
        return measure_feasibility(self.points, self.rings, self.limits)

    def breaks_limits(self, points: Array) -> bool:
        """Return whether vertices (N, 3) break a limit, or a term that acts as one."""
        if not all(term.kept(points) for term in self.terms):
            return True
        return bool(measure_feasibility(points, self.rings, self.limits).violations)

    def judge_effects(self) -> None:
        """Judge every effect on the present polylines; an effect once simulated stays so."""
        views = tuple(v.view for v in self.problem.views)
        tolerance = self.settings.tolerance_px
        world = self.problem.world.holding(len(self.rings.sizes))
        context = EffectContext(views, self.points, self.radius, tolerance, world)
        for name, fresh in survey(context, self.problem.switches).items():
            if name in self.effects:
                self.effects[name].keep_largest(fresh)
            else:
                self.effects[name] = fresh

    def ious(self) -> tuple[float, ...]:
        """Measure the IoU of each view at the resolution of the fine phase."""
        images = self._images(self.settings.fine_px)
        return tuple(i.iou(self.points, self.rings, self.radius) for i in images)

    def _images(self, pixels: int) -> tuple[ViewImage, ...]:
        asked = self.settings
        given = (self.radius, pixels, asked.precision, asked.renderer)
        return tuple(v.image_at(*given) for v in self.problem.views)

    def objective(self, phase: Phase, loose: NDArray[np.bool_] | None = None) -> Objective:
        """Build the objective of a phase; `loose` (N,) marks the vertices that may move (None: all)."""
        terms = self.terms
        if phase.spill:
            terms += tuple(Spill.for_view(v, self.radius) for v in self.problem.views)
        if phase.knobs:
            terms += tuple(Spill.for_knobs(v, self.radius) for v in self.problem.views)
        objective = Objective(
            self._images(phase.pixels),
            self.rings,
            self.limits,
            self.guards,
            phase.weights,
            phase.tau,
            terms,
            loose,
        )
        if self.pose is not None:
            self.pose.show(objective, self.problem)
        return objective

    def between(self, objective: Objective, phase: Phase) -> Between:
        """Return the callback that updates dominant capsules, pose and shares between a phase's steps."""
        balance = self.balance if phase.balanced else None

        def update(points: Array, near: Neighbours, iteration: int, progress: float) -> None:
            if iteration % self.settings.winners_every == 0:
                objective.find_winners(points, progress)
            if self.pose is not None:
                self.pose.descend(objective, self.problem, points, near, progress)
                self.radius = self.pose.radius_mm
            if balance is not None and iteration % _BALANCED_EVERY == 0:
                objective.shares = balance.update(objective.ious(points))

        return update


@dataclass(repr=False)
class SearchResult:
    """The knots in scene coordinates, how they were found, and whether they are feasible.

    Where `feasible` is False, `feasibility.violations` says which limit is broken, by how much and where.
    `views` are those of the problem, or the one that a search with an unknown pose found, in whose axes
    the knots stand (`numbers` says how that view is turned relative to the one asked for). `ended` tells
    how many iterations and repairs there were, and why no more.
    """

    knots: Knots
    feasibility: Feasibility
    log: CertificateLog
    effects: dict[str, Decision]
    depth: DepthChoice | None
    ious: tuple[float, ...]  # one per view, as the search measured them
    views: tuple[ResolvedView, ...]
    numbers: ViewNumbers | None
    guards: Mapping[str, Guard]  # by the limit's name
    ended: str
    state: SearchState  # in which the search ended: another may go on from it

    @property
    def iou_estimate(self) -> float:
        """The IoU of the worst view."""
        return min(self.ious, default=0.0)

    @property
    def feasible(self) -> bool:
        """True if every limit holds."""
        return not self.feasibility.violations

    @cached_property
    def braced(self) -> Braced:
        """Its legs and bars, where strands stand in arches, for a further search and for the part."""
        problem = self.state.problem
        return brace(self.knots, problem.views[0], problem.world)

    def add_work(self, earlier: SearchResult) -> None:
        """Add the calls and seconds that an earlier search spent on limits and effects."""
        for name, guard in earlier.guards.items():
            self.guards[name].add(guard)
        for name, decision in earlier.effects.items():
            self.effects[name].add(decision)


def begin_search(
    problem: Problem,
    start: Start,
    radius: float,
    settings: SearchSettings,
    terms: tuple[Term, ...] = (),
    pose: Pose | None = None,
    keep_vertices: bool = False,
    log: CertificateLog | None = None,
    device: str = "cpu",
) -> SearchState:
    """Build the state at the start of a search, with the effects judged there."""
    if settings.grace > 0:
        tension = TENSION_ARCHED if problem.arched else TENSION_LYING
        terms += (Grace(radius, settings.grace, tension),)
    points = np.concatenate(start.curves)
    if problem.arched:
        up = problem.views[0].axes[2]
        floor, top = float((points @ up).min()), float((points @ up).max())
        terms += (Upright(radius, up, floor, top),)
    state = SearchState(
        problem,
        radius,
        settings,
        points,
        polylines_of(start.curves),
        log or CertificateLog(start.why, start.types),
        {name: replace(found, where=list(found.where)) for name, found in start.effects.items()},
        guard_limits(),
        terms,
        pose,
        keep_vertices,
        device,
        None if problem.goals is None else Balance(problem.goals),
    )
    state.judge_effects()
    return state


def resample_state(state: SearchState, edge_mm: float) -> None:
    """Resample the polylines if that can be certified, or else only halve their long edges."""
    if state.keep_vertices:
        return
    points, rings, verdict = resample(state.points, state.rings, edge_mm)
    if verdict.valid:
        state.log.resamplings += 1
        state.log.add_margin(verdict.margin)
    else:
        state.log.resamplings_refused += 1
        points, rings = subdivide(state.points, state.rings, edge_mm)
    state.points, state.rings = points, rings


def run_phase(
    state: SearchState,
    phase: Phase,
    report: Callable[[float, Callable[[], float]], None] | None = None,
    until_kept: bool = False,
    loose: NDArray[np.bool_] | None = None,
) -> Objective:
    """Run one phase of the certified flow; with `until_kept` it ends as soon as every limit holds.

    Args:
        report: called each iteration with (share of the phase, a function that measures the least IoU).

    Returns:
        The objective at the end of the phase.
    """
    objective = state.objective(phase, loose)
    limits, rings = state.limits, state.rings

    def tell(progress: float, points: Array) -> None:
        if state.watch is not None:
            state.watch(lambda: state.knots_at(points, rings), state.log.certified)
        if report is not None:
            report(progress, lambda: min(objective.ious(points)))

    # imported here, for nothing before a search needs torch
    from knotfab.search.optimizer import descend
    from knotfab.search.term import TorchTerm

    # torch differentiates terms that are written in torch
    own = [term.loss for term in objective.terms if isinstance(term, TorchTerm)]
    objective.terms = tuple(t for t in objective.terms if not isinstance(t, TorchTerm))

    result = descend(
        state.points,
        state.rings,
        objective,
        limits.radius,
        phase.walk,
        tell,
        (lambda x: not state.breaks_limits(x)) if until_kept else None,
        limits.separation,
        state.between(objective, phase),
        own,
    )
    state.points = result.points
    state.iterations += len(result.losses)
    state.log.accepted += result.accepted
    state.log.shortened += result.shortened
    state.log.refused += result.refused
    state.log.add_margin(result.least_margin)
    return objective
