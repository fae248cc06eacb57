"""Repairs that move only the stretches about a violated limit, and leave the rest of the curve as it is.

After a search of thousands of vertices a handful bend too tightly. A repair of the whole curve costs
the picture everywhere, and resampling it cuts new corners; these few stretches can be mended alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor

from knotfab.effects.base import Limits
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings
from knotfab.geometry.resample import subdivide
from knotfab.problem import Account
from knotfab.search.feasibility import Standing, standing
from knotfab.search.flow import FlowSettings
from knotfab.search.steps import met_by, walked

__all__ = ["about", "mended"]

Array = NDArray[np.float64]
Loss = Callable[[Tensor, Neighbours, float], Tensor]

_REACH = 4.0  # of a stretch about a violation, in tube radii
_ITERATIONS = 60
_STRETCHED = 0.87  # of an edge, half as much again of which is cut in two
_RATE, _RATE_END = 0.04, 0.005  # root-mean-square step of the vertices that move, in tube radii


def about(points: Array, rings: Rings, state: Standing) -> NDArray[np.bool_]:
    """[N] True near a violated bend, the narrowest violated gap or the place furthest outside."""
    limits = state.limits
    places = [points[bend_radii(points, rings) < limits.bend_radius]]
    if "clearance" in state.broken:
        places.append(state.gap_at[None])
    if "region" in state.broken:
        places.append(state.outside_at[None])
    every = np.concatenate(places)
    if len(every) == 0:
        return np.zeros(len(points), dtype=bool)
    apart, _ = cKDTree(every).query(points)
    return np.asarray(apart < _REACH * limits.radius)


def mended(
    points: Array,
    rings: Rings,
    objective_at: Callable[[Rings], Loss],
    limits: Limits,
    edge_mm: float,
    account: Account,
    device: str,
    rounds: int,
) -> tuple[Array, Rings, int]:
    """The vertices (N, 3), mm, with what violates a limit mended where it can be, and the rounds that took.

    Every round lets go of the stretches that violate a limit then. Too great a length is no matter of
    a stretch, and stays. Steps are certified as everywhere. Edges of about `edge_mm` that a round has
    stretched are cut in two: by the bend radius they may turn further, and their mitres would stand out.
    """
    for done in range(rounds):
        points, rings = subdivide(points, rings, _STRETCHED * edge_mm)
        state = standing(points, rings, limits)
        loose = about(points, rings, state)
        if not state.violations or not loose.any():
            return points, rings, done
        objective = objective_at(rings)
        free = torch.as_tensor(loose, device=device)[:, None]

        def held(
            x: Tensor,
            near: Neighbours,
            progress: float,
            free: Tensor = free,
            objective: Loss = objective,
        ) -> Tensor:
            return objective(torch.where(free, x, x.detach()), near, progress)

        # the flow's rates are root mean squares over all vertices, moved or not
        share = float(np.sqrt(loose.mean()))
        walk = FlowSettings(iterations=_ITERATIONS, rate=_RATE * share, rate_end=_RATE_END * share)
        points = walked(
            points, rings, held, limits, walk, account, device, None, met_by(rings, limits)
        )
    return *subdivide(points, rings, _STRETCHED * edge_mm), rounds
