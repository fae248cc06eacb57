"""What a tube can draw of a silhouette: its morphological opening by a disc, exact on polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely import MultiPolygon, Polygon

__all__ = ["Loss", "find_losses", "open_by", "opening_iou", "thickest_radius"]

_COARSE = 0.02  # radii that an outline may move by before it is opened
_SLIVER = 0.03  # radii: no slivers that this leaves along edges are twice as thick
_STEPS = 14  # of the search for a radius: 0.05 % of it where the range is a thousandfold


def _open(shape: Polygon | MultiPolygon, radius: float) -> Polygon | MultiPolygon:
    return shape.buffer(-radius).buffer(radius)


def open_by(shape: Polygon | MultiPolygon, radius: float) -> Polygon | MultiPolygon:
    """The opening by a disc, to a fiftieth of its radius; the same of an opening by a smaller disc."""
    return _open(shape.simplify(_COARSE * radius), radius)


def opening_iou(polygon: MultiPolygon, radius: float) -> float:
    """IoU of the silhouette with its morphological opening: what a tube draws without spilling."""
    opened = _open(polygon, radius)
    return float(opened.intersection(polygon).area / polygon.union(opened).area)


def thickest_radius(polygon: MultiPolygon, iou: float, low: float, high: float) -> float | None:
    """The largest radius between two with which the opening has this IoU, None where `low` has not.

    In the polygon's own unit; a frame s times as large allows a tube s times as thick.
    """
    if opening_iou(polygon, low) < iou:
        return None
    if opening_iou(polygon, high) >= iou:
        return high
    for _ in range(_STEPS):
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
    """The parts that a tube of this radius loses, largest first; `opened` is what it draws (`open_by`).

    A part counts that reaches more than a radius beyond what is drawn: rounded corners are no loss.
    """
    import shapely

    whole, thin = polygon.difference(opened), _SLIVER * radius
    far = whole if opened.is_empty else whole.difference(opened.buffer(radius))
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
