"""Fill a silhouette with a template: concentric insets, joined into one simple closed curve a piece.

Neighbouring strands lie one projected tube width apart, so the planar tube covers the picture. The curves are
simple, disjoint and planar, so each is an unknot and all together are an unlink, by inspection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree
from shapely import LinearRing, MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import sample_evenly
from knotfab.picture.opening import least_ring, longer_side
from knotfab.picture.silhouette import polygon_iou

_THIN_OUTER = 0.55  # least width of a part of the outline that is drawn, over the tube's
_BRIDGES = 4  # number of nearest curves that a curve may be joined to
_THIN_INNER = 0.12  # least width of an inner band that is filled, over the tube's
_NOISY = 5000  # number of corners above which an outline may be noise
_NOISE_WIDTH = 0.5  # area over length, in radii, below which it is
_COVERED = 1.0 / 3.0  # least share of a tiny piece that a small loop must cover
_HAIR = 1e-7  # reduction of the radius where GEOS fails on touching strands, as a share of it


@dataclass(frozen=True)
class Template:
    """Closed planar curves [(n, 2) mm], disjoint and simple, and the polygon that they fill.

    With `passes` they run along lines there and back, so strands hide each other.
    """

    curves: tuple[Array, ...]
    polygon: MultiPolygon
    radius: float
    passes: bool = False

    @cached_property
    def tube(self) -> Polygon | MultiPolygon:
        """The area that the planar tube covers."""
        covered: Polygon | MultiPolygon = shapely.union_all(
            [_band(curve, self.radius) for curve in self.curves]
        )
        return covered


def _polygons(shape: BaseGeometry) -> list[Polygon]:
    return [p for p in shapely.get_parts(shape) if isinstance(p, Polygon) and p.area > 0]


def _without_noise(piece: Polygon, radius: float) -> list[Polygon]:
    """Return the piece, or a coarse version of it at the tube's scale if it is noise.

    Insets of noise take minutes and leave nothing that a tube could draw.
    """
    noisy = shapely.get_num_coordinates(piece) > _NOISY
    if not noisy or piece.area > _NOISE_WIDTH * radius * piece.length:
        return [piece]
    least = np.pi * radius**2  # a hole or piece smaller than the tube's cross-section is a speck
    holes = [hole for hole in piece.interiors if Polygon(hole).area > least]
    coarse = Polygon(piece.exterior, holes).simplify(radius, preserve_topology=False)
    parts = [part for part in _polygons(shapely.make_valid(coarse)) if part.area > least]
    return parts or [piece.envelope]


def _ring_region(region: BaseGeometry, radius: float, thin: float) -> BaseGeometry:
    """Return the inset region that bounds centre lines; parts narrower than the tube are inset by less."""
    inset = region.buffer(-radius, join_style="mitre")
    opened = inset.buffer(radius * 1.02, join_style="mitre")
    try:
        narrow = region.difference(opened)
    except shapely.errors.GEOSException:  # a mitred inset of fine noise may cross itself
        narrow = shapely.make_valid(region).difference(shapely.make_valid(opened))
    kept = region.buffer(-radius * thin).intersection(narrow.buffer(radius * 0.5))
    kept = shapely.union_all([p for p in _polygons(kept) if p.length > 3.0 * radius])
    return shapely.make_valid(shapely.union_all([inset, kept]).buffer(0))


def rings_of(piece: Polygon, radius: float, spacing: float = 2.0) -> list[LinearRing]:
    """Return centre lines of concentric tubes that cover a piece, outermost first; none if no tube draws it.

    Args:
        piece: silhouette, mm.
        radius: projected tube radius, mm.
        spacing: distance between neighbouring rings, in tube radii.
    """
    rings: list[LinearRing] = []
    region: BaseGeometry = piece
    thin = _THIN_OUTER
    while not region.is_empty:
        lines = _ring_region(region, radius, thin)
        for part in _polygons(lines):
            for ring in (part.exterior, *part.interiors):
                if ring.length > 2.0 * radius:
                    rings.append(ring)
        region = region.buffer(-spacing * radius)
        thin = _THIN_INNER
    if not rings:
        # a piece smaller than the tube gets one small loop, if its centroid lies within it
        loop = _small_loop(piece, radius)
        drawn = Polygon(loop).buffer(radius)
        if piece.intersection(drawn).area >= _COVERED * piece.area:
            rings.append(loop)
    return rings


def _small_loop(piece: Polygon, radius: float) -> LinearRing:
    """Return a loop at a piece's centroid that is smaller than the tube can bend."""
    middle = piece.representative_point() if piece.is_empty else piece.centroid
    return middle.buffer(radius * 0.35).exterior


