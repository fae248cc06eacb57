"""The steps that a search is made of, each entered into its account of certificates: a resampling, a
walk of the flow, the phases one after another, and the repairs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Decision, Limits
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings
from knotfab.geometry.resample import resample, subdivide
from knotfab.problem import Account, Report
from knotfab.scene.settings import SearchSettings
from knotfab.search.feasibility import Standing, standing
from knotfab.search.flow import FlowSettings, flow
from knotfab.search.phases import Phase, repair

__all__ = ["Drawing", "evened", "met_by", "repaired", "simulate", "through", "walked"]

Array = NDArray[np.float64]


class Drawing(Protocol):
    """A loss of the flow that also knows how well points (N, 3) draw what is asked."""

    def __call__(self, points: Tensor, near: Neighbours, progress: float) -> Tensor: ...

    def iou(self, points: Array) -> float: ...


D = TypeVar("D", bound=Drawing)


def evened(points: Array, rings: Rings, edge: float, account: Account) -> tuple[Array, Rings]:
    """Certified resampling; where it cannot be certified, new vertices on the long edges only."""
    fresh, fresh_rings, verdict = resample(points, rings, edge)
    if verdict.valid:
        account.resamplings += 1
        account.least_margin_mm = min(account.least_margin_mm, verdict.margin)
        return fresh, fresh_rings
    account.resamplings_refused += 1
    return subdivide(points, rings, edge)


def walked(
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


def through(
    points: Array,
    rings: Rings,
    phases: Sequence[Phase],
    objective_at: Callable[[Rings, Phase], D],
    limits: Limits,
    settings: SearchSettings,
    account: Account,
    device: str,
    report: Report | None,
    seen: float | None = None,
) -> tuple[Array, Rings, D | None]:
    """The phases that have iterations, each from evenly spaced vertices on.

    Args:
        report: called with (the share of all iterations that is done, IoU at the last phase's end).
        seen: IoU at the start.

    Returns:
        Vertices, rings and the last phase's objective; None where no phase has iterations.
    """
    total, done = sum(phase.iterations for phase in phases), 0
    objective: D | None = None
    for phase in phases:
        if phase.iterations == 0:
            continue
        last = done + phase.iterations == total and settings.settle_iterations > 0
        spacing = settings.settle_edge_radii if last else settings.edge_radii
        points, rings = evened(points, rings, spacing * limits.radius, account)
        objective = objective_at(rings, phase)

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
        if report is not None:
            seen = objective.iou(points)
    return points, rings, objective


def simulate(effects: dict[str, Decision], broken: Sequence[str]) -> None:
    """A violation calls for what the bound beforehand did not: from here on these are simulated."""
    for name in broken:
        effects[name].simulated = True


def met_by(rings: Rings, limits: Limits) -> Callable[[Array], bool]:
    """Whether vertices (N, 3) on these rings keep every limit."""
    return lambda points: not standing(points, rings, limits).violations


def repaired(
    points: Array,
    rings: Rings,
    effects: dict[str, Decision],
    objective_at: Callable[[Rings, Phase], D],
    limits: Limits,
    settings: SearchSettings,
    account: Account,
    device: str,
    repairs: int,
    rounds: int = 1,
) -> tuple[Array, Rings, Standing, D | None]:
    """Repairs until every limit holds, or their number is used up.

    Args:
        effects: those that are violated count as simulated from here on.
        rounds: repairs before the picture gives way further.

    Returns:
        Vertices, rings, how they stand, and the last repair's objective; None where none was needed.
    """
    state = standing(points, rings, limits)
    objective: D | None = None
    if state.violations and repairs > 0:
        simulate(effects, state.broken)
    while state.violations and account.repairs < repairs:
        phase = repair(settings, account.repairs // rounds)
        account.repairs += 1
        points, rings = evened(points, rings, settings.settle_edge_radii * limits.radius, account)
        objective = objective_at(rings, phase)

        met = met_by(rings, limits)
        points = walked(points, rings, objective, limits, phase.walk, account, device, None, met)
        state = standing(points, rings, limits)
    return points, rings, state, objective
