"""A knot drawn tight: the certified flow with the curve's length in place of the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.carry import resample, subdivide
from knotfab.geometry.measures import Neighbours, bend_radii, strand_gap
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import BEND, CLEARANCE, Felt, Limits, State, total_length, weigh
from knotfab.search.flow import FlowSettings
from knotfab.search.optimizer import descend
from knotfab_formats.piece import Region

_PULL = 0.08  # weight of the length against the hinges while the knot shrinks
_SLOWING = 0.003  # share of the length that a round must take off for another one to follow
_MOST_ROUNDS = 40
_LAST = ((250, 0.1, 0.04, 0.5, 0.05), (200, 0.04, 0.01, 0.4, 0.02))


@dataclass(frozen=True)
class Tight:
    """A tight knot around which a tube of radius 1 just fits.

    `points` (n, 3) in tube radii; `gap` is the least distance of its strands and `bend` its tightest
    bend radius, both in tube radii.
    """

    points: Array
    length: float
    gap: float
    bend: float


def tighten(points: Array) -> Tight:
    """Shorten a closed curve by certified steps, with a tube of radius 1 around it.

    The type is that of `points` (n, 3), proved step by step as in the search: only the resamplings
    that cannot be certified are replaced, by new vertices on the old edges. The length is near the
    knot's ropelength, which the flow approaches from above.

    Raises:
        SceneError: the tube overlaps itself at the end.
    """
    limits = Limits(1.0, 0.0, 1.0, np.inf, Region())
    clearance, bend = CLEARANCE.term, BEND.term
    rings = polylines_of_sizes((len(points),))

    def shorten(n: int, first: float, last: float, edge: float, pull: float) -> float:
        nonlocal points, rings
        points, rings, verdict = resample(points, rings, edge)
        if not verdict.valid:
            points, rings = subdivide(points, rings, edge)

        def objective(p: Array, near: Neighbours, _: float) -> Felt:
            state = State.at(p, rings, near)
            parts = (
                (pull, total_length(state)),
                (3.0, clearance(state, limits)),
                (0.5, bend(state, limits)),
            )
            return weigh(parts, p)

        walk = FlowSettings(iterations=n, rate=first, rate_end=last, reach=3.0)
        found = descend(points, rings, objective, 1.0, walk, separation=limits.separation)
        points = found.points
        return float(np.linalg.norm(points[rings.next] - points, axis=1).sum())

    before = np.inf
    for _ in range(_MOST_ROUNDS):
        length = shorten(200, 0.15, 0.1, 0.6, _PULL)
        if length > (1.0 - _SLOWING) * before:
            break
        before = length
    for settings in _LAST:
        length = shorten(*settings)
    gap = strand_gap(points, rings, limits.separation, 4.0).gap
    tightest = float(bend_radii(points, rings).min())
    if gap < 2.0 or tightest < 1.0:
        raise SceneError(
            "the tightened knot",
            f"its strands come within {gap:.3f} tube radii and it bends to {tightest:.3f}",
            "Start it from a looser curve.",
        )
    return Tight(points, length, gap, tightest)
