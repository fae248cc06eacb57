"""Grace: the energy of an elastic curve under tension, which the eye dislikes and few pictures ask for.

Without it every strand crumples until it bends nearly as tightly as it may, and grows half as long again
as what it fills, for a crumpled curve draws a picture no worse than a smooth one. What is longer than it
need be hides strands behind each other: it costs filament, and makes the picture easier to read from aside.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from knotfab.limits.base import State
from knotfab.search.objective import Term, Weights

__all__ = ["Grace"]


_TENSION = 0.5  # of a curve one tube radius long, in units of the bending energy


@dataclass(frozen=True)
class Grace(Term):
    """Callable term: weight * (r * integral of squared curvature + tension * length / r), free of scale.

    Euler's elastica under tension. On a polyline the bending energy is the sum over vertices of
    |t' - t|^2 / l, t and t' the unit tangents before and after, l the mean of the two edges (Bergou et
    al., "Discrete elastic rods", 2008, with 2 sin(theta / 2) for 2 tan(theta / 2): bounded where an edge
    folds back).
    """

    radius_mm: float
    weight: float

    def __call__(self, state: State, weights: Weights) -> Tensor:
        one, two = state.edge.norm(dim=-1), state.after.norm(dim=-1)
        turn = state.after / _divisor(two)[:, None] - state.edge / _divisor(one)[:, None]
        energy = ((turn * turn).sum(-1) / _divisor(0.5 * (one + two))).sum()
        bending, stretched = self.radius_mm * energy, one.sum() / self.radius_mm
        loss: Tensor = self.weight * weights.grace * (bending + _TENSION * stretched)
        return loss


def _divisor(lengths: Tensor) -> Tensor:
    """Lengths, 1 where there is none: an edge without length turns by no angle that is known."""
    return torch.where(lengths > 0, lengths, torch.ones_like(lengths))
