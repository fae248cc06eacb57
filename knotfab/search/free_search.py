"""Knots, view and tube radius found together: the certified flow with the view's numbers as unknowns.

The numbers come back as a scene's view and radius, so that a build can run on them as on any fixed scene.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Decision, Limits, Situation, State
from knotfab.effects.survey import survey
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings, rings_of_sizes
from knotfab.knots import Knot, Knots
from knotfab.problem import Account, Problem, Report, SearchResult
from knotfab.render.free_frame import Sheet, render_free, turn_matrix, winners_of
from knotfab.render.picture import frame_mm, picture_at
from knotfab.render.threads import one_thread
from knotfab.scene.model import View
from knotfab.scene.settings import SearchSettings
from knotfab.search.feasibility import Standing, standing
from knotfab.search.objective import Weights, iou_of
from knotfab.search.phases import SETTLE, Phase, repair, three_phases
from knotfab.search.pose import Bounds, Unknowns, ViewNumbers, projected_radius
from knotfab.search.search import search
from knotfab.search.steps import evened, walked
from knotfab.start.depth import DepthChoice
from knotfab.start.filling import Template

__all__ = ["FreeObjective", "FreeSearch", "free_search"]

Array = NDArray[np.float64]
_CUTOFF = 5.0  # sigmoid(-5) = 0.7 %: what is further out pulls on nothing
_SHARP = 12.0  # tau times the projected radius that the view's numbers are judged by
_CHANGE = 1e-4  # relative change of the radius that the limits' slope is measured over


@dataclass(frozen=True)
class FreeSearch:
    """Where the joint search ended.

    `knots` stand in the axes of `view`: azimuth, elevation and roll are in the knots, and the view
    looks along z, as a scene with one view has it.
    """

    knots: Knots
    view: View
    numbers: ViewNumbers
    result: SearchResult  # of a search at that view and radius


@dataclass
class FreeObjective:
    """The loss of points and view, for `flow`: each call also moves the view's numbers one step.

    The value and the gradient with respect to the points are exact; the gradient with respect to the
    view goes to `unknowns`, unless they are `held`.
    """

    problem: Problem
    unknowns: Unknowns
    sheet: Sheet
    target: Tensor  # [height, width]
    rings: Rings
    effects: dict[str, Decision]
    weights: Weights
    tau: tuple[float, float]  # in units of one over the projected tube radius
    winners_every: int
    held: bool = False
    calls: int = 0
    won: tuple[Tensor, Tensor] | None = None
    following: Tensor = field(init=False)

    def __post_init__(self) -> None:
        self.following = torch.as_tensor(self.rings.next)
        # at the start of the phase: a unit that grew with the radius would reward growing
        self.radius_px = projected_radius(self.unknowns.numbers(), self.sheet)

    def __call__(self, points: Tensor, near: Neighbours, progress: float) -> Tensor:
        soft = self.tau[0] * (self.tau[1] / self.tau[0]) ** progress / self.radius_px
        if self.calls % self.winners_every == 0:
            self.won = self.winners(points, soft)
        self.calls += 1
        loss = self.weights.image * self.image_term(points, soft, self.won)
        loss = loss + self.limit_terms(points, near, self.unknowns.radius_mm, self.weights)
        if self.held:
            return loss
        (of_points,) = torch.autograd.grad(loss, points)
        # a soft picture shows touching strands as a dark seam and so rewards a thicker tube: the view's
        # numbers answer to a sharp one
        fixed = points.detach()
        image = self.image_term(fixed, _SHARP / self.radius_px, self.won)
        exact = image + self.limit_terms(fixed, near, self.unknowns.radius_mm, SETTLE)
        turn, logs = torch.autograd.grad(exact, self.unknowns.tensors)
        slope = torch.tensor([0.0, 0.0, self.radius_slope(fixed, near)], dtype=logs.dtype)
        self.unknowns.move((turn, logs + slope), fixed.numpy(), progress)
        # a plane of the same height and slope: the flow asks for no more
        return loss.detach() + ((points - fixed) * of_points).sum()

    def winners(self, points: Tensor, tau: float) -> tuple[Tensor, Tensor]:
        """(pixel, capsule) of the present picture at `tau`."""
        p = points.detach().to(self.target.dtype)
        frame = self.unknowns.frame(self.sheet, self.target.dtype)
        return winners_of(p, p[self.following], frame, tau, _CUTOFF)

    def image_term(self, points: Tensor, tau: float, won: tuple[Tensor, Tensor] | None) -> Tensor:
        """Squared difference of the images, integrated, in squared projected tube radii."""
        p = points.to(self.target.dtype)
        frame = self.unknowns.frame(self.sheet, self.target.dtype)
        image = render_free(p, p[self.following], frame, tau, _CUTOFF, won)
        return (((image - self.target) ** 2).sum() / self.radius_px**2).to(points.dtype)

    def limit_terms(
        self, points: Tensor, near: Neighbours, radius_mm: float, weights: Weights
    ) -> Tensor:
        """The terms of the effects that are simulated, for a tube of this radius, in the view's axes."""
        turned = points @ turn_matrix(self.unknowns.turn_deg)
        edge = turned[self.following] - turned
        spacing = float(edge.detach().norm(dim=-1).mean())
        state = State(turned, edge, edge[self.following], self.following, self.rings, near, spacing)
        limits = self.problem.limits(radius_mm)
        total = points.new_zeros(())
        for name, decision in self.effects.items():
            if decision.simulated and decision.effect.term is not None:
                total = total + getattr(weights, name) * decision.effect.term(state, limits)
        return total

    def radius_slope(self, points: Tensor, near: Neighbours) -> float:
        """Change of `limit_terms` with the logarithm of the radius, by a central difference."""
        with torch.no_grad():
            r = self.unknowns.radius_mm
            more = self.limit_terms(points, near, r * (1 + _CHANGE), SETTLE)
            less = self.limit_terms(points, near, r * (1 - _CHANGE), SETTLE)
        return float(more - less) / (2 * _CHANGE)


