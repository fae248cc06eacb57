"""The steps that a search is made of, each entered into its account of certificates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Limits
from knotfab.search.feasible import standing
from knotfab.search.flow import FlowSettings, flow
from knotfab.search.neighbours import Neighbours
from knotfab.search.polyline import Rings
from knotfab.search.problem import Account
from knotfab.search.resample import resample, subdivide

__all__ = ["evened", "feasible", "walked"]

Array = NDArray[np.float64]


def evened(points: Array, rings: Rings, edge: float, account: Account) -> tuple[Array, Rings]:
    """Certified resampling; where it cannot be certified, new vertices on the long edges only."""
    fresh, fresh_rings, verdict = resample(points, rings, edge)
    if verdict.valid:
        account.resamplings += 1
        account.least_margin_mm = min(account.least_margin_mm, verdict.margin)
        return fresh, fresh_rings
    account.resamplings_refused += 1
    return subdivide(points, rings, edge)


def feasible(points: Array, rings: Rings, limits: Limits) -> bool:
    return not standing(points, rings, limits).violations


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
