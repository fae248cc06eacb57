"""The motion of a picture's outline and of a knot's vertices from one frame to the next, and its bound.

A vertex may go no further than the pictures' own outlines do, and one tube radius more. The outlines'
motion is the Hausdorff distance of the two, in the plane z = 0 where the template lies.
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


# Carry a knot from one picture to the next along a smooth displacement, every step certified.


_STEP_RADII = 0.5  # tube radii that a vertex goes in one step
_SHORTEST = 1e-3  # the shortest step, as a share of the way
_LONGER = 144  # grid points on the longer side at the finest level
_LEVELS = (0.25, 0.5, 1.0)  # shares of the full resolution
_CLIP = 0.09  # a share of the longer side: distances from the outline that the coarsest level sees
_ITERATIONS = 80  # a level
_SMOOTH = (2.2, 1.6, 1.2)  # grid points: width of the Gaussian that keeps the displacement smooth
_LONGEST = 0.5  # grid points in one iteration
_BETTER = 0.05  # IoU that a shift, or a stretch, must gain
_ALIKE = 0.98  # IoU of silhouettes that are one, shifted or stretched


def _pairs_of(
    rings: Sequence[Array], old: MultiPolygon, new: MultiPolygon
) -> list[tuple[MultiPolygon, MultiPolygon]]:
    """Pair what each ring (n, 2) draws of `old` and is to draw of `new`: a piece each, or the whole."""
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
    """Move the vertices (N, 3) along their rays' displacement from silhouette `old` to `new`.

    Of several knots each goes with its own piece. A vertex keeps its depth; seen from the light it moves as
    the plane z = 0 does. Where no step is short enough to be certified the way ends there, and the flow
    goes on.

    Args:
        light_mm: distance of the light from the middle of the piece.
        furthest_mm: no vertex goes further than this.
    """
    shrink = (1.0 - points[:, 2] / light_mm)[:, None]
    seen = rings.split(points[:, :2] / shrink)
    pairs = _pairs_of(seen, old, new)
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
    """Displacements (rows, columns, 2) mm on a grid of the plane: `low` (2,) is its first point."""

    low: Array
    pitch: float
    values: Array

    def at(self, where: Array) -> Array:
        """Return (n, 2) mm: the displacement at points (n, 2) of the plane, linear between grid points."""
        column, row = ((where - self.low) / self.pitch).T
        found = [
            map_coordinates(self.values[..., k], [row, column], order=1, mode="nearest")
            for k in (0, 1)
        ]
        return np.stack(found, axis=1)


def register(old: MultiPolygon, new: MultiPolygon, margin: float) -> Displacement:
    """Return the displacement that takes the silhouette `old` to `new` (both in one plane, mm).

    Args:
        margin: mm around both that the grid covers as well.
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
        # the same clip in mm at first, finer distances as the grid becomes finer
        clip = max(2.5, _CLIP * _LONGER * level * (0.5 if level == 1.0 else 1.0))
        fixed, moving = (_distances(p, low, pitch, rows, columns, clip) for p in (old, new))
        if values is None:
            grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
            at = low + pitch * grid
            values = (stretch * at + offset - at) / pitch
            before = pitch
            # distances from the outlines of two shapes would only distort what fits already
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
    """Find what lays the silhouettes over each other, or leaves them: (stretch, offset mm, IoU then).

    From middle to middle, alone or with both sides stretched to the new ones, where that gains IoU.
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
    """Return (rows, columns) signed distances from the outline in grid points, smoothly clipped to 1."""
    x = low[0] + pitch * np.arange(columns)
    y = low[1] + pitch * np.arange(rows)
    shapely.prepare(polygon)
    inside = shapely.contains_xy(polygon, *np.meshgrid(x, y))
    signed = distance_transform_edt(inside) - distance_transform_edt(~inside)
    return np.asarray(np.tanh(gaussian_filter(signed, 0.7) / clip))


def _demons(fixed: Array, moving: Array, start: Array, smooth: float) -> Array:
    """Return displacements in grid points (rows, columns, 2) with moving(p + u(p)) = fixed(p)."""
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