def _turning(points: Array) -> Array:
    """Return the unsigned turning angle around each vertex, summed over seven vertices."""
    edge = np.diff(points, axis=0, append=points[:1])
    angle = np.arctan2(edge[:, 1], edge[:, 0])
    turn = np.abs((np.diff(angle, prepend=angle[-1:]) + np.pi) % (2 * np.pi) - np.pi)
    return np.asarray(uniform_filter1d(turn, 7, mode="wrap")) * 7


@dataclass(frozen=True, eq=False)
class _Loop:
    """A closed polyline (n, 2) that is being joined, with cached queries."""

    points: Array

    @cached_property
    def ring(self) -> LinearRing:
        return LinearRing(self.points)

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def turning(self) -> Array:
        return _turning(self.points)

    @cached_property
    def box(self) -> Array:
        return np.concatenate([self.points.min(0), self.points.max(0)])


def _closest(one: _Loop, other: _Loop, radius: float) -> tuple[float, int, int]:
    """Find the best bridge: among nearly shortest ones, where both curves are straightest.

    Return the shortest distance, and the bridge's vertex on each curve.
    """
    near, index = other.tree.query(one.points)
    shortest = float(near.min())
    turns = np.minimum(one.turning, 2.0) + np.minimum(other.turning[index], 2.0)
    cost = near + radius * 0.7 * turns
    cost[near > shortest + 0.6 * radius] = np.inf
    best = int(np.argmin(cost))
    return shortest, best, int(index[best])


