"""The filling template: concentric insets of the silhouette, joined into one simple closed curve a piece.

Polylines lie one projected tube width apart, so the planar tube covers the picture. Being simple and
planar, every curve is an unknot, and the curves together an unlink, by inspection.
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

_THIN_OUTER = 0.55  # a part of the outline is drawn if wider than this times the tube's width
_BRIDGES = 4  # nearest curves that a curve may be joined to
_THIN_INNER = 0.12  # an inner band is filled if wider than this times the tube's width
_NOISY = 5000  # corners: an outline of more, without room for the tube, is noise to it
# a loop in the middle of a piece smaller than the tube covers at least this share of it
_COVERED = 1.0 / 3.0
_HAIR = 1e-7  # a share of the radius
# a share of the radius: such an outline's area is less than this times its length
_NOISE_WIDTH = 0.5


@dataclass(frozen=True)
class Template:
    """Closed planar curves [(n, 2) mm], disjoint and simple, and the polygon they fill.

    With `passes` they run along lines, there and back, and hide behind themselves.
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
    """Return the piece, or where it is all outline to the tube, what is left of it at the tube's own scale.

    Insets of noise take minutes and leave nothing that a tube could draw.
    """
    noisy = shapely.get_num_coordinates(piece) > _NOISY
    if not noisy or piece.area > _NOISE_WIDTH * radius * piece.length:
        return [piece]
    least = np.pi * radius**2  # a hole or a piece below the tube's own section is a speck
    holes = [hole for hole in piece.interiors if Polygon(hole).area > least]
    coarse = Polygon(piece.exterior, holes).simplify(radius, preserve_topology=False)
    parts = [part for part in _polygons(shapely.make_valid(coarse)) if part.area > least]
    return parts or [piece.envelope]


def _ring_region(region: BaseGeometry, radius: float, thin: float) -> BaseGeometry:
    """Find where centre lines may run: the inset, with parts narrower than the tube inset by less."""
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
    """Draw the centre lines of concentric tubes that cover `piece`, outermost first; none: no tube draws it.

    Args:
        piece: silhouette, mm.
        radius: projected tube radius, mm.
        spacing: distance between neighbouring rings in tube radii.
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
        # a piece smaller than the tube: one small loop in its middle, if that is where it is
        loop = _small_loop(piece, radius)
        drawn = Polygon(loop).buffer(radius)
        if piece.intersection(drawn).area >= _COVERED * piece.area:
            rings.append(loop)
    return rings


def _small_loop(piece: Polygon, radius: float) -> LinearRing:
    """Return a loop in the middle of a piece, smaller than the tube can bend."""
    middle = piece.representative_point() if piece.is_empty else piece.centroid
    return middle.buffer(radius * 0.35).exterior


def _turning(points: Array) -> Array:
    """Return the unsigned turning angle at each vertex, averaged over a few neighbours."""
    edge = np.diff(points, axis=0, append=points[:1])
    angle = np.arctan2(edge[:, 1], edge[:, 0])
    turn = np.abs((np.diff(angle, prepend=angle[-1:]) + np.pi) % (2 * np.pi) - np.pi)
    return np.asarray(uniform_filter1d(turn, 7, mode="wrap")) * 7


@dataclass(frozen=True, eq=False)
class _Loop:
    """A closed polyline (n, 2) while loops are joined, with what is asked of it time and again."""

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
    """Return the best place for a bridge: nearly the shortest, where both curves are straight."""
    near, index = other.tree.query(one.points)
    shortest = float(near.min())
    turns = np.minimum(one.turning, 2.0) + np.minimum(other.turning[index], 2.0)
    cost = near + radius * 0.7 * turns
    cost[near > shortest + 0.6 * radius] = np.inf
    best = int(np.argmin(cost))
    return shortest, best, int(index[best])


def _cut_open(points: Array, at: int, gap: int) -> Array:
    """Return the closed polyline cut open around vertex `at`, `gap` steps wide."""
    gap = max(1, min(gap, len(points) // 3))
    start = at + (gap + 1) // 2
    return np.roll(points, -start, axis=0)[: len(points) - gap + 1]


def _bridge(one: Array, at: int, other: Array, to: int, gap: int, step: float) -> Array:
    """Return both closed polylines joined by two parallel strands."""
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
    """Tell whether the closed curves are simple and disjoint."""
    rings = [LinearRing(c) for c in curves]
    if not all(ring.is_simple for ring in rings):
        return False
    one, other = shapely.STRtree(rings).query(rings, predicate="intersects")
    return bool((one == other).all())


def join_curves(
    curves: list[Array], radius: float, step: float, until: int = 1, keep: bool = False
) -> list[Array]:
    """Return closed curves joined, smallest first and each to its nearest, until so many are left.

    What is joined is simple, and clear of the others. A curve that no bridge reaches is left out, or with
    `keep` stays as it is.
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
            within[k] = False  # no bridge between the two crosses a place outside the box of both
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
            # an inner ring without a bridge is left out: its neighbours must cover for it
            continue
        loop, k = joined
        loops[k], sizes[k], boxes[k] = loop, len(loop.points), loop.box
    return [loop.points for loop in loops] + kept


def smooth_closed(curve: Array, sigma: float) -> Array:
    """Return Gaussian smoothing along an evenly sampled closed curve, sigma in samples."""
    frequency = np.fft.rfftfreq(len(curve)) * 2 * np.pi
    damp = np.exp(-0.5 * (sigma * frequency) ** 2)[:, None]
    return np.asarray(np.fft.irfft(np.fft.rfft(curve, axis=0) * damp, len(curve), axis=0))


def fill(
    polygon: MultiPolygon, radius: float, knots: int | None = None, spacing: float = 2.0
) -> Template:
    """Return the filling template of a silhouette.

    A piece that no tube draws, as a thin frame, gets no curve: a loop in its middle would stand where the
    picture has nothing. Where that is all of them each gets its loop, for whoever measures how little
    that draws.

    Args:
        polygon: silhouette in the plane of the template, mm.
        radius: projected tube radius there, mm.
        knots: None for one curve a piece; a number to bridge pieces until so many are left.
        spacing: distance between neighbouring rings in tube radii.
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


def as_bent(template: Template, bend: float, flat: bool = False) -> Template:
    """Return the template with the least ring in place of each curve that is smaller than any closed tube.

    Args:
        bend: the tube's least bend radius, mm. flat: as for `least_ring`.
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
    """Tell whether a closed curve (n, 2) is smaller than any with this least bend radius, mm."""
    low, high = curve.min(axis=0), curve.max(axis=0)
    if float((high - low).max()) >= 2.0 * bend:
        return False
    return longer_side(LinearRing(curve)) < 2.0 * bend


def template_iou(template: Template, polygon: MultiPolygon) -> float:
    """Return the IoU of the planar tube with the silhouette, exact on polygons."""
    return polygon_iou(template.tube, polygon)


def _band(curve: Array, radius: float) -> Polygon | MultiPolygon:
    """Return the area that a closed planar curve covers, drawn with a pen of this radius.

    Where strands of a picture with straight sides just touch, GEOS gives an invalid polygon of a wrong
    area, which no union takes, on a grid or off it: a pen that is a hair slimmer leaves gaps instead.
    """
    line = LinearRing(curve)
    band = line.buffer(radius)
    return band if band.is_valid else line.buffer(radius * (1 - _HAIR)).buffer(0)
