"""Twice as many vertices for all frames alike, by a certified step, so that corners do not show.

The search moves few vertices and cannot add any: where a knot is stretched its edges are long, and a tube
about them has corners in its outline. Every edge of every frame gets one more vertex, its middle, and the old
vertices move an eighth of their second difference inwards: one step of the subdivision that leads to the
uniform cubic B-spline (Lane and Riesenfeld, "A theoretical development for the computer generation and
display of piecewise polynomial surfaces", IEEE TPAMI 2(1), 1980). Vertex 2 i belongs to the old vertex i, and
2 i + 1 is the new one after it.

Where edges are even, each second difference over the square of the edge is an average of the polygon's
own, so it bends nowhere more than before. A curve through all old vertices does: bends that alternate
from vertex to vertex come out twice as strong, and no later repair sees so small a zigzag.
"""

from __future__ import annotations

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines, polylines_of_sizes

__all__ = ["double_vertices"]


_SHORTEST = 1 / 32  # the shortest step, as a share of the way to the spline


def double_vertices(points: Array, rings: Polylines) -> tuple[Carried, Polylines]:
    """Closed polylines with a vertex more on each edge (2 N, 3), and the certificate of the way there.

    The new vertices lie in the middles of the edges, which changes nothing; then the old ones move.
    Where that cannot be certified they stop on the way.
    """
    ahead, behind = points[rings.next], points[rings.previous]
    start, step = np.empty((2 * len(points), 3)), np.zeros((2 * len(points), 3))
    start[::2], start[1::2] = points, 0.5 * (points + ahead)
    step[::2] = (ahead + behind - 2.0 * points) / 8.0
    both = polylines_of_sizes(tuple(2 * n for n in rings.sizes))
    whole = carry(start, both, lambda at, share: start + share * step, np.inf, _SHORTEST, 1.0)
    return whole, both
