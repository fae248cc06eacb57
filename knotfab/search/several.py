"""The search for several views: the certified flow under the pictures of all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Decision, Limits, Situation
from knotfab.effects.region import REGION
from knotfab.effects.survey import judged, survey
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings, rings_of_sizes
from knotfab.knots import Knot, Knots
from knotfab.problem import Account, Infeasible, Report, SearchResult
from knotfab.render.picture import frame_mm
from knotfab.render.threads import one_thread
from knotfab.scene.camera import camera_of
from knotfab.scene.model import Region, View
from knotfab.scene.settings import SearchSettings
from knotfab.search.balance import Balance, goals_of
from knotfab.search.chamfer import chamfer_of
from knotfab.search.feasibility import standing
from knotfab.search.flow import FlowSettings
from knotfab.search.objective import Objective, Weights
from knotfab.search.phases import Phase, objective_of, repair, three_phases
from knotfab.search.repair import mended
from knotfab.search.spill import Spill, spill_of
from knotfab.search.steps import evened, repaired, simulate, through, walked

__all__ = ["SeveralProblem", "SeveralResult", "Shot", "search_several", "view_axes"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# of a strand that stands a tube radius outside, against one tube radius squared of image
_SPILL = 0.5
_LOCAL = 4  # repairs of single stretches, before any of the whole curve
_BALANCED_EVERY = 20  # iterations between looks at what each view falls short of


@dataclass(frozen=True)
class Shot:
    """One view and the silhouette wanted there."""

    view: View
    mask: Mask


@dataclass(frozen=True)
class SeveralProblem:
    """What is asked: silhouettes of several views (frames resolved), and the limits. Lengths in mm.

    With `bounds`, the IoU of the hull's own shadow in each view, a view that falls short of its own counts
    for more than one that does not.
    """

    shots: tuple[Shot, ...]
    clearance: float
    bend: float | None  # None: the tube radius plus half the clearance
    length: float
    region: Region
    bounds: tuple[float, ...] | None = None

    def limits(self, radius: float) -> Limits:
        """The hard limits for a tube of this radius."""
        thick = radius + 0.5 * self.clearance
        return Limits(
            radius, self.clearance, max(self.bend or thick, thick), self.length, self.region
        )


@dataclass
class SeveralObjective:
    """The objective of one view with all its effects, and the pictures of the others.

    A `balance`, where there is one, shares the weight of the image out among the views as it goes.
    """

    first: Objective
    others: tuple[Objective, ...]
    spills: tuple[Spill, ...] = ()
    balance: Balance | None = None
    image: float = field(init=False)  # the weight of each view's image before it is shared out
    calls: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.image = self.first.weights.image

    def __call__(self, points: Tensor, near: Neighbours, progress: float) -> Tensor:
        if self.balance is not None and self.calls % _BALANCED_EVERY == 0:
            self._share(points.detach().cpu().numpy(), self.balance)
        self.calls += 1
        loss = self.first(points, near, progress)
        for other in self.others:
            loss = loss + other.weights.image * other.image_term(points, progress)
        spacing = float((points[self.first.following] - points).detach().norm(dim=-1).mean())
        for spill in self.spills:
            loss = loss + _SPILL * self.image * spill(points, spacing)
        return loss

    def _share(self, points: Array, balance: Balance) -> None:
        balance.update(self.ious(points))
        for one, share in zip((self.first, *self.others), balance.shares.tolist(), strict=True):
            one.weights = replace(one.weights, image=self.image * share)

    def ious(self, points: Array) -> tuple[float, ...]:
        """The hard silhouettes' IoU with the target, view by view."""
        return tuple(one.iou(points) for one in (self.first, *self.others))

    def iou(self, points: Array) -> float:
        """That of the view that is drawn worst."""
        return min(self.ious(points))


@dataclass
class SeveralResult(SearchResult):
    """`iou_estimate` is the least of `ious`, one a view."""

    ious: tuple[float, ...] = ()


def view_axes(view: View) -> Array:
    """(3, 3) rows: the view's right, up and towards its light, in the scene."""
    camera = camera_of(view.model_copy(update={"wall_tilt_deg": 0.0}), 2, 2)
    right = camera.du / np.linalg.norm(camera.du)
    up = -camera.dv / np.linalg.norm(camera.dv)
    return np.stack([right, up, np.cross(right, up)])


def _survey(
    problem: SeveralProblem, limits: Limits, points: Array, rings: Rings, settings: SearchSettings
) -> dict[str, Decision]:
    """The effects, with those of a view judged by the view where they are largest."""
    effects: dict[str, Decision] = {}
    for shot in problem.shots:
        pixel = max(frame_mm(shot.view)) / settings.fine_px
        seen = points @ view_axes(shot.view).T
        own = Situation(shot.view, limits, seen, rings, pixel, settings.tolerance_px)
        # the region lies in the scene's axes, not in the view's
        every = survey(own) | {REGION.name: judged(REGION, replace(own, points=points))}
        for name, decision in every.items():
            if name not in effects or decision.magnitude > effects[name].magnitude:
                effects[name] = decision
    return effects


