"""What a tube can draw of a silhouette: its opening by a disc, its losses, and strokes made wider.

Small pieces and holes that a person would miss are judged one by one. An eye, or a letter of a name, is a
hundredth of the area, and is what people look at first; the IoU of the whole picture hardly shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import LinearRing, MultiPolygon, Polygon

from knotfab.base.arrays import Array, Mask
from knotfab.picture.silhouette import outline_px, pieces_of, polygon_iou

_COARSE = 0.02  # radii by which an outline may be simplified before opening
_SLIVER = 0.03  # radii; slivers at edges are less than twice as thick
_CORNERS = 64  # corners of a ring


def _open(shape: Polygon | MultiPolygon, radius: float) -> Polygon | MultiPolygon:
    return shape.buffer(-radius).buffer(radius)


def open_by(shape: Polygon | MultiPolygon, radius: float) -> Polygon | MultiPolygon:
    """Return the morphological opening by a disc, exact to a fiftieth of its radius."""
    return _open(shape.simplify(_COARSE * radius), radius)


def opening_iou(polygon: MultiPolygon, radius: float) -> float:
    """Return the IoU of a silhouette with its opening: the share that a tube draws without spilling."""
    opened = _open(polygon, radius)
    return polygon_iou(opened, polygon)


def longer_side(shape: Polygon | MultiPolygon | LinearRing) -> float:
    """Return the longer side of a shape's narrowest bounding rectangle."""
    return float(max(np.linalg.norm(side) for side in _rectangle(shape)[1]))


def _rectangle(shape: Polygon | MultiPolygon | LinearRing) -> tuple[Array, Array]:
    """Return the centre (2,) and the sides (2, 2) of a shape's narrowest bounding rectangle."""
    corners = np.asarray(shapely.minimum_rotated_rectangle(shape).exterior.coords)[:4]
    return corners.mean(axis=0), np.diff(corners[:3], axis=0)


def least_ring(shape: Polygon | LinearRing, inset: float, bend: float, flat: bool = False) -> Array:
    """Return the smallest closed tube in a shape's place, as its projected centre line, (m, 2).

    A closed tube is no smaller across than a circle of its least bend radius. Seen from the side
    that is an ellipse, which lies along the shape and is as wide as fits.

    Args:
        inset: how far inside the shape the centre line must lie. bend: the least bend radius.
        flat: whether the ring cannot be turned out of the picture's plane.
    """
    middle, sides = _rectangle(shape)
    lengths = np.linalg.norm(sides, axis=1)
    longer = int(lengths.argmax())
    along = sides[longer] / lengths[longer]
    across = np.array([-along[1], along[0]])
    least = bend if flat else 0.01 * bend  # width over length of a ring seen from its edge
    minor = float(np.clip(0.5 * lengths[1 - longer] - inset, least, bend))
    turn = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    ring: Array = middle + np.outer(bend * np.cos(turn), along)
    return ring + np.outer(minor * np.sin(turn), across)


def thickest_radius(polygon: MultiPolygon, iou: float, low: float, high: float) -> float | None:
    """Return the largest radius from `low` to `high` whose opening has this IoU; None if none has.

    Radii are in the polygon's unit; a frame s times as large allows a tube s times as thick.
    """
    if opening_iou(polygon, low) < iou:
        return None
    if opening_iou(polygon, high) >= iou:
        return high
    while high > 1.002 * low:  # the search's relative tolerance
        middle = float(np.sqrt(low * high))
        if opening_iou(polygon, middle) >= iou:
            low = middle
        else:
            high = middle
    return low


@dataclass(frozen=True)
class Loss:
    """A part of a silhouette that a tube cannot draw, in the silhouette's unit.

    `at`: a point in it, where it is thickest; `thickness` there, and `extent`, its longest side.
    """

    shape: Polygon
    at: tuple[float, float]
    thickness: float
    extent: float


