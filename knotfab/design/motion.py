"""How far pictures move from frame to frame: what bounds a sequence's motion, and what no knot can follow."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely import MultiPolygon, Polygon, affinity

from knotfab.base.arrays import Array
from knotfab.picture.silhouette import polygon_iou
from knotfab_formats.scene import ResolvedView

_BETTER = 0.05  # IoU that a shift or stretch must gain


def pair_pieces(
    old: MultiPolygon, new: MultiPolygon, count: int
) -> list[tuple[MultiPolygon, MultiPolygon]]:
    """Pair the `count` largest pieces of two silhouettes, or both as wholes if one has fewer pieces.

    The pairing minimises the total motion of centroids plus change of sizes.
    """
    before, after = (sorted(p.geoms, key=lambda piece: -piece.area)[:count] for p in (old, new))
    if count == 1 or min(len(before), len(after)) < count:
        return [(old, new)]
    _, then = linear_sum_assignment([[_change(one, other) for other in after] for one in before])
    return [
        (MultiPolygon([one]), MultiPolygon([after[k]])) for one, k in zip(before, then, strict=True)
    ]


def _change(one: Polygon, other: Polygon) -> float:
    """Return the motion of a piece's centroid plus the change of its size, mm."""
    return float(one.centroid.distance(other.centroid) + abs(one.area**0.5 - other.area**0.5))


def outline_motion(old: MultiPolygon, new: MultiPolygon, knots: int = 1) -> float:
    """Return the Hausdorff distance of two silhouettes' outlines, holes included, mm.

    If each of several `knots` draws its own piece, it is the largest distance of paired pieces. Sampling
    every 0.1 mm makes the result at most 0.05 mm too short, and never too long.
    """
    pairs = pair_pieces(old, new, knots)
    return max(max(_furthest(p, q), _furthest(q, p)) for p, q in pairs)


def wall_motion(view: ResolvedView, old: MultiPolygon, new: MultiPolygon, knots: int) -> float:
    """Return how far the outlines of two silhouettes of a view are apart on its wall, mm."""
    return view.magnification * outline_motion(old, new, knots)


def _furthest(one: MultiPolygon, other: MultiPolygon) -> float:
    """Return the largest distance of the outline of `one` from that of `other`, mm."""
    points = shapely.points(shapely.get_coordinates(one.boundary.segmentize(0.1)))
    line = other.boundary
    shapely.prepare(line)
    return float(shapely.distance(points, line).max())


def lay_over(old: MultiPolygon, new: MultiPolygon) -> tuple[Array, Array, float]:
    """Return the stretch and offset (mm) that lay `old` over `new`, and the IoU then.

    It tries a shift of the centroid and a stretch of the bounding box, and takes neither unless IoU grows.
    """
    sizes = [np.subtract(p.bounds[2:], p.bounds[:2]) for p in (old, new)]
    middles = [0.5 * np.add(p.bounds[2:], p.bounds[:2]) for p in (old, new)]
    centroids = [np.array(p.centroid.coords[0]) for p in (old, new)]
    best = np.ones(2), np.zeros(2), polygon_iou(old, new)
    for stretch, (here, there) in ((np.ones(2), centroids), (sizes[1] / sizes[0], middles)):
        offset = there - stretch * here
        moved = affinity.affine_transform(old, [stretch[0], 0, 0, stretch[1], *offset])
        if (iou := polygon_iou(moved, new)) > best[2] + _BETTER:
            best = stretch, offset, iou
    return best


def find_leap(outlines: Sequence[MultiPolygon], knots: int) -> tuple[int, float]:
    """Return the number, from 1, of the frame before the widest leap, and how far its outline goes.

    What a shift or a stretch of a knot's picture does is no leap, since the knot is carried so.
    """
    leaps = []
    for number, frames in enumerate(pairwise(outlines), start=1):
        for old, new in pair_pieces(*frames, knots):
            stretch, offset, _ = lay_over(old, new)
            moved = affinity.affine_transform(old, [stretch[0], 0, 0, stretch[1], *offset])
            leaps.append((float(shapely.hausdorff_distance(moved.boundary, new.boundary)), number))
    far, number = max(leaps)
    return number, far
