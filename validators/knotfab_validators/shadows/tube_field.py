"""The exact tube's picture: the signed distance to its outline, and how far a shadow departs from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.curves import edges_of
from knotfab_validators.shadows.exact_shadow import Linework, wound_mask
from knotfab_validators.shadows.view import ViewGeometry

MARGIN_PX = 3.0  # px around a capsule's box within which its distance is evaluated first
# differing pixels that are examined; with more, the error is far above any limit
MOST_PIXELS = 20_000
AT_ONCE = 2_000  # pixels evaluated at a time: each may lie in the boxes of hundreds of capsules
ROUND = 48  # corners of a ball's outline


@dataclass(frozen=True)
class TubeField:
    """Capsules (segments with one radius, mm) seen in one view, with data for fast look-ups."""

    start: Array  # (n, 3), relative to the light
    end: Array  # (n, 3)
    radius: float
    geometry: ViewGeometry
    middles: Array  # (n, 2) pixels, the projected middle of each capsule
    bounds: Array  # (n, 4) pixels, each capsule's box (u0, v0, u1, v1)
    mask: Mask  # (height, width): the tube's picture at the pixel centres

    def signed_distance(self, pixels: Array) -> Array:
        """Return the signed distance (m,), in mm on the receiver, of pixels (m, 2) to the tube's outline.

        Positive inside. The distance of the ray through a pixel from a segment, less the radius,
        is turned into a distance on the receiver by its gradient there: moving the pixel by dQ
        moves the nearest point of the ray by tau dQ (tau: how far along the ray it lies), so the
        distance changes by tau <m, dQ>, m being the unit vector from segment to ray. Exact on
        the outline, and of second order near it. The tube is the union of its capsules, so the
        largest value counts.
        """
        margin = MARGIN_PX * np.array([-1.0, -1.0, 1.0, 1.0])
        tree = shapely.STRtree(shapely.box(*(self.bounds + margin).T))
        best = np.full(len(pixels), -np.inf)
        for first in range(0, len(pixels), AT_ONCE):
            some = pixels[first : first + AT_ONCE]
            at, capsule = tree.query(shapely.points(some))
            np.maximum.at(best, first + at, self._value(some[at], capsule))
        far = np.flatnonzero(best < -MARGIN_PX * self.geometry.pixel_mm)
        # the nearest capsule may have been left out: try those whose middles are seen nearest
        if len(far):
            _, near = cKDTree(self.middles).query(pixels[far], k=min(16, len(self.middles)))
            near = np.asarray(near).reshape(len(far), -1)
            values = self._value(np.repeat(pixels[far], near.shape[1], axis=0), near.ravel())
            best[far] = np.maximum(best[far], values.reshape(near.shape).max(axis=1))
        return best

    def _value(self, pixels: Array, capsule: Ints) -> Array:
        g = self.geometry
        ray = g.on_receiver(pixels) - g.light
        length = np.linalg.norm(ray, axis=1)
        unit = ray / length[:, None]
        a, e = self.start[capsule], self.end[capsule] - self.start[capsule]
        ad, ed = np.cross(a, unit), np.cross(e, unit)
        square = (ed * ed).sum(axis=1)
        # if the ray runs along the segment, all its points are equally near: take the start
        safe = np.where(square > 0, square, 1.0)
        t = np.clip(-(ad * ed).sum(axis=1) / safe, 0.0, 1.0)
        point = a + t[:, None] * e
        along = (point * unit).sum(axis=1)
        gap = along[:, None] * unit - point
        distance = np.linalg.norm(gap, axis=1)
        m = gap / np.maximum(distance, 1e-12)[:, None]
        u, v = g.du / np.linalg.norm(g.du), g.dv / np.linalg.norm(g.dv)
        slope = (along / length) * np.hypot(m @ u, m @ v)
        # on the centre line the direction is undefined: take the gentlest slope
        slope = np.where(distance > 1e-9, np.maximum(slope, 1e-9), along / length)
        value: Array = (self.radius - distance) / slope
        return value


def tube_field(
    polygons: Sequence[Array],
    radius: float,
    geometry: ViewGeometry,
    closed: Sequence[bool] | None = None,
) -> TubeField:
    """Build the exact tube of polygons [(n, 3), ...], mm, closed by default, in `geometry`."""
    edges = edges_of(polygons, closed)
    start, end = edges.start - geometry.light, edges.end - geometry.light
    pictures = _picture_balls(start, end, radius, geometry)
    begin, stop = _trace_hulls(pictures)
    lines = Linework(begin, stop, np.ones(len(begin), dtype=np.int64))
    middles, _ = geometry.project((start + end) / 2 + geometry.light)
    mask = wound_mask([lines], geometry.width, geometry.height)
    bounds = np.concatenate([pictures.min(axis=1), pictures.max(axis=1)], axis=1)
    return TubeField(start, end, radius, geometry, middles, bounds, mask)


def _picture_balls(start: Array, end: Array, radius: float, geometry: ViewGeometry) -> Array:
    """Return points (n, 2 ROUND, 2) on the outlines of each capsule's two balls, px.

    The light's rays touch a ball at c in the circle with centre c (1 - r²/|c|²) and radius
    r sqrt(1 - r²/|c|²), across c. A capsule is the convex hull of its balls, and so is its picture.
    """
    angle = 2 * np.pi * np.arange(ROUND) / ROUND
    pictures = []
    for c in (start, end):
        square = (c * c).sum(axis=1)
        cosine2 = 1.0 - radius**2 / square
        away = c / np.sqrt(square)[:, None]
        first = np.cross(away, geometry.up)
        first /= np.linalg.norm(first, axis=1)[:, None]
        second = np.cross(away, first)
        rim = (
            radius
            * np.sqrt(cosine2)[:, None, None]
            * (np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None])
        )
        circle = c[:, None] * cosine2[:, None, None] + rim + geometry.light
        pictures.append(geometry.project(circle.reshape(-1, 3))[0].reshape(len(c), ROUND, 2))
    return np.concatenate(pictures, axis=1)


def _trace_hulls(points: Array) -> tuple[Array, Array]:
    """Return edges (k, 2), from and to, of the convex hulls of n point lists (n, m, 2)."""
    columns, rows = np.moveaxis(points, 2, 0)
    return _chain_hulls(points, np.lexsort((rows, columns), axis=1))


@compiled
def _chain_hulls(points: Array, orders: Ints) -> tuple[Array, Array]:
    """Do the work of `_trace_hulls`, for orders (n, m) of the points by column, then by row.

    The method is Andrew's monotone chain ("Another efficient algorithm for convex hulls in two
    dimensions", 1979).
    """
    count, each = points.shape[:2]
    begin, stop = np.empty((count * each, 2)), np.empty((count * each, 2))
    chain = np.empty(2 * each, np.int64)
    found = 0
    for n in range(count):
        p, order, size = points[n], orders[n], 0
        for side in range(2):
            least = size + 1
            for i in range(each):
                at = order[i] if side == 0 else order[each - 1 - i]
                while size > least:
                    a, b = chain[size - 2], chain[size - 1]
                    turn = (p[b, 0] - p[a, 0]) * (p[at, 1] - p[a, 1])
                    turn -= (p[b, 1] - p[a, 1]) * (p[at, 0] - p[a, 0])
                    if turn > 0.0:
                        break
                    size -= 1
                chain[size] = at
                size += 1
            size -= 1  # the last point is the first of the other side
        for i in range(size):
            a, b = chain[i], chain[(i + 1) % size]
            for axis in range(2):
                begin[found, axis], stop[found, axis] = p[a, axis], p[b, axis]
            found += 1
    return begin[:found], stop[:found]


@dataclass(frozen=True)
class OutlineError:
    """How far a shadow departs from the exact tube's, in mm on the receiver, and where (pixel)."""

    spill_mm: float  # how far the shadow reaches outside the tube's
    missing_mm: float  # how far the tube's shadow reaches outside the shadow
    where: tuple[float, float]

    @property
    def largest_mm(self) -> float:
        return max(self.spill_mm, self.missing_mm, 0.0)