def find_losses(polygon: MultiPolygon, opened: Polygon | MultiPolygon, radius: float) -> list[Loss]:
    """Return the parts lost by a tube of this radius, largest first; `opened` is what it draws (`open_by`).

    Only parts that reach more than a radius beyond what is drawn count; rounded corners do not.
    """
    try:
        whole = polygon.difference(opened)
    except shapely.GEOSException:  # edges that nearly meet: as well on a grid
        grid = 1e-6 * max(1e-9, *np.abs(polygon.bounds))
        whole = shapely.difference(shapely.make_valid(polygon), shapely.make_valid(opened), grid)
    far = whole if opened.is_empty else whole.difference(opened.buffer(radius))
    thin = _SLIVER * radius
    # slivers along edges would join what is lost at corners, so they go; lines as thin stay by themselves
    thick = whole.buffer(-thin, join_style="mitre").buffer(thin, join_style="mitre")
    parts = [part for part in shapely.get_parts(thick) if part.intersects(far)]
    known = shapely.union_all(parts)
    hair = shapely.get_parts(whole.difference(thick))
    parts += [part for part in hair if part.intersects(far) and not part.intersects(known)]
    found = []
    for part in parts:
        if not isinstance(part, Polygon):
            continue
        # to a fiftieth of the radius: the circle's place need not be exact
        circle = shapely.maximum_inscribed_circle(part, tolerance=0.02 * radius)
        x, y = circle.coords[0]
        left, low, right, high = part.bounds
        found.append(Loss(part, (x, y), 2.0 * circle.length, max(right - left, high - low)))
    return sorted(found, key=lambda loss: -loss.shape.area)


# Widening thin strokes of a silhouette until a tube can draw them.

_MOST = 0.5  # the share of a line drawing's middle lines that are thinner than the tube
_SOLID = 0.2  # the largest share of its area that is twice as thick


def _depth_inside(mask: Mask) -> Array:
    """Return each pixel's distance from the background, px, (H, W)."""
    from scipy import ndimage

    # a pixel's middle is half a pixel inside its side
    found: Array = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    return np.maximum(found, 0.0)


def draw_discs(middles: Mask, radius: float) -> Mask:
    """Draw discs of a radius (px) about the marked pixels."""
    from scipy import ndimage

    if not middles.any():
        return middles
    return np.asarray(ndimage.distance_transform_edt(~middles) <= radius)


def _draw_fitting(inside: Array, radius: float) -> Mask:
    """Draw the discs of a radius that fit inside a mask."""
    return draw_discs(inside >= radius, radius)


def _medial_axis(mask: Mask, inside: Array) -> Mask:
    """Return the medial axis: pixels with no neighbour further inside."""
    from scipy import ndimage

    # px: on a slope of the distance a neighbour is further in by 0.9 or more, on a ridge by less
    return np.asarray(mask & (inside > ndimage.maximum_filter(inside, 3) - 0.7))


def is_thin(mask: Mask, width_px: float) -> bool:
    """Return whether a silhouette is a line drawing with strokes thinner than this.

    That is so if most of its medial axis, by length, is thinner and hardly any of its area is twice as thick.
    """
    # a thick picture is told at once: where a fifth at most is solid, the area is bounded by the edge
    if 2.0 * mask.sum() > 2.0 / (1.0 - _SOLID) * width_px * outline_px(mask):
        return False
    inside = _depth_inside(mask)
    thin = inside[_medial_axis(mask, inside)] < 0.5 * width_px
    if thin.mean() <= _MOST:
        return False
    return bool((mask & _draw_fitting(inside, width_px)).sum() / mask.sum() < _SOLID)


def run_together(mask: Mask, widened: Mask, width_px: float) -> float:
    """Return the share of widened strokes that merged into something thicker than one stroke."""
    radius = 0.75 * width_px
    blobs = _draw_fitting(_depth_inside(widened), radius) & ~_draw_fitting(
        _depth_inside(mask), radius
    )
    return float(blobs.sum() / widened.sum())


