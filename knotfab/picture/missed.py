"""Find the small pieces and holes of a silhouette that a person would miss in a tube's drawing of it.

An eye, or a letter of a name, is a hundredth of the area, and is what people look at first. The IoU of the
whole picture hardly tells, so each counts by its own likeness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from knotfab.picture.opening import longer_side

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
    """Return a silhouette's small pieces and holes, of no less than this area."""
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
    """Return the IoU of a part with what is drawn of it, spill or lack close by included."""
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