def _objective(
    problem: SeveralProblem,
    limits: Limits,
    rings: Rings,
    effects: dict[str, Decision],
    phase: Phase,
    settings: SearchSettings,
    device: str,
) -> SeveralObjective:
    """The objective of one phase, under the pictures of all views."""
    each = [
        objective_of(shot.view, shot.mask, limits, rings, effects, phase, settings, device)
        for shot in problem.shots
    ]
    return SeveralObjective(each[0], tuple(each[1:]))


def _drawn_near(
    problem: SeveralProblem,
    points: Array,
    rings: Rings,
    limits: Limits,
    effects: dict[str, Decision],
    settings: SearchSettings,
    account: Account,
    device: str,
) -> tuple[Array, Rings]:
    """A start that is far from the pictures, brought near by the chamfer distance, certified as ever."""
    shots = [(shot.view, shot.mask) for shot in problem.shots]
    weights = Weights(image=0.0, clearance=60.0, bend=30.0)
    for rate in (0.25, 0.2, 0.12):
        walk = FlowSettings(
            iterations=settings.coarse_iterations, rate=rate, rate_end=0.3 * rate, smoothing=4.0
        )
        near = Phase(32, walk, weights, (1.0, 1.0))
        points, rings = evened(points, rings, settings.edge_radii * limits.radius, account)
        kept = _objective(problem, limits, rings, effects, near, settings, device)
        far = chamfer_of(shots, kept.first, limits.radius, device)
        points = walked(points, rings, far, limits, near.walk, account, device, None)
    return points, rings


@one_thread()
def search_several(
    problem: SeveralProblem,
    curves: Sequence[Array],
    template: str,
    radius: float,
    settings: SearchSettings,
    device: str = "cpu",
    report: Report | None = None,
    repairs: int = 10,
    kind: str = "unknot",
) -> SeveralResult:
    """The flow from `curves` to knots that draw every picture and keep the limits.

    Args:
        problem: what is asked.
        curves: closed polylines (n, 3), mm, of known type; `template` says why it is known.
        radius: tube radius, mm.
        report: called with (progress of the search from 0 to 1, the least IoU at the last phase's end).
        repairs: rounds spent on what still violates a limit after the last phase; with 0 a violation
            is returned as it stands.

    Raises:
        Infeasible: a limit stays violated after all repairs.
    """
    limits = problem.limits(radius)
    account = Account(template=template, types=(kind,) * len(curves))
    points = np.concatenate(list(curves))
    rings = rings_of_sizes(tuple(len(c) for c in curves))
    effects = _survey(problem, limits, points, rings, settings)
    phases = three_phases(settings, softest=1.0, rates=(0.2, 0.08, 0.03))
    if settings.network_start == "circle":
        points, rings = _drawn_near(
            problem, points, rings, limits, effects, settings, account, device
        )

    balance = None if problem.bounds is None else Balance(goals_of(problem.bounds))

    def objective_at(rings: Rings, phase: Phase) -> SeveralObjective:
        objective = _objective(problem, limits, rings, effects, phase, settings, device)
        if phase is phases[0]:  # later a spill may stay that draws as much elsewhere
            objective.spills = tuple(
                spill_of(s.view, s.mask, radius, device) for s in problem.shots
            )
        else:  # the coarse picture is too soft to say what a view falls short of
            objective.balance = balance
        return objective

    points, rings, drawn = through(
        points, rings, phases, objective_at, limits, settings, account, device, report
    )
    local = 0  # most often a few bends are left, and the whole curve need not give way for them
    broken = standing(points, rings, limits).broken
    if broken and repairs > 0:
        simulate(effects, broken)
        first = repair(settings, 0)
        points, rings, local = mended(
            points,
            rings,
            lambda rings: objective_at(rings, first),
            limits,
            settings.settle_edge_radii * radius,
            account,
            device,
            _LOCAL,
        )
        drawn = objective_at(rings, first)
    points, rings, state, late = repaired(
        points, rings, effects, objective_at, limits, settings, account, device, repairs, rounds=2
    )
    account.repairs += local
    last = late or drawn
    ious = last.ious(points) if last is not None else ()
    parts = zip(rings.split(points), account.types, strict=True)
    knots = Knots(tuple(Knot(part, name) for part, name in parts), radius)
    least = min(ious) if ious else 0.0
    result = SeveralResult(knots, state, account, effects, None, least, ious)
    if state.violations and repairs > 0:
        raise Infeasible(result)
    return result
