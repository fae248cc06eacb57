"""Bound the motion of a knot's vertices between frames, and carry a knot from one picture to the next.

A vertex may move as far as the pictures' outlines do, plus one tube radius. The outlines' motion is their
Hausdorff distance, in the plane z = 0 where the template lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates, zoom
from scipy.optimize import linear_sum_assignment
from shapely import MultiPolygon, Polygon, affinity

from knotfab.base.arrays import Array
from knotfab.geometry.carry import Carried, carry
from knotfab.geometry.polylines import Polylines
from knotfab.limits.terms import Felt, State, total_length
from knotfab.picture.silhouette import polygon_iou
from knotfab.search.objective import Term, Weights
from knotfab_formats.report import Motion

_TAUT = 0.05  # weight of the length beyond the limit of `Tautness`
_STEP_RADII = 0.5  # longest step of a vertex, in tube radii
_SHORTEST = 1e-3  # shortest step, as a share of the way
_LONGER = 144  # grid points on the longer side at the finest level
_LEVELS = (0.25, 0.5, 1.0)  # resolution of each level, as a share of the finest
_CLIP = 0.09  # clip of the distances from the outline at the coarsest level, as a share of the longer side
_ITERATIONS = 80  # per level
_SMOOTH = (
    2.2,
    1.6,
    1.2,
)  # width of the Gaussian that smooths the displacement, grid points per level
_LONGEST = 0.5  # longest displacement of one iteration, grid points
_BETTER = 0.05  # IoU that a shift or stretch must gain
_ALIKE = 0.98  # IoU above which a shifted or stretched silhouette fits


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


def _furthest(one: MultiPolygon, other: MultiPolygon) -> float:
    """Return the largest distance of the outline of `one` from that of `other`, mm."""
    points = shapely.points(shapely.get_coordinates(one.boundary.segmentize(0.1)))
    line = other.boundary
    shapely.prepare(line)
    return float(shapely.distance(points, line).max())


@dataclass(frozen=True)
class Anchor(Term):
    """A hard limit on each vertex's distance from its place in another frame, (N, 3) mm.

    As a term of the objective it is the sum of squared excesses, in tube radii.
    """

    points: Array
    limit_mm: float
    radius_mm: float

    def __call__(self, state: State, weights: Weights) -> Felt:
        away = state.points - self.points
        # the small term keeps the root's slope finite at 0, where the hinge is inactive anyway
        length = np.sqrt((away * away).sum(axis=1) + 1e-12)
        # the pull begins a little before the limit
        beyond = np.maximum(length - 0.97 * self.limit_mm, 0.0) / self.radius_mm
        slope = (2.0 * weights.hold / self.radius_mm * beyond / length)[:, None] * away
        return weights.hold * float((beyond * beyond).sum()), slope

    def kept(self, points: Array) -> bool:
        return self.excess(points) <= 0

    def excess(self, points: Array) -> float:
        """Return the largest excess over the limit, mm; negative while all vertices keep it."""
        return float(np.linalg.norm(points - self.points, axis=1).max()) - self.limit_mm


@dataclass(frozen=True)
class Tautness(Term):
    """Penalise knots longer than `length_mm`, whose fixed number of vertices would leave visible edges."""

    length_mm: float
    radius_mm: float

    def __call__(self, state: State, weights: Weights) -> Felt:
        length, slope = total_length(state)
        excess = max(0.0, length - self.length_mm) / self.radius_mm
        return _TAUT * excess**2, 2.0 * _TAUT * excess / self.radius_mm * slope


def measure_motion(old: Array, new: Array, outline_mm: float, radius: float) -> Motion:
    """Measure the vertices' motion from `old` to `new` (N, 3) against its bound, `outline_mm` + `radius`."""
    length = np.linalg.norm(new - old, axis=1)
    largest, limit = float(length.max()), outline_mm + radius
    return Motion(
        largest_mm=largest,
        mean_mm=float(length.mean()),
        outline_mm=outline_mm,
        limit_mm=limit,
        held=largest <= limit,
    )


def _pairs_by_ring(
    rings: Sequence[Array], old: MultiPolygon, new: MultiPolygon
) -> list[tuple[MultiPolygon, MultiPolygon]]:
    """Return for each ring (n, 2) the piece of `old` that it draws and its pair in `new`, or the wholes."""
    pairs = pair_pieces(old, new, len(rings))
    if len(pairs) == 1:
        return pairs * len(rings)
    points = [shapely.points(ring) for ring in rings]
    away = [[float(shapely.distance(piece, at).mean()) for piece, _ in pairs] for at in points]
    _, drawn = linear_sum_assignment(away)
    return [pairs[k] for k in drawn]


