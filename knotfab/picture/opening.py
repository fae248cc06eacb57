"""The part of a silhouette that a tube can draw: its morphological opening by a disc, exact on polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LinearRing, MultiPolygon, Polygon

from knotfab.base.arrays import Array, Mask
from knotfab.picture.silhouette import outline_px, pieces_of, polygon_iou

_COARSE = 0.02  # radii that an outline may move by before it is opened
_SLIVER = 0.03  # radii: no slivers that this leaves along edges are twice as thick
_CORNERS = 64  # corners of a ring


def _open(shape: Polygon | MultiPolygon, radius: float) -> Polygon | MultiPolygon:
    return shape.buffer(-radius).buffer(radius)


def open_by(shape: Polygon | MultiPolygon, radius: float) -> Polygon | MultiPolygon:
    """Return the opening by a disc, to a fiftieth of its radius; the same of an opening by a smaller disc."""
    return _open(shape.simplify(_COARSE * radius), radius)


def opening_iou(polygon: MultiPolygon, radius: float) -> float:
    """Return the IoU of the silhouette with its morphological opening: what a tube draws without spilling."""
    opened = _open(polygon, radius)
    return polygon_iou(opened, polygon)


def longer_side(shape: Polygon | LinearRing) -> float:
    """Return the longer side of the narrowest rectangle about a shape."""
    return float(max(np.linalg.norm(side) for side in _rectangle(shape)[1]))


def _rectangle(shape: Polygon | LinearRing) -> tuple[Array, Array]:
    """Return the middle (2,) of the narrowest rectangle about a shape, and its sides (2, 2)."""
    corners = np.asarray(shapely.minimum_rotated_rectangle(shape).exterior.coords)[:4]
    return corners.mean(axis=0), np.diff(corners[:3], axis=0)


def least_ring(shape: Polygon | LinearRing, inset: float, bend: float, flat: bool = False) -> Array:
    """Return (m, 2) The centre line, as it is seen, of the least closed tube in a shape's place.

    A closed tube is no smaller across than a circle of its least bend radius; seen from aside that is an
    ellipse, which lies along the shape and is as wide as fits.

    Args:
        inset: inset of the centre line in the shape. bend: the least bend radius.
        flat: the ring cannot be turned out of the picture's plane.
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
    """Return the largest radius between two with which the opening has this IoU, None where `low` has not.

    In the polygon's own unit; a frame s times as large allows a tube s times as thick.
    """
    if opening_iou(polygon, low) < iou:
        return None
    if opening_iou(polygon, high) >= iou:
        return high
    while high > 1.002 * low:  # how far above the largest radius the search may end, as a factor
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
    """Find the parts that a tube of this radius loses, largest first; `opened` is what it draws (`open_by`).

    A part counts that reaches more than a radius beyond what is drawn: rounded corners are no loss.
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


# Thin strokes of a silhouette, widened until a tube can draw them.


_MOST = 0.5  # the share of a line drawing's middle lines that are thinner than the tube
_SOLID = 0.2  # the largest share of its area that is twice as thick


def _inside(mask: Mask) -> Array:
    """Return (H, W) distance of each pixel's middle from the background, px."""
    from scipy import ndimage

    # a pixel's middle is half a pixel inside its side
    found: Array = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    return np.maximum(found, 0.0)


def draw_discs(middles: Mask, radius: float) -> Mask:
    """Draw discs of a radius (px) about these pixels."""
    from scipy import ndimage

    if not middles.any():
        return middles
    return np.asarray(ndimage.distance_transform_edt(~middles) <= radius)


def _opened(inside: Array, radius: float) -> Mask:
    """Draw the discs of a radius that lie in a mask."""
    return draw_discs(inside >= radius, radius)


def _ridge(mask: Mask, inside: Array) -> Mask:
    """Return the middle lines: pixels of which no neighbour is further in."""
    from scipy import ndimage

    # px: on a slope of the distance a neighbour is further in by 0.9 or more, on a ridge by less
    return np.asarray(mask & (inside > ndimage.maximum_filter(inside, 3) - 0.7))


def is_thin(mask: Mask, width_px: float) -> bool:
    """Tell whether a silhouette is a drawing of lines thinner than this.

    Most of its middle lines are, by their length, and hardly any of its area is twice as thick.
    """
    # a thick picture is told at once: where a fifth at most is solid, the area is bounded by the edge
    if 2.0 * mask.sum() > 2.0 / (1.0 - _SOLID) * width_px * outline_px(mask):
        return False
    inside = _inside(mask)
    thin = inside[_ridge(mask, inside)] < 0.5 * width_px
    if thin.mean() <= _MOST:
        return False
    return bool((mask & _opened(inside, width_px)).sum() / mask.sum() < _SOLID)


def run_together(mask: Mask, widened: Mask, width_px: float) -> float:
    """Measure the share of widened strokes where they ran together: thicker than one, where none was."""
    radius = 0.75 * width_px
    blobs = _opened(_inside(widened), radius) & ~_opened(_inside(mask), radius)
    return float(blobs.sum() / widened.sum())


def thicken(mask: Mask, width_px: float) -> Mask:
    """Return the silhouette with its strokes at least `width_px` wide, along their middle lines.

    What an opening by a disc of that width leaves out, and is longer than the disc is wide, is a stroke: a
    disc is added at every point of its middle line, which is where the distance to the background is
    largest across it (Blum's medial axis). What is thick already stays as it is.

    Args:
        mask: (H, W).
    """
    from scipy import ndimage

    radius = 0.5 * width_px
    inside = _inside(mask)
    opened = _opened(inside, radius)
    thin = mask & ~opened
    labels, areas = pieces_of(thin)
    if not len(areas):
        return mask
    reach = ndimage.distance_transform_edt(~opened) if opened.any() else np.full(mask.shape, np.inf)
    # corners that the disc rounds are no strokes: they end within its radius
    long = ndimage.maximum(reach, labels, np.arange(len(areas) + 1)) > radius
    strokes = np.asarray(long)[labels] & thin
    middle = strokes & _ridge(mask, inside)
    return mask | draw_discs(middle, radius)
