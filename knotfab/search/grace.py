"""Grace: the energy of an elastic curve under tension, which the eye dislikes and few pictures ask for.

Without it every strand crumples until it bends nearly as tightly as it may, and grows half as long again
as what it fills, for a crumpled curve draws a picture no worse than a smooth one. What is longer than it
need be hides strands behind each other: it costs filament, and makes the picture easier to read from aside.

A wire is bent by hand, one bend after the other. Of it grace counts bends instead: it would rather turn in
one place and run straight up to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from knotfab.limits.base import State
from knotfab.search.objective import Term, Weights

__all__ = ["Grace"]


_TENSION = 0.5  # of a curve one tube radius long, in units of the bending energy
# curvature times radius: where counted bends weigh as much as their bending energy; of what is straight
_BENT, _STRAIGHT = 0.3, 0.05


@dataclass(frozen=True)
class Grace(Term):
    """Callable term: weight * (r * integral of squared curvature + tension * length / r), free of scale.

    Euler's elastica under tension. On a polyline the bending energy is the sum over vertices of
    |t' - t|^2 / l, t and t' the unit tangents before and after, l the mean of the two edges (Bergou et
    al., "Discrete elastic rods", 2008, with 2 sin(theta / 2) for 2 tan(theta / 2): bounded where an edge
    folds back).

    With `bends` a root of curvature takes the place of its square, as bends are counted: a straight that
    may be t beside a curve of curvature k stands for 4 sqrt(t / k) of it. Smooth where there is none, it
    grows about as curvature does: a bend costs the same however tight it is.
    """

    radius_mm: float
    weight: float
    bends: bool = False

    def __call__(self, state: State, weights: Weights) -> Tensor:
        one, two = state.edge.norm(dim=-1), state.after.norm(dim=-1)
        turn = state.after / _divisor(two)[:, None] - state.edge / _divisor(one)[:, None]
        length, turned = _divisor(0.5 * (one + two)), (turn * turn).sum(-1)
        if self.bends:
            lengths = length / self.radius_mm
            bending = (lengths * _count_bends(turned / lengths / lengths)).sum()
        else:
            bending = self.radius_mm * (turned / length).sum()
        stretched = one.sum() / self.radius_mm
        loss: Tensor = self.weight * weights.grace * (bending + _TENSION * stretched)
        return loss


def _count_bends(squares: Tensor) -> Tensor:
    """From squared curvature, in tube radii, its root, smooth where there is none; at `_BENT` that square."""
    least = _STRAIGHT**0.5
    scale = _BENT**2 / ((_BENT**2 + _STRAIGHT**2) ** 0.25 - least)
    counted: Tensor = scale * ((squares + _STRAIGHT**2) ** 0.25 - least)
    return counted


def _divisor(lengths: Tensor) -> Tensor:
    """Lengths, 1 where there is none: an edge without length turns by no angle that is known."""
    return torch.where(lengths > 0, lengths, torch.ones_like(lengths))