def _cut_open(points: Array, at: int, gap: int) -> Array:
    """Cut a closed polyline open around vertex `at`, `gap` edges wide."""
    gap = max(1, min(gap, len(points) // 3))
    start = at + (gap + 1) // 2
    return np.roll(points, -start, axis=0)[: len(points) - gap + 1]


def _bridge(one: Array, at: int, other: Array, to: int, gap: int, step: float) -> Array:
    """Join two closed polylines by two parallel strands."""
    a, b = _cut_open(one, at, gap), _cut_open(other, to, gap)
    straight = np.linalg.norm(a[-1] - b[0]) + np.linalg.norm(b[-1] - a[0])
    turned = np.linalg.norm(a[-1] - b[-1]) + np.linalg.norm(b[0] - a[0])
    if turned < straight:
        b = b[::-1]

    def strand(p: Array, q: Array) -> Array:
        count = max(1, round(float(np.linalg.norm(q - p)) / step))
        return p + (q - p) * (np.arange(1, count) / count)[:, None]

    return np.concatenate([a, strand(a[-1], b[0]), b, strand(b[-1], a[0])])


def simple_curves(curves: list[Array]) -> bool:
    """Return whether closed curves are simple and disjoint."""
    rings = [LinearRing(c) for c in curves]
    if not all(ring.is_simple for ring in rings):
        return False
    one, other = shapely.STRtree(rings).query(rings, predicate="intersects")
    return bool((one == other).all())


def join_curves(
    curves: list[Array], radius: float, step: float, until: int = 1, keep: bool = False
) -> list[Array]:
    """Join closed curves, the smallest to its nearest, until `until` are left.

    The results stay simple and disjoint. A curve that no bridge reaches is dropped, or kept with `keep`.
    """
    loops, kept = [_Loop(curve) for curve in curves], []
    sizes = np.array([len(loop.points) for loop in loops])
    boxes = np.array([loop.box for loop in loops])
    while len(loops) > max(1, until):
        # the smallest curve joins its nearest neighbour: rings nest, so the tree stays short
        smallest = int(np.argmin(sizes))
        one = loops.pop(smallest)
        sizes, boxes = (np.delete(known, smallest, axis=0) for known in (sizes, boxes))
        apart = np.maximum(0.0, np.maximum(boxes[:, :2] - one.box[2:], one.box[:2] - boxes[:, 2:]))
        bound = np.hypot(apart[:, 0], apart[:, 1])
        options: list[tuple[float, int, int, int]] = []
        for k in np.argsort(bound, kind="stable").tolist():
            if len(options) >= _BRIDGES and bound[k] > options[_BRIDGES - 1][0]:
                break
            options = sorted([*options, (*_closest(one, loops[k], radius), k)])
        joined = None
        for _, at, to, k in options[:_BRIDGES]:
            low = np.minimum(boxes[k, :2], one.box[:2])
            high = np.maximum(boxes[k, 2:], one.box[2:])
            within = ((boxes[:, :2] <= high) & (boxes[:, 2:] >= low)).all(axis=1)
            within[k] = False  # a bridge stays within the box of both, so others cannot cross it
            others = shapely.STRtree([loops[i].ring for i in np.flatnonzero(within)])
            for width in (2.0, 1.2, 0.6, 0.3):
                gap = max(1, round(width * radius / step))
                candidate = _Loop(_bridge(one.points, at, loops[k].points, to, gap, step))
                crossed = others.query(candidate.ring, predicate="intersects")
                if candidate.ring.is_simple and not crossed.size:
                    joined = (candidate, k)
                    break
            if joined:
                break
        if joined is None:
            if keep:  # a piece of the picture stays a knot of its own
                kept.append(one.points)
                until -= 1
            continue
        loop, k = joined
        loops[k], sizes[k], boxes[k] = loop, len(loop.points), loop.box
    return [loop.points for loop in loops] + kept


def smooth_closed(curve: Array, sigma: float) -> Array:
    """Smooth an evenly sampled closed curve by a Gaussian; sigma is in samples."""
    frequency = np.fft.rfftfreq(len(curve)) * 2 * np.pi
    damp = np.exp(-0.5 * (sigma * frequency) ** 2)[:, None]
    return np.asarray(np.fft.irfft(np.fft.rfft(curve, axis=0) * damp, len(curve), axis=0))


def fill(
    polygon: MultiPolygon, radius: float, knots: int | None = None, spacing: float = 2.0
) -> Template:
    """Build the filling template of a silhouette.

    A piece that no tube draws, such as a thin frame, gets no curve, since a loop at its centroid would lie
    outside it. If no piece gets one, each gets its loop, so that callers can measure how little that draws.

    Args:
        polygon: silhouette in the plane of the template, mm.
        radius: projected tube radius there, mm.
        knots: None for one curve a piece, or the number of curves to bridge the pieces to.
        spacing: distance between neighbouring rings, in tube radii.
    """
    step = radius * 0.25
    curves: list[Array] = []
    parts = [part for piece in _polygons(polygon) for part in _without_noise(piece, radius)]
    found = [rings_of(piece, radius, spacing) for piece in parts]
    if not any(found):
        found = [[_small_loop(piece, radius)] for piece in parts]
    for lines in found:
        rings = [sample_evenly(np.asarray(r.coords)[:-1], step) for r in lines]
        curves.extend(join_curves(rings, radius, step))
    if knots is not None:
        curves = join_curves(curves, radius, step, knots, keep=True)
    smoothed = curves
    for sigma in (2.0, 1.0, 0.5):
        trial = [smooth_closed(sample_evenly(c, step), sigma * radius * 0.4 / step) for c in curves]
        if simple_curves(trial):
            smoothed = trial
            break
    return Template(tuple(smoothed), polygon, radius)


def enlarge_loops(template: Template, bend: float, flat: bool = False) -> Template:
    """Replace each curve that is smaller than any closed tube by the smallest ring.

    Args:
        bend: least bend radius of the tube, mm. flat: as for `least_ring`.
    """
    smaller = [_is_smaller(curve, bend) for curve in template.curves]
    if not any(smaller):
        return template
    curves = tuple(
        least_ring(LinearRing(curve), 0.0, bend, flat) if small else curve
        for curve, small in zip(template.curves, smaller, strict=True)
    )
    return replace(template, curves=curves)


def _is_smaller(curve: Array, bend: float) -> bool:
    """Return whether a closed curve (n, 2) is smaller than any with this least bend radius, mm."""
    low, high = curve.min(axis=0), curve.max(axis=0)
    if float((high - low).max()) >= 2.0 * bend:
        return False
    return longer_side(LinearRing(curve)) < 2.0 * bend


def template_iou(template: Template, polygon: MultiPolygon) -> float:
    """Return the IoU of the planar tube with a silhouette, computed on polygons."""
    return polygon_iou(template.tube, polygon)


def _band(curve: Array, radius: float) -> Polygon | MultiPolygon:
    """Return the area within `radius` of a closed planar curve.

    Where straight strands just touch, GEOS returns an invalid polygon of a wrong area; a radius smaller by a
    hair leaves gaps there and is valid.
    """
    line = LinearRing(curve)
    band = line.buffer(radius)
    return band if band.is_valid else line.buffer(radius * (1 - _HAIR)).buffer(0)
