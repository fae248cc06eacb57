"""Grace: the bending energy of the centre lines, which the picture seldom asks for and the eye dislikes.

Without it every strand crumples until it bends nearly as tightly as it may, for a crumpled curve draws a
picture no worse than a smooth one.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from knotfab.limits.base import State
from knotfab.search.objective import Term, Weights

__all__ = ["Grace"]


@dataclass(frozen=True)
class Grace(Term):
    """Callable term: weight * r * integral of squared curvature, free of scale.

    On a polyline the sum over vertices of |t' - t|^2 / l, t and t' the unit tangents before and after,
    l the mean of the two edges (the discrete elastica energy of Bergou et al., "Discrete elastic
    rods", 2008, with 2 sin(theta / 2) for 2 tan(theta / 2): bounded where an edge folds back).
    """

    radius_mm: float
    weight: float

    def __call__(self, state: State, weights: Weights) -> Tensor:
        one, two = state.edge.norm(dim=-1), state.after.norm(dim=-1)
        turn = state.after / two[:, None] - state.edge / one[:, None]
        energy = ((turn * turn).sum(-1) / (0.5 * (one + two))).sum()
        loss: Tensor = self.weight * weights.grace * self.radius_mm * energy
        return loss