@dataclass
class _Walker:
    """The joint search on its way: curves, unknowns and the account of certificates."""

    problem: Problem
    settings: SearchSettings
    unknowns: Unknowns
    effects: dict[str, Decision]
    points: Array
    rings: Rings
    account: Account

    def even(self, edge_mm: float) -> None:
        self.points, self.rings = evened(self.points, self.rings, edge_mm, self.account)

    def walk(self, phase: Phase, held: bool, until_feasible: bool = False) -> None:
        """One phase of the flow."""
        sheet, target = _sheet(self.problem, phase.pixels)
        objective = FreeObjective(
            self.problem,
            self.unknowns,
            sheet,
            target,
            self.rings,
            self.effects,
            phase.weights,
            phase.tau,
            self.settings.winners_every,
            held,
        )

        def feasible(points: Array) -> bool:
            return not self.standing(points).violations

        done = feasible if until_feasible else None
        self.points = walked(
            self.points,
            self.rings,
            objective,
            self.limits(),
            phase.walk,
            self.account,
            "cpu",
            None,
            done,
        )

    def limits(self) -> Limits:
        return self.problem.limits(self.unknowns.radius_mm)

    def standing(self, points: Array) -> Standing:
        """Against the limits at the present numbers, in the view's axes."""
        return standing(points @ self.unknowns.numbers().turn, self.rings, self.limits())

    def round(self) -> None:
        """The lengths as a scene file would have them, held from here on."""
        n = self.unknowns.numbers()
        light, wall = round(n.light_distance_mm, 2), round(n.wall_distance_mm, 2)
        rounded = ViewNumbers(
            light, wall, round(n.radius_mm, 4), n.azimuth_deg, n.elevation_deg, n.roll_deg
        )
        self.unknowns = Unknowns(rounded, self.unknowns.bounds)


def _sheet(problem: Problem, pixels: int) -> tuple[Sheet, Tensor]:
    """The raster and the target at `pixels` on the picture's longer side."""
    frame, target, pixel_mm = picture_at(problem.view, problem.mask, pixels, True, "cpu")
    return Sheet(frame.width, frame.height, pixel_mm, problem.view.wall_tilt_deg), target


@one_thread()
def free_search(
    problem: Problem,
    template: Template,
    radius_mm: float,
    settings: SearchSettings,
    bounds: Bounds,
    report: Report | None = None,
    repairs: int = 4,
) -> FreeSearch:
    """Knots, view and radius whose shadow is the picture, from a template at the problem's view.

    The phases of `search`: coarse and fine with every number of `bounds.free` unknown, then one at the
    numbers found that weighs the limits most, and repairs until every limit holds. What is left of
    a violation stands in `result.standing`.
    """
    none = {
        "method": "flow",
        "coarse_iterations": 0,
        "fine_iterations": 0,
        "settle_iterations": 0,
    }
    lifted = search(problem, template, radius_mm, settings.model_copy(update=none), repairs=0)
    view = problem.view
    start = ViewNumbers(view.light_distance_mm, view.wall_distance_mm, radius_mm)
    points = lifted.knots.points
    rings = rings_of_sizes(tuple(len(k.points) for k in lifted.knots.knots))
    pixel_mm = max(frame_mm(view)) / settings.fine_px
    limits = problem.limits(radius_mm)
    effects = survey(Situation(view, limits, points, rings, pixel_mm, settings.tolerance_px))
    unknowns = Unknowns(start, bounds)
    unknowns.keep(points)
    walker = _Walker(problem, settings, unknowns, effects, points, rings, lifted.account)
    phases = three_phases(settings)
    for number, phase in enumerate(phases):
        last = number == len(phases) - 1
        if last:
            walker.round()
        spacing = settings.settle_edge_radii if last else settings.edge_radii
        walker.even(spacing * walker.unknowns.radius_mm)
        walker.walk(phase, held=last)
        if report is not None:
            report((number + 1) / len(phases), None)
    while walker.account.repairs < repairs:
        broken = walker.standing(walker.points).broken
        if not broken:
            break
        phase = repair(settings, walker.account.repairs)
        walker.account.repairs += 1
        for name in broken:
            effects[name].simulated = True
        walker.even(settings.settle_edge_radii * walker.unknowns.radius_mm)
        walker.walk(phase, held=True, until_feasible=True)
    return _found(walker, lifted.depth)


def _found(walker: _Walker, depth: DepthChoice | None) -> FreeSearch:
    """The end of the search as knots in the axes of its view."""
    numbers = walker.unknowns.numbers()
    sheet, target = _sheet(walker.problem, walker.settings.fine_px)
    frame = walker.unknowns.frame(sheet, target.dtype).fixed()
    iou = iou_of(walker.points, walker.rings, frame, target, numbers.radius_mm)
    turned = walker.points @ numbers.turn
    view = walker.problem.view.model_copy(
        update={
            "light_distance_mm": numbers.light_distance_mm,
            "wall_distance_mm": numbers.wall_distance_mm,
        }
    )
    parts = zip(walker.rings.split(turned), walker.account.types, strict=True)
    knots = Knots(tuple(Knot(part, kind) for part, kind in parts), numbers.radius_mm)
    ended = walker.standing(walker.points)
    result = SearchResult(knots, ended, walker.account, walker.effects, depth, iou)
    return FreeSearch(knots, view, numbers, result)
