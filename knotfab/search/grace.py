"""Grace: the energy of an elastic curve under tension, which the eye dislikes and few pictures ask for.

Without it every strand crumples until it bends nearly as tightly as it may, and grows half as long again as
the filling, for a crumpled curve draws a picture no worse than a smooth one. What is longer than it need be
hides strands behind each other: it costs filament, and makes the picture easier to read from aside.

A wire is bent by hand, one bend after the other. Of it grace counts bends instead: it would rather turn in
one place and run straight up to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.limits.base import Felt, State, follow_edges
from knotfab.search.objective import Term, Weights

__all__ = ["Grace"]


_TENSION = 0.5  # the tension on one tube radius of length, in units of the bending energy
# curvature times radius: where counted bends weigh as much as their bending energy; of straight stretches
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

    def __call__(self, state: State, weights: Weights) -> Felt:
        following, previous = state.rings.next, state.rings.previous
        one = np.sqrt((state.edge * state.edge).sum(axis=1))
        unit = state.edge / _divisor(one)[:, None]
        turn = unit[following] - unit
        between = 0.5 * (one + one[following])
        length, turned = _divisor(between), (turn * turn).sum(axis=1)
        # each vertex's share, and its slopes in the square of its turn and in the length that is its own
        if self.bends:
            lengths = length / self.radius_mm
            counted, slope = _count_bends(turned / lengths / lengths)
            shares, by_turn = lengths * counted, slope / lengths
            by_length = (counted - 2.0 * slope * turned / lengths / lengths) / self.radius_mm
        else:
            by_turn = self.radius_mm / length
            shares = by_turn * turned
            by_length = -shares / length
        by_length = np.where(between > 0, by_length, 0.0)
        pull = 2.0 * by_turn[:, None] * turn
        pull = pull[previous] - pull  # the pull on the unit edges
        along = (pull * unit).sum(axis=1)
        stretch = 0.5 * (by_length + by_length[previous]) + _TENSION / self.radius_mm
        edges = (pull - along[:, None] * unit) / _divisor(one)[:, None] + stretch[:, None] * unit
        scale = self.weight * weights.grace
        total = float(shares.sum()) + _TENSION * float(one.sum()) / self.radius_mm
        return scale * total, scale * follow_edges(edges, state.rings)


def _count_bends(squares: Array) -> tuple[Array, Array]:
    """Return the root of squared curvature, in tube radii, smooth at 0; and its slope.

    At `_BENT` it is that square.
    """
    least = _STRAIGHT**0.5
    scale = _BENT**2 / ((_BENT**2 + _STRAIGHT**2) ** 0.25 - least)
    root = (squares + _STRAIGHT**2) ** 0.25
    return scale * (root - least), 0.25 * scale * root / (squares + _STRAIGHT**2)


def _divisor(lengths: Array) -> Array:
    """Return lengths, 1 where there is none: an edge without length turns by no angle that is known."""
    return np.where(lengths > 0, lengths, 1.0)
