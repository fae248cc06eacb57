"""Twice as many vertices for all frames alike, by a certified step, so that corners do not show.

The search moves few vertices and cannot add any: where a knot is stretched its edges are long, and a tube
about them has corners in its outline. Every edge of every frame gets one more vertex, on the cubic
spline through the others: vertex 2 i is the old vertex i, and 2 i + 1 the new one after it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotfab.geometry.carry import Curves
from knotfab.geometry.certificate import Certificate, certify
from knotfab.geometry.neighbours import find_neighbours
from knotfab.geometry.polylines import Rings, rings_of_sizes

__all__ = ["doubled"]

Array = NDArray[np.float64]

_SKIP = 6  # as in the flow
_SHORTENINGS = 5


def doubled(points: Array, rings: Rings) -> tuple[Array, Rings, Certificate]:
    """Closed polylines with a vertex more on each edge (2 N, 3), and the certificate of the step.

    The new vertices begin in the middles of the edges, which changes nothing, and move to the spline.
    Where that cannot be certified they go half as far, and in the end stay where they are.
    """
    curves = Curves.through(rings.split(points))
    between = tuple(
        0.5 * (np.append(at[1:], period) + at)
        for at, period in zip(curves.knots, curves.periods, strict=True)
    )
    both = rings_of_sizes(tuple(2 * n for n in rings.sizes))
    start = np.empty((2 * len(points), 3))
    start[::2], start[1::2] = points, 0.5 * (points + points[rings.next])
    step = np.zeros_like(start)
    step[1::2] = np.concatenate(curves.at(between)) - start[1::2]
    edge = np.linalg.norm(points[rings.next] - points, axis=1)
    near = find_neighbours(start, both, 4.0 * float(edge.max()), _SKIP)
    verdict = certify(start, step, both, near)
    for _ in range(_SHORTENINGS):
        if verdict.valid:
            return start + step, both, verdict
        step *= 0.5
        verdict = certify(start, step, both, near)
    return (start + step if verdict.valid else start), both, verdict
