"""Twice as many vertices for all frames alike, by a certified step, so that corners do not show.

The search moves few vertices and cannot add any: where a knot is stretched its edges are long, and a tube
about them has corners in its outline. Every edge of every frame gets one more vertex, on the cubic
spline through the others: vertex 2 i is the old vertex i, and 2 i + 1 the new one after it.
"""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Array
from knotfab.geometry.carry import Carried, Curves, carry
from knotfab.geometry.polylines import Polylines, polylines_of_sizes

__all__ = ["double_vertices"]


_SHORTEST = 1 / 32  # of the way to the spline


def double_vertices(points: Array, rings: Polylines) -> tuple[Carried, Polylines]:
    """Closed polylines with a vertex more on each edge (2 N, 3), and the certificate of the way there.

    The new vertices begin in the middles of the edges, which changes nothing, and move to the spline.
    Where that cannot be certified they stop on the way.
    """
    curves = Curves.through(rings.split(points))
    between = tuple(
        0.5 * (np.append(at[1:], period) + at)
        for at, period in zip(curves.knots, curves.periods, strict=True)
    )
    start = np.empty((2 * len(points), 3))
    start[::2], start[1::2] = points, 0.5 * (points + points[rings.next])
    step = np.zeros_like(start)
    step[1::2] = np.concatenate(curves.at(between)) - start[1::2]
    both = polylines_of_sizes(tuple(2 * n for n in rings.sizes))
    whole = carry(start, both, lambda at, share: start + share * step, np.inf, _SHORTEST, 1.0)
    return whole, both
