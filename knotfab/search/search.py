"""The search, whole: depth, radius, the phases of the flow, and an end that is feasible or says why not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon
from torch import Tensor

from knotfab.effects.base import Decision, Limits, Situation
from knotfab.effects.region import tube_outside
from knotfab.effects.survey import survey
from knotfab.errors import SceneError
from knotfab.knots import Knot, Knots
from knotfab.scene.model import Region, View
from knotfab.search.depth import DepthChoice, choose_depth, lift
from knotfab.search.feasible import Standing, standing
from knotfab.search.flow import FlowSettings, flow
from knotfab.search.inn import circles, keep_largest, warp
from knotfab.search.legibility import stretched
from knotfab.search.neighbours import Neighbours
from knotfab.search.objective import Objective, Weights, iou_of
from knotfab.search.picture import frame_mm, picture_at
from knotfab.search.polyline import Rings, rings_of_sizes
from knotfab.search.resample import resample, subdivide
from knotfab.search.settings import SearchSettings
from knotfab.search.threads import one_thread
from knotfab.template.filling import Template, even_samples, simple_curves
from knotfab.template.named import knot_name
from knotfab.template.tie import Room, tie

__all__ = ["Account", "Infeasible", "Problem", "SearchResult", "search"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Report = Callable[[float, float | None], None]  # (fraction done, IoU)

_FLAT_RADII = 3.0  # depth of a flat piece: strands pass over each other, no more


@dataclass(frozen=True)
class Problem:
    """What is to be drawn, and what the knots must keep to (mm)."""

    view: View
    mask: Mask
    polygon: MultiPolygon  # the silhouette in the plane z = 0
    clearance: float
    bend_radius: float | None  # None: the tube radius plus half the clearance
    length: float
    region: Region
    depth_mm: float | None  # extent of the centre lines along the axis; None: flat
    knot: str = "unknot"  # tied into the longest curve

    def limits(self, radius: float) -> Limits:
        """The hard limits for a tube of this radius."""
        bend = max(self.bend_radius or 0.0, radius + 0.5 * self.clearance)
        return Limits(radius, self.clearance, bend, self.length, self.region)


@dataclass
class Account:
    """The certificates of a search, for its report."""

    template: str = ""
    types: tuple[str, ...] = ()  # of the knots
    accepted: int = 0
    shortened: int = 0
    refused: int = 0
    resamplings: int = 0
    resamplings_refused: int = 0
    least_margin_mm: float = float("inf")
    repairs: int = 0

    @property
    def certified(self) -> bool:
        """Whether every step from the template to the end is a proved isotopy."""
        return bool(self.template) and self.least_margin_mm > 0


@dataclass
class SearchResult:
    """Knots in scene coordinates, and how they came about."""

    knots: Knots
    standing: Standing
    account: Account
    effects: dict[str, Decision]
    depth: DepthChoice | None
    iou_estimate: float


class Infeasible(SceneError):
    """The search ended with a violated limit; `result` is the best it came to."""

    def __init__(self, result: SearchResult) -> None:
        self.result = result
        super().__init__(
            "the search",
            "; ".join(result.standing.violations),
            "Give the piece more room (a larger frame, a thinner tube, more depth), or loosen that limit.",
        )


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
        points, rings = _circled(problem, template, limits, account)
        depth = None
    else:
        points, rings, depth = _lifted(problem, template, limits, settings, account)
    pixel_mm = max(frame_mm(problem.view)) / settings.fine_px
    situation = Situation(problem.view, limits, points, rings, pixel_mm, settings.tolerance_px)
    effects = survey(situation)
    total = settings.coarse_iterations + settings.fine_iterations + settings.settle_iterations
    done = 0
    phases: tuple[tuple[int, int, Weights, tuple[float, float], tuple[float, float]], ...] = (
        (settings.coarse_px, settings.coarse_iterations, Weights(), (1.5, 3.0), (0.15, 0.06)),
        (
            settings.fine_px,
            settings.fine_iterations,
            Weights(clearance=3.0, bend=0.5),
            (3.0, 6.0),
            (0.06, 0.02),
        ),
        (
            settings.fine_px,
            settings.settle_iterations,
            Weights(clearance=20.0, bend=5.0, region=50.0),
            (6.0, 6.0),
            (0.03, 0.01),
        ),
    )
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
        points, rings = _evened(points, rings, settings.settle_edge_radii * radius, account)
    for pixels, iterations, weights, tau, rates in phases:
        if iterations == 0:
            continue
        last = done + iterations == total and settings.settle_iterations > 0
        spacing = settings.settle_edge_radii if last else settings.edge_radii
        points, rings = _evened(points, rings, spacing * radius, account)
        objective = _objective(
            problem, limits, rings, effects, pixels, weights, tau, settings, device
        )

        def tell(
            progress: float,
            _: float,
            base: int = done,
            n: int = iterations,
            iou: float | None = seen,
        ) -> None:
            if report is not None:
                report((base + progress * n) / total, iou)

        walk = FlowSettings(iterations=iterations, rate=rates[0], rate_end=rates[1])
        points = _walk(points, rings, objective, limits, walk, account, device, tell)
        done += iterations
        if report is not None or done == total:
            seen = iou_of(points, rings, objective.frame, objective.target, radius)
    state = standing(points, rings, limits)
    weight = 1.0
    if state.violations and repairs > 0:
        # a violation calls for what the bound beforehand did not
        for name in state.broken:
            effects[name].simulated = True
    while state.violations and account.repairs < repairs:
        # the picture gives way: ever less weight on it, ever more on the limits
        account.repairs += 1
        points, rings = _evened(points, rings, settings.settle_edge_radii * radius, account)
        weights = Weights(image=weight, clearance=40.0, bend=40.0, region=100.0, length=20.0)
        objective = _objective(
            problem, limits, rings, effects, settings.fine_px, weights, (6.0, 6.0), settings, device
        )
        walk = FlowSettings(iterations=60, rate=0.02 if weight == 1.0 else 0.04, rate_end=0.005)
        points = _walk(
            points,
            rings,
            objective,
            limits,
            walk,
            account,
            device,
            None,
            partial(_feasible, rings=rings, limits=limits),
        )
        state = standing(points, rings, limits)
        seen = iou_of(points, rings, objective.frame, objective.target, radius)
        weight *= 0.3
    parts = zip(rings.split(points), account.types, strict=True)
    knots = Knots(tuple(Knot(part, kind) for part, kind in parts), radius)
    result = SearchResult(knots, state, account, effects, depth, seen or 0.0)
    if state.violations and repairs > 0:
        raise Infeasible(result)
    return result


def _lifted(
    problem: Problem, template: Template, limits: Limits, settings: SearchSettings, account: Account
) -> tuple[Array, Rings, DepthChoice | None]:
    """The template's curves at their depths, evenly sampled: unknots by inspection."""
    light = problem.view.light_distance_mm
    flat = problem.depth_mm is None
    extent = _FLAT_RADII * limits.radius if problem.depth_mm is None else problem.depth_mm
    depth = choose_depth(
        template.curves,
        limits.radius,
        light,
        extent,
        stretched(problem.mask),
        1 if flat else settings.depth_candidates,
        settings.seed,
    )
    step = settings.edge_radii * limits.radius
    parts = [
        even_samples(lift(c, d, light), step)
        for c, d in zip(template.curves, depth.depths, strict=True)
    ]
    shadows = [p[:, :2] / (1.0 - p[:, 2:] / light) for p in parts]
    if not simple_curves(shadows):
        # even samples cut corners; the template's own vertices are simple as they stand
        parts = [lift(c, d, light) for c, d in zip(template.curves, depth.depths, strict=True)]
        shadows = list(template.curves)
    if not simple_curves(shadows):
        raise SceneError(
            "the filling template",
            "its curves cross each other",
            "This is a fault of knotfab: please report the picture",
        )
    account.template = (
        "simple and disjoint seen from the light: an unlink of unknots, by inspection"
    )
    account.types = ("unknot",) * len(parts)
    if problem.knot != "unknot":
        parts = _tied(problem, parts, limits, account)
    return np.concatenate(parts), rings_of_sizes(tuple(len(p) for p in parts)), depth