def transport(
    points: Array,
    rings: Polylines,
    old: MultiPolygon,
    new: MultiPolygon,
    light_mm: float,
    radius: float,
    furthest_mm: float,
) -> Carried:
    """Move the vertices (N, 3) by the displacement that takes silhouette `old` to `new`, step by step.

    Each step is certified to keep the knots' type; the way ends where no step can be. Each of several knots
    follows its own piece. A vertex keeps its depth, and its projection from the light onto z = 0 moves.

    Args:
        light_mm: distance of the light from the middle of the piece.
        furthest_mm: longest way of a vertex.
    """
    shrink = (1.0 - points[:, 2] / light_mm)[:, None]
    seen = rings.split(points[:, :2] / shrink)
    pairs = _pairs_by_ring(seen, old, new)
    moved = [register(*p, 6.0 * radius).at(s) for s, p in zip(seen, pairs, strict=True)]
    shift = np.concatenate(moved) * shrink
    length = np.linalg.norm(shift, axis=1)
    shift *= np.minimum(1.0, furthest_mm / np.maximum(length, 1e-12))[:, None]
    whole = np.column_stack([shift, np.zeros(len(points))])
    return carry(
        points, rings, lambda at, share: points + share * whole, _STEP_RADII * radius, _SHORTEST
    )


@dataclass(frozen=True)
class Displacement:
    """Displacements (rows, columns, 2), mm, on a grid of the plane whose first point is `low` (2,)."""

    low: Array
    pitch: float
    values: Array

    def at(self, where: Array) -> Array:
        """Interpolate the displacement bilinearly at points (n, 2) of the plane, mm."""
        column, row = ((where - self.low) / self.pitch).T
        found = [
            map_coordinates(self.values[..., k], [row, column], order=1, mode="nearest")
            for k in (0, 1)
        ]
        return np.stack(found, axis=1)


def register(old: MultiPolygon, new: MultiPolygon, margin: float) -> Displacement:
    """Find the smooth displacement that takes silhouette `old` to `new`, both in one plane, mm.

    Args:
        margin: width of the grid's border around both, mm.
    """
    both = np.array([old.bounds, new.bounds])
    low, high = both[:, :2].min(0) - margin, both[:, 2:].max(0) + margin
    finest = float((high - low).max()) / _LONGER
    stretch, offset, overlap = _lay_over(old, new)
    values: Array | None = None
    before = finest
    for level, smooth in zip(_LEVELS, _SMOOTH, strict=True):
        pitch = finest / level
        columns, rows = (np.ceil((high - low) / pitch).astype(int) + 1).tolist()
        # the clip is the same in mm, but half as much on the finest grid
        clip = max(2.5, _CLIP * _LONGER * level * (0.5 if level == 1.0 else 1.0))
        fixed, moving = (_distances(p, low, pitch, rows, columns, clip) for p in (old, new))
        if values is None:
            grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
            at = low + pitch * grid
            values = (stretch * at + offset - at) / pitch
            before = pitch
            # a shift or stretch that fits already would only be distorted
            if offset.any() and overlap > _ALIKE:
                break
        else:
            sizes = rows / values.shape[0], columns / values.shape[1]
            ratio = before / pitch
            values = np.stack(
                [ratio * zoom(values[..., k], sizes, order=1, grid_mode=False) for k in (0, 1)],
                axis=-1,
            )
        values = _demons(fixed, moving, values, smooth)
        before = pitch
    assert values is not None
    return Displacement(low, before, values * before)


def _lay_over(old: MultiPolygon, new: MultiPolygon) -> tuple[Array, Array, float]:
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


def _distances(
    polygon: MultiPolygon, low: Array, pitch: float, rows: int, columns: int, clip: float
) -> Array:
    """Return signed distances from the outline over `clip` grid points, smoothly limited to -1 … 1."""
    x = low[0] + pitch * np.arange(columns)
    y = low[1] + pitch * np.arange(rows)
    shapely.prepare(polygon)
    inside = shapely.contains_xy(polygon, *np.meshgrid(x, y))
    signed = distance_transform_edt(inside) - distance_transform_edt(~inside)
    return np.asarray(np.tanh(gaussian_filter(signed, 0.7) / clip))


def _demons(fixed: Array, moving: Array, start: Array, smooth: float) -> Array:
    """Refine displacements u (rows, columns, 2), grid points, towards moving(p + u(p)) = fixed(p).

    This is Thirion's demons algorithm with symmetric forces.
    """
    u = start.copy()
    row, column = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in fixed.shape), indexing="ij")
    slope = np.gradient(fixed)
    for _ in range(_ITERATIONS):
        warped = map_coordinates(
            moving, [row + u[..., 1], column + u[..., 0]], order=1, mode="nearest"
        )
        there = np.gradient(warped)
        pull_y, pull_x = (0.5 * (a + b) for a, b in zip(slope, there, strict=True))
        missing = fixed - warped
        share = missing / (pull_x**2 + pull_y**2 + missing**2 / (4 * _LONGEST**2) + 1e-9)
        force = np.stack([share * pull_x, share * pull_y], axis=-1)
        force = np.clip(force, -_LONGEST, _LONGEST)
        for k in (0, 1):
            u[..., k] = gaussian_filter(u[..., k] + force[..., k], smooth, mode="nearest")
    return u