def outline_error(
    field: TubeField, outline: Array, shadow: Mask, own: Array | None = None
) -> OutlineError:
    """Measure the largest distances between a shadow and the exact tube's, both ways.

    Spill is the largest distance outside the tube of any point of the shadow, missing the
    largest distance inside the tube of any point that is not in the shadow. Both are taken over
    the vertices of the shadow's exact outline (which belong to both sides) and over the pixel
    centres, so that neither a sliver nor a whole missing strand is overlooked.

    Args:
        outline: (m, 2) vertices of the exact shadow's outline, in pixels of the field's geometry.
        shadow: (height, width), the shadow at the pixel centres.
        own: (k, 2) pixels where vertices of the tube's surface are seen. With them the spill is
            taken over these alone, so that a mount's shadow is none of it; what is missing is
            found as before.
    """
    lit = _sample_mask(field.mask & ~shadow)
    at_outline = field.signed_distance(outline)
    if own is None:
        dark = _sample_mask(shadow & ~field.mask)
        reach, spill = [outline, dark], [-at_outline, -field.signed_distance(dark)]
    else:
        own = own[~_find_well_inside(field.mask, own)]
        reach, spill = [own], [-field.signed_distance(own)]
    missing = [at_outline, field.signed_distance(lit)]
    points = np.concatenate([*reach, outline, lit])
    error = np.concatenate([*spill, *missing])
    worst = points[int(np.argmax(error))] if len(error) else np.zeros(2)
    return OutlineError(
        spill_mm=float(np.concatenate(spill).max(initial=0.0)),
        missing_mm=float(np.concatenate(missing).max(initial=0.0)),
        where=(float(worst[0]), float(worst[1])),
    )


def _sample_mask(mask: Mask) -> Array:
    """Return pixel centres (n, 2) of a mask, thinned evenly if there are very many."""
    rows, columns = np.nonzero(mask)
    stride = -(-len(rows) // MOST_PIXELS) or 1
    return np.column_stack([columns, rows])[::stride].astype(np.float64)


def _find_well_inside(mask: Mask, pixels: Array) -> Mask:
    """Return which pixels (m,) are dark with all their neighbours, so that nothing there can be spill."""
    inner = mask.copy()
    for axis in (0, 1):
        inner &= np.roll(inner, 1, axis) & np.roll(inner, -1, axis)
    whole = np.rint(pixels).astype(np.int64)
    seen = ((whole >= 1) & (whole < np.array(mask.shape[::-1]) - 1)).all(axis=1)
    inside: Mask = np.zeros(len(pixels), dtype=bool)
    inside[seen] = inner[whole[seen, 1], whole[seen, 0]]
    return inside