def _circled(
    problem: Problem, template: Template, limits: Limits, account: Account
) -> tuple[Array, Rings]:
    """A circle for each of the template's curves: unknots that are not linked."""
    if problem.knot != "unknot":
        raise SceneError(
            "scene key [search] network_start",
            f"a circle is an unknot, and a {problem.knot} is asked for",
            'Use network_start = "filling", which has the knot tied in',
        )
    parts = circles(template.curves, limits.radius, 2.0 * limits.separation)
    account.template = "one circle a knot, in parallel planes: an unlink of unknots, by inspection"
    account.types = ("unknot",) * len(parts)
    return np.concatenate(parts), rings_of_sizes(tuple(len(p) for p in parts))


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

    def objective_at(
        points: Array, rings: Rings, pixels: int, weights: Weights, tau: tuple[float, float]
    ) -> Objective:
        keep_largest(effects, survey(replace(situation, points=points, rings=rings)))
        limits = situation.limits
        return _objective(problem, limits, rings, effects, pixels, weights, tau, settings, device)

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


def _tied(problem: Problem, parts: list[Array], limits: Limits, account: Account) -> list[Array]:
    """The curves with the knot that is asked for tied into the longest of them."""
    wanted = knot_name(problem.knot)
    if not wanted.factors:
        return parts

    def outside(points: Array) -> float:
        ahead = np.roll(points, -1, axis=0)
        return float(tube_outside(points, ahead, limits.region, limits.radius)[1].max())

    room = Room(
        problem.polygon,
        problem.view.light_distance_mm,
        limits.radius,
        max(0.5 * limits.separation, limits.bend_radius),
        outside,
    )
    tied = tie(tuple(parts), wanted.factors, room)
    account.types = tuple(
        wanted.promise if k == tied.component else "unknot" for k in range(len(parts))
    )
    account.template += (
        f"; and a {wanted.promise} tied into knot {tied.component}, before or behind all strands that "
        "it hides: their connected sum"
    )
    return list(tied.curves)