def thicken(mask: Mask, width_px: float) -> Mask:
    """Widen strokes to at least `width_px`, along their medial axis.

    What an opening by a disc of that width leaves out, and is longer than the disc is wide, is a stroke: a
    disc is added at every point of its middle line, which is where the distance to the background is
    largest across it (Blum's medial axis). What is thick already stays as it is.

    Args:
        mask: (H, W).
    """
    from scipy import ndimage

    radius = 0.5 * width_px
    inside = _depth_inside(mask)
    opened = _draw_fitting(inside, radius)
    thin = mask & ~opened
    labels, areas = pieces_of(thin)
    if not len(areas):
        return mask
    reach = ndimage.distance_transform_edt(~opened) if opened.any() else np.full(mask.shape, np.inf)
    # corners that the disc rounds are no strokes: they end within its radius
    long = ndimage.maximum(reach, labels, np.arange(len(areas) + 1)) > radius
    strokes = np.asarray(long)[labels] & thin
    middle = strokes & _medial_axis(mask, inside)
    return mask | draw_discs(middle, radius)


_SMALL = 0.1  # largest share of the silhouette's area; what is larger a good IoU of the whole keeps
# least IoU of a piece or hole with what is drawn of it, or it is lost or another shape
_ALIKE = 0.7
_NEAR = 2.0  # radii about a piece or hole within which what is drawn too much changes its shape
_ROW = 3  # least number of pieces of a row
# largest ratio of heights within a row of letters; capitals and small ones differ so
_LIKE_HEIGHTS = 1.7
_APART = 1.2  # largest distance of a row's neighbours, over their height


@dataclass(frozen=True)
class Small:
    """A small piece or hole of a silhouette, in the silhouette's unit."""

    kind: Literal["piece", "hole"]
    shape: Polygon | MultiPolygon

    @property
    def extent(self) -> float:
        """Its longer side."""
        return longer_side(self.shape)


def find_small(polygon: MultiPolygon, least: float) -> list[Small]:
    """Return a silhouette's small pieces and holes of at least this area."""
    most = _SMALL * polygon.area
    found = []
    for piece in polygon.geoms:
        if least <= Polygon(piece.exterior).area <= most:
            found.append(Small("piece", piece))
        rings = (Polygon(ring) for ring in piece.interiors)
        holes = (ring.difference(polygon) for ring in rings if least <= ring.area <= most)
        found += [Small("hole", hole) for hole in holes if hole.area >= least]
    return found


def find_missed(
    small: Sequence[Small], polygon: MultiPolygon, drawn: Polygon | MultiPolygon, radius: float
) -> list[Small]:
    """Return those of a silhouette's small parts that a drawing by a tube of this radius loses or deforms."""
    polygon, drawn = shapely.make_valid(polygon), shapely.make_valid(drawn)
    return [one for one in small if _likeness(one, polygon, drawn, radius) < _ALIKE]


def _likeness(
    one: Small, polygon: MultiPolygon, drawn: Polygon | MultiPolygon, radius: float
) -> float:
    """Return the IoU of a part with what is drawn of it, including what is spilled or missing close by."""
    near = one.shape.buffer(_NEAR * radius)
    wanted, found = (shape.intersection(near) for shape in (polygon, drawn))
    if one.kind == "hole":
        wanted, found = near.difference(wanted), near.difference(found)
    kept = one.shape.intersection(found).area
    return float(kept / (one.shape.area + found.difference(wanted).area))


def is_row(pieces: Sequence[Polygon]) -> bool:
    """Return whether pieces stand beside each other in one row, as letters do."""
    if len(pieces) < _ROW:
        return False
    left, top, right, bottom = np.array([piece.bounds for piece in pieces]).T
    order = np.argsort(left)
    high = bottom - top
    level = bool(np.ptp(0.5 * (top + bottom)) < 0.5 * high.max())
    near = bool((left[order][1:] - right[order][:-1] < _APART * high.max()).all())
    return level and near and bool(high.max() < _LIKE_HEIGHTS * high.min())
