"""The exact shadow of a mesh without graphics: silhouette edges, noded, kept by winding number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.sampling import number_runs
from knotfab_validators.shadows.view import ViewGeometry
from knotfab_validators.shadows.winding import Linework, winding_at, winding_raster

__all__ = ["ShadowError", "shadow_lines", "shadow_mask", "shadow_polygon"]


STRAIGHT_PX = 4.0  # a line so long is straight on a curved receiver too


class ShadowError(ValueError):
    """The mesh has no shadow that makes sense here, such as one that reaches the light."""


@dataclass(frozen=True)
class _Projected:
    points: Array  # (n, 2) pixels
    faces: Ints  # (m, 3), each turned to positive area in (u, v)


def _cut(homogeneous: Array, faces: Ints, limit: float) -> tuple[Array, Ints]:
    """The part of faces (m, 3) with w < `limit`, as triangles; new corners are appended.

    `homogeneous` (n, 3) holds (u w, v w, w), in which a straight edge stays straight.
    """
    corners, triangles = list(homogeneous), []
    made: dict[tuple[int, int], int] = {}
    for face in faces:
        kept: list[int] = []
        for a, b in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True):
            if homogeneous[a, 2] < limit:
                kept.append(a)
            if (homogeneous[a, 2] < limit) != (homogeneous[b, 2] < limit):
                key = (min(a, b), max(a, b))
                if key not in made:
                    p, q = homogeneous[key[0]], homogeneous[key[1]]
                    made[key] = len(corners)
                    corners.append(p + (limit - p[2]) / (q[2] - p[2]) * (q - p))
                kept.append(made[key])
        triangles += [(kept[0], kept[i], kept[i + 1]) for i in range(1, len(kept) - 1)]
    return np.array(corners), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _project(vertices: Array, faces: Ints, geometry: ViewGeometry) -> _Projected:
    matrix = geometry.projection
    h = vertices @ matrix[:, :3].T + matrix[:, 3]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if (h[used, 2] < 1e-6).any():
        raise ShadowError("the part reaches the light, or lies behind it: its shadow is unbounded")
    wall = geometry.cylinder
    if wall is not None and wall.is_beyond(vertices[used], geometry.normal).any():
        raise ShadowError("the part cuts the hollow wall, or lies behind it")
    limit = geometry.w_of_receiver  # matter on or behind the receiver plane casts no shadow
    inside = (h[:, 2] < limit)[faces]
    whole = inside.all(axis=1)
    crossing = inside.any(axis=1) & ~whole
    kept = faces if whole.all() else faces[whole]
    if crossing.any():
        h, pieces = _cut(h, faces[crossing], limit)
        kept = np.concatenate([kept, pieces])
    with np.errstate(divide="ignore", invalid="ignore"):  # corners that no face uses
        points = h[:, :2] / h[:, 2:]
    a, b, c = points[kept[:, 0]], points[kept[:, 1]], points[kept[:, 2]]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    turned = np.where((area < 0)[:, None], kept[:, ::-1], kept)
    return _Projected(points, turned[area != 0])


def shadow_lines(vertices: Array, faces: Ints, geometry: ViewGeometry) -> Linework:
    """The silhouette edges of a mesh as oriented linework, in pixels of the flat receiver of `geometry`.

    Every face is turned to positive area in the picture; an edge that two faces run through in
    opposite directions cancels. What is left (silhouette edges, and free edges of a mesh that is
    not closed) is the boundary of the sum of all projected faces, so its winding number at a point
    is the number of faces over it: the shadow is where it is not zero, for any set of triangles.

    Args:
        vertices: (n, 3), mm, in the coordinates of `geometry`.
        faces: (m, 3) indices.

    Raises:
        ShadowError: the part reaches the light or lies behind it.
    """
    flat = _project(vertices, np.asarray(faces, dtype=np.int64), geometry)
    a = flat.faces.ravel()
    b = np.roll(flat.faces, -1, axis=1).ravel()
    key = np.minimum(a, b) * len(flat.points) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    key, sign = key[order], np.where(a < b, 1, -1)[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    net = np.add.reduceat(sign, first) if len(first) else np.zeros(0, dtype=np.int64)
    edges, net = key[first[net != 0]], net[net != 0]
    start, end = flat.points[edges // len(flat.points)], flat.points[edges % len(flat.points)]
    return Linework(start, end, net.astype(np.int64))


def shadow_mask(lines: Linework, geometry: ViewGeometry) -> Mask:
    """The shadow (height, width) at the pixel centres of `geometry`."""
    if geometry.cylinder is not None:
        along = lines.end - lines.start
        long = np.linalg.norm(along, axis=1) / STRAIGHT_PX
        which, step = number_runs(np.maximum(np.ceil(long).astype(np.int64), 1))
        step, count = step[:, None], np.bincount(which)[which, None]
        start, end = (
            geometry.bend(lines.start[which] + s / count * along[which]) for s in (step, step + 1)
        )
        lines = Linework(start, end, lines.weight[which])
    mask: Mask = winding_raster(lines, geometry.width, geometry.height) != 0
    return mask


def shadow_polygon(lines: Linework, geometry: ViewGeometry | None = None) -> Any:
    """The shadow as a shapely polygon or multipolygon, in pixels; `geometry`: whose receiver may be curved.

    The linework is noded and polygonised; of the faces of that arrangement those with a nonzero
    winding number at an inner point are the shadow.
    """
    noded = shapely.unary_union(shapely.linestrings(np.stack([lines.start, lines.end], axis=1)))
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    inner = shapely.get_coordinates(shapely.point_on_surface(cells))
    flat = shapely.union_all(cells[winding_at(inner, lines) != 0])
    if geometry is None or geometry.cylinder is None:
        return flat
    return shapely.transform(shapely.segmentize(flat, STRAIGHT_PX), geometry.bend)
