"""The motion of a picture's outline and of a knot's vertices from one frame to the next, and its bound.

A vertex may go no further than the pictures' own outlines do, and one tube radius more. The outlines'
motion is the Hausdorff distance of the two, in the plane z = 0 where the template lies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely import MultiPolygon, Polygon

from knotfab.base.arrays import Array
from knotfab.limits.base import Felt, State, total_length
from knotfab.search.objective import Term, Weights
from knotfab_formats.report import Motion

__all__ = ["Anchor", "Tautness", "measure", "outline_motion", "pair_pieces"]


_TAUT = 0.05  # weight of the length beyond what the picture's area calls for


def pair_pieces(
    old: MultiPolygon, new: MultiPolygon, count: int
) -> list[tuple[MultiPolygon, MultiPolygon]]:
    """Pair the `count` largest pieces of a silhouette with their later shapes; or both as a whole.

    Pieces are paired so that their middles go, and their sizes change, the least in all. Where one has
    fewer pieces, both are one pair.
    """
    before, after = (sorted(p.geoms, key=lambda piece: -piece.area)[:count] for p in (old, new))
    if count == 1 or min(len(before), len(after)) < count:
        return [(old, new)]
    _, then = linear_sum_assignment([[_way(one, other) for other in after] for one in before])
    return [
        (MultiPolygon([one]), MultiPolygon([after[k]])) for one, k in zip(before, then, strict=True)
    ]


def _way(one: Polygon, other: Polygon) -> float:
    """Return mm that a piece's middle goes, and its size changes."""
    return float(one.centroid.distance(other.centroid) + abs(one.area**0.5 - other.area**0.5))


def outline_motion(old: MultiPolygon, new: MultiPolygon, knots: int = 1) -> float:
    """Return Hausdorff distance (mm) of two silhouettes' outlines, holes included.

    Where several `knots` draw a piece each it is that of the piece which goes furthest: another one on its
    way brings it no nearer. Each sample's distance is to the other outline itself, so the result is never
    too long; with samples 0.1 mm apart it is at most 0.05 mm too short.
    """
    pairs = pair_pieces(old, new, knots)
    return max(max(_furthest(p, q), _furthest(q, p)) for p, q in pairs)


def _furthest(one: MultiPolygon, other: MultiPolygon) -> float:
    """Measure the largest distance of a point of the outline of `one` from that of `other`."""
    # mm between samples on the outlines
    points = shapely.points(shapely.get_coordinates(one.boundary.segmentize(0.1)))
    line = other.boundary
    shapely.prepare(line)
    return float(shapely.distance(points, line).max())


@dataclass(frozen=True)
class Anchor(Term):
    """The places (N, 3) of another frame's vertices, mm, and how far from them they may be: a hard limit.

    As a term: squares of what each vertex is beyond the limit, in tube radii, summed.
    """

    points: Array
    limit_mm: float
    radius_mm: float  # the tube's

    def __call__(self, state: State, weights: Weights) -> Felt:
        away = state.points - self.points
        # the root's slope has no limit at 0, where the hinge is far from touching
        length = np.sqrt((away * away).sum(axis=1) + 1e-12)
        # a share of a vertex's bound, from which the objective begins to hold it back
        beyond = np.maximum(length - 0.97 * self.limit_mm, 0.0) / self.radius_mm
        slope = (2.0 * weights.hold / self.radius_mm * beyond / length)[:, None] * away
        return weights.hold * float((beyond * beyond).sum()), slope

    def kept(self, points: Array) -> bool:
        return self.beyond(points) <= 0

    def beyond(self, points: Array) -> float:
        """Measure how far (mm) the furthest vertex is beyond the limit; negative where all keep it."""
        return float(np.linalg.norm(points - self.points, axis=1).max()) - self.limit_mm


@dataclass(frozen=True)
class Tautness(Term):
    """A pull on knots longer than `length_mm`: no vertices can be added, and long edges show."""

    length_mm: float
    radius_mm: float

    def __call__(self, state: State, weights: Weights) -> Felt:
        length, slope = total_length(state)
        excess = max(0.0, length - self.length_mm) / self.radius_mm
        return _TAUT * excess**2, 2.0 * _TAUT * excess / self.radius_mm * slope


def measure(old: Array, new: Array, outline_mm: float, radius: float) -> Motion:
    """Measure the motion of vertices from `old` to `new` (N, 3), and its bound: outline and one radius."""
    length = np.linalg.norm(new - old, axis=1)
    largest, limit = float(length.max()), outline_mm + radius
    return Motion(
        largest_mm=largest,
        mean_mm=float(length.mean()),
        outline_mm=outline_mm,
        limit_mm=limit,
        held=largest <= limit,
    )