def _evened(points: Array, rings: Rings, edge: float, account: Account) -> tuple[Array, Rings]:
    """Certified resampling; where it cannot be certified, new vertices on the long edges only."""
    fresh, fresh_rings, verdict = resample(points, rings, edge)
    if verdict.valid:
        account.resamplings += 1
        account.least_margin_mm = min(account.least_margin_mm, verdict.margin)
        return fresh, fresh_rings
    account.resamplings_refused += 1
    return subdivide(points, rings, edge)


def _feasible(points: Array, rings: Rings, limits: Limits) -> bool:
    return not standing(points, rings, limits).violations


def _walk(
    points: Array,
    rings: Rings,
    objective: Callable[[Tensor, Neighbours, float], Tensor],
    limits: Limits,
    walk: FlowSettings,
    account: Account,
    device: str,
    report: Callable[[float, float], None] | None,
    done: Callable[[Array], bool] | None = None,
) -> Array:
    """One phase of the flow, its certificates entered into the account."""
    result = flow(
        points, rings, objective, limits.radius, walk, device, report, done, limits.separation
    )
    account.accepted += result.accepted
    account.shortened += result.shortened
    account.refused += result.refused
    account.least_margin_mm = min(account.least_margin_mm, result.least_margin)
    return result.points


def _objective(
    problem: Problem,
    limits: Limits,
    rings: Rings,
    effects: dict[str, Decision],
    pixels: int,
    weights: Weights,
    tau: tuple[float, float],
    settings: SearchSettings,
    device: str,
) -> Objective:
    """The objective at a picture of `pixels` on its longer side."""
    frame, target, pixel_mm = picture_at(
        problem.view, problem.mask, pixels, effects["perspective"].simulated, device
    )
    view = problem.view
    magnified = (view.light_distance_mm + view.wall_distance_mm) / view.light_distance_mm
    return Objective(
        frame,
        target,
        rings,
        limits,
        effects,
        weights,
        tau,
        limits.radius * magnified / pixel_mm,
        settings.winners_every,
    )
