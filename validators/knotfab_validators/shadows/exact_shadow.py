"""The exact shadow of a mesh without graphics: silhouette edges, noded, kept by winding number."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.compiled import compiled
from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.geometry.sampling import number_runs
from knotfab_validators.shadows.view import ViewGeometry
from knotfab_validators.shadows.winding import Linework, winding_at, wound_mask

__all__ = [
    "NEAREST",
    "EdgeTable",
    "ShadowError",
    "cut_before",
    "on_page",
    "shadow_lines",
    "shadow_mask",
    "shadow_polygon",
]


NEAREST = 1e-6  # w (see `ViewGeometry.projection`) of what is too near to the light to be seen
STRAIGHT_PX = 4.0  # a line so long is straight on a curved receiver too


class ShadowError(BadFile):
    """The mesh has no shadow that makes sense in this scene, such as one that reaches the light."""


def _cut(homogeneous: Array, faces: Ints, inside: Mask, limit: float) -> tuple[Array, Ints]:
    """Return the part with w < `limit` of faces (m, 3) that have corners on both sides, as triangles.

    `homogeneous` (n, 3) holds (u w, v w, w), in which a straight edge stays straight; new corners are
    appended, one for each edge that is cut. `inside` (m, 3): which corners are on this side.
    """
    single = inside.sum(axis=1) == 1  # one corner is kept, else two
    alone = np.argmax(inside == single[:, None], axis=1)  # the corner without another on its side
    a, b, c = np.take_along_axis(faces, (alone[:, None] + np.arange(3)) % 3, axis=1).T
    cut = np.sort(np.concatenate([np.stack([a, b], axis=1), np.stack([c, a], axis=1)]), axis=1)
    key, place = np.unique(cut[:, 0] * len(homogeneous) + cut[:, 1], return_inverse=True)
    p, q = homogeneous[key // len(homogeneous)], homogeneous[key % len(homogeneous)]
    share = (limit - p[:, 2]) / (q[:, 2] - p[:, 2])
    corners = np.concatenate([homogeneous, p + share[:, None] * (q - p)])
    ab, ca = (len(homogeneous) + place).reshape(2, -1)
    kept = np.stack([a, ab, ca], axis=1)[single]
    first, second = np.stack([ab, b, c], axis=1)[~single], np.stack([ab, c, ca], axis=1)[~single]
    return corners, np.concatenate([kept, first, second])


class EdgeTable:
    """The faces (m, 3) that run through each edge, and which way: all that a mesh's shadows share.

    Args:
        count: how many vertices there are.
    """

    def __init__(self, faces: Ints, count: int) -> None:
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        a, b = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        key = np.minimum(a, b) * count + np.maximum(a, b)
        order = np.argsort(key, kind="stable")
        key = key[order]
        first = np.flatnonzero(np.diff(key, prepend=-1))
        self._ends = np.stack([key[first] // count, key[first] % count], axis=1)
        self._first = np.append(first, len(key))
        self._face, self._along = order // 3, np.where(a < b, 1, -1)[order]

    def find_silhouette(self, points: Array) -> Linework:
        """Find the silhouette edges, the vertices seen at `points` (n, 2), as `shadow_lines` has them."""
        edge, net = _count_edges(
            np.ascontiguousarray(points), self.faces, self._first, self._face, self._along
        )
        ends = self._ends[edge]
        return Linework(points[ends[:, 0]], points[ends[:, 1]], net)


@compiled
def _count_edges(
    points: Array, faces: Ints, first: Ints, face: Ints, along: Ints
) -> tuple[Ints, Ints]:
    """Find edges through which faces, turned to positive area, run more often one way, and how much more."""
    turned = np.zeros(len(faces), dtype=np.int64)
    for k in range(len(faces)):
        a, b, c = faces[k, 0], faces[k, 1], faces[k, 2]
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
        area = ux * vy - uy * vx
        turned[k] = 1 if area > 0.0 else -1 if area < 0.0 else 0
    edge = np.empty(len(first) - 1, dtype=np.int64)
    net = np.empty(len(first) - 1, dtype=np.int64)
    found = 0
    for k in range(len(first) - 1):
        total = 0
        for i in range(first[k], first[k + 1]):
            total += along[i] * turned[face[i]]
        if total != 0:
            edge[found], net[found] = k, total
            found += 1
    return edge[:found], net[:found]


def cut_before(homogeneous: Array, faces: Ints, limit: float) -> tuple[Array, Ints] | None:
    """Return the part of a mesh with w < `limit`, its new corners appended; None where that is all of it.

    `homogeneous` (n, 3) holds (u w, v w, w).
    """
    inside = (homogeneous[:, 2] < limit)[faces]
    whole = inside.all(axis=1)
    if whole.all():
        return None
    crossing, kept = inside.any(axis=1) & ~whole, faces[whole]
    if not crossing.any():
        return homogeneous, kept
    corners, pieces = _cut(homogeneous, faces[crossing], inside[crossing], limit)
    return corners, np.concatenate([kept, pieces])


def shadow_lines(
    vertices: Array, faces: Ints, geometry: ViewGeometry, table: EdgeTable | None = None
) -> Linework:
    """Give the silhouette edges of a mesh as oriented linework, in pixels of the flat receiver of `geometry`.

    Every face is turned to positive area in the picture; an edge that two faces run through in
    opposite directions cancels. What is left (silhouette edges, and free edges of a mesh that is
    not closed) is the boundary of the sum of all projected faces, so its winding number at a point
    is the number of faces over it: the shadow is where it is not zero, for any set of triangles.

    Args:
        vertices: (n, 3), mm, in the coordinates of `geometry`.
        faces: (m, 3) indices. table: table of them, where it is at hand.

    Raises:
        ShadowError: the part reaches the light or lies behind it.
    """
    faces = np.asarray(faces, dtype=np.int64)
    h = geometry.lift(vertices)
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if (h[used, 2] < NEAREST).any():
        raise ShadowError("the part reaches the light, or lies behind it: its shadow is unbounded")
    wall = geometry.cylinder
    if wall is not None and wall.is_beyond(vertices[used], geometry.normal).any():
        raise ShadowError("the part cuts the hollow wall, or lies behind it")
    # matter on or behind the receiver plane casts no shadow
    cut = cut_before(h, faces, geometry.w_of_receiver)
    if cut is not None:
        h, faces = cut
        table = None
    return (table or EdgeTable(faces, len(h))).find_silhouette(on_page(h))


def on_page(homogeneous: Array) -> Array:
    """Return pixels (n, 2) of (u w, v w, w) (n, 3)."""
    return _divide(np.ascontiguousarray(homogeneous))


@compiled
def _divide(homogeneous: Array) -> Array:
    page = np.empty((len(homogeneous), 2))
    for k in range(len(homogeneous)):
        # w is 0 at corners that no face uses only
        page[k, 0] = homogeneous[k, 0] / homogeneous[k, 2]
        page[k, 1] = homogeneous[k, 1] / homogeneous[k, 2]
    return page


def shadow_mask(lines: Linework, geometry: ViewGeometry) -> Mask:
    """Return the shadow (height, width) at the pixel centres of `geometry`."""
    if geometry.cylinder is not None:
        along = lines.end - lines.start
        long = np.linalg.norm(along, axis=1) / STRAIGHT_PX
        which, step = number_runs(np.maximum(np.ceil(long).astype(np.int64), 1))
        step, count = step[:, None], np.bincount(which)[which, None]
        start, end = (
            geometry.bend(lines.start[which] + s / count * along[which]) for s in (step, step + 1)
        )
        lines = Linework(start, end, lines.weight[which])
    return wound_mask([lines], geometry.width, geometry.height)


def shadow_polygon(lines: Linework, geometry: ViewGeometry | None = None) -> Any:
    """Give the shadow as a shapely (multi)polygon, in pixels; `geometry`: whose receiver may be curved.

    The linework is noded and polygonised; of the faces of that arrangement those with a nonzero
    winding number at an inner point are the shadow.
    """
    noded = shapely.unary_union(shapely.linestrings(np.stack([lines.start, lines.end], axis=1)))
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    inner = shapely.get_coordinates(shapely.point_on_surface(cells))
    flat = shapely.coverage_union_all(cells[winding_at(inner, lines) != 0])
    if geometry is None or geometry.cylinder is None:
        return flat
    return shapely.transform(shapely.segmentize(flat, STRAIGHT_PX), geometry.bend)
