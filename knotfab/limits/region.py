"""Region limit: the tube's surface stays inside a box, cylinder, sphere or mesh, in front of walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.base.disk import read_file
from knotfab.base.limited import run_limited
from knotfab.geometry.polylines import Polylines, row_lengths
from knotfab.geometry.tube import unit
from knotfab.limits.terms import Felt, Limit, Limits, State
from knotfab.scene.camera import Plane, view_axes
from knotfab_formats.errors import InputError
from knotfab_formats.scene import SettledRegion


def region_excess(
    points: Array, region: SettledRegion, radius: float, walls: Sequence[Plane] = ()
) -> tuple[Array, Array]:
    """Return how far a ball about each point sticks out of the region, mm (N,), and its gradient (N, 3).

    `walls` are planes (nx, ny, nz, d), before which n · p + d > 0.
    """
    excess, away = _outside_region(points, region, radius)
    for *normal, offset in walls:
        across = np.array(normal, dtype=points.dtype)
        beyond_wall = radius - (points @ across + offset)
        further = beyond_wall > excess
        excess = np.where(further, beyond_wall, excess)
        away = np.where(further[:, None], -across, away)
    return excess, away


def _outside_region(points: Array, region: SettledRegion, radius: float) -> tuple[Array, Array]:
    """Do what `outside` does, without walls and in the precision of the points.

    For a box the largest excess over its faces counts, for a cylinder (its own axis y) that over
    mantle and ends.
    """
    if region.kind == "mesh":
        assert region.file is not None
        excess, away = mesh_excess(points, region_mesh(region.file, region.center_mm))
        return excess + radius, away
    half = np.array([0.5 * side for side in region.size_mm], dtype=points.dtype)
    p, axes = points - np.array(region.center_mm, dtype=points.dtype), None
    if region.azimuth_deg or region.elevation_deg:
        axes = view_axes(region).astype(points.dtype)
        p = p @ axes.T
    slope = np.zeros_like(p)
    rows = np.arange(len(p))
    if region.kind == "box":
        over = np.abs(p) - half
        face = over.argmax(axis=1)
        excess = over[rows, face] + radius
        slope[rows, face] = np.sign(p[rows, face])
    elif region.kind == "sphere":
        length = np.sqrt((p * p).sum(axis=1))
        excess = length - half[0] + radius
        slope = p / np.where(length > 0, length, 1)[:, None]
    else:
        around = np.sqrt(np.maximum(p[:, 0] ** 2 + p[:, 2] ** 2, 1e-12))
        mantle, ends = around - half[0], np.abs(p[:, 1]) - half[1]
        out = mantle >= ends
        excess = np.where(out, mantle, ends) + radius
        slope[:, 0::2] = np.where(out, 1 / around, 0)[:, None] * p[:, 0::2]
        slope[:, 1] = np.where(out, 0, np.sign(p[:, 1]))
    return excess, slope if axes is None else slope @ axes


def tube_outside(points: Array, ahead: Array, limits: Limits) -> tuple[Array, Array]:
    """Return points (k, 3) of a centre line, and bounds of how far the tube sticks out there, mm (k,).

    For convex regions the vertices `points` (n, 3) decide. In a mesh, a wall may poke into the tube between
    them, so the middles of the edges to `ahead` (n, 3) are measured too. A wall point at distance d
    from an edge of length e is at most sqrt(d² + (e/4)²) from one of these: the radius is enlarged
    so, by 0.6 % at edges of 0.45 radii.
    """
    if limits.region.kind != "mesh":
        return points, _excess_within(points, limits, limits.radius)[0]
    longest = float(row_lengths(ahead - points).max())
    some = np.concatenate([points, (points + ahead) / 2])
    return some, _excess_within(some, limits, hypot(limits.radius, longest / 4))[0]


def _excess_within(points: Array, limits: Limits, radius: float) -> tuple[Array, Array]:
    return region_excess(points, limits.region, radius, limits.walls)


def region_term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge of the excess outside, in squared tube radii (paper, occupancy loss)."""
    excess, away = _excess_within(state.points, limits, _felt_radius(limits, state.spacing))
    hinge = np.maximum(excess / limits.radius, 0.0)
    scale = state.spacing / limits.radius
    slope = (2.0 * scale / limits.radius * hinge)[:, None] * away
    return scale * float(hinge @ hinge), slope


def slack(points: Array, rings: Polylines, limits: Limits) -> float:
    """Return how far every vertex may move before the region is felt, mm.

    A vertex approaches a boundary by no more than it moves. In a mesh the radius grows with the mean
    edge e as sqrt(r² + (e/2)²), which is at most half as fast as e, and e grows at most twice as
    fast as vertices move: together they come nearer twice as fast.
    """
    spacing = float(row_lengths(points[rings.next] - points).mean())
    radius = _felt_radius(limits, spacing)
    room = -float(_excess_within(points, limits, radius)[0].max())
    return room / 2 if limits.region.kind == "mesh" else room


def _felt_radius(limits: Limits, spacing: float) -> float:
    """Return the tube's radius with a margin: a mesh wall may poke in between two vertices."""
    radius = limits.radius * 1.02
    return hypot(radius, spacing / 2) if limits.region.kind == "mesh" else radius


REGION = Limit("region", region_term, slack)


# A closed mesh as the allowed region: signed distances with a gradient.

_REMEDY = "Export it again as a closed solid (STL, millimetres), with its faces turned outwards."
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
_MOST_BYTES = 2**30
_ON_RIM = 1e-9  # barycentric coordinates below this are zero: the point lies on the opposite edge


@dataclass(frozen=True)
class RegionMesh:
    """A closed surface in scene coordinates, prepared for fast signed distances.

    `face_normals` (m, 3), `edge_normals` (m, 3, 3: of the side across from each corner) and
    `corner_normals` (n, 3) are the pseudonormals of Bærentzen and Aanæs ("Signed distance
    computation using the angle weighted pseudonormal", IEEE TVCG 11(3), 2005): a point is outside
    where it lies on the positive side of that of the feature it is nearest to.
    """

    vertices: Array  # (n, 3) mm
    faces: Indices  # (m, 3)
    face_normals: Array
    edge_normals: Array
    corner_normals: Array
    tree: Any  # igl.AABB

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest coordinates (3,)."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        """Return the nearest surface points (k, 3), and 1 outside or -1 inside, (k,)."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        _, face, foot = self.tree.squared_distance(self.vertices, self.faces, p)
        share = _barycentric(self.vertices[self.faces[face]], foot)
        corner, few = share.argmax(axis=1), np.asarray(share < _ON_RIM)
        row, side = np.arange(len(p)), share.argmin(axis=1)
        normal = np.where(
            np.any(few, axis=1)[:, None], self.edge_normals[face, side], self.face_normals[face]
        )
        at_corner = few.sum(axis=1) == 2
        normal = np.where(
            at_corner[:, None], self.corner_normals[self.faces[face][row, corner]], normal
        )
        outwards = np.einsum("ij,ij->i", p - foot, normal)
        return np.asarray(foot), np.where(outwards > 0, 1.0, -1.0)


def mesh_excess(points: Array, mesh: RegionMesh) -> tuple[Array, Array]:
    """Return how far points (N, 3) lie outside the surface, mm (N,), and its gradient (N, 3)."""
    foot, sign = (found.astype(points.dtype) for found in mesh.nearest(points))
    gap = points - foot
    distance = np.sqrt(np.maximum((gap * gap).sum(axis=1), 1e-18))
    return sign * distance, (sign / distance)[:, None] * gap


@lru_cache(maxsize=2)
def region_mesh(file: str, center_mm: tuple[float, float, float]) -> RegionMesh:
    """Read a region's STL and move it by `center_mm`.

    Raises:
        InputError: it cannot be read, is not closed, or is inside out.
    """
    import igl

    what = f"the region's mesh {Path(file).name}"
    corners = run_limited(lambda: _read_corners(Path(file), what), what, seconds=60, remedy=_REMEDY)
    vertices, number = np.unique(corners, axis=0, return_inverse=True)
    faces = number.reshape(-1, 3).astype(np.int64)
    _require_closed(vertices, faces, what)
    vertices = np.ascontiguousarray(vertices + np.array(center_mm))
    tree = igl.AABB()
    tree.init(vertices, faces)
    normals = unit(np.cross(*np.moveaxis(np.diff(vertices[faces], axis=1), 1, 0)))
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key, back = start * len(vertices) + end, end * len(vertices) + start
    order = np.argsort(key)
    twin = order[np.searchsorted(key, back, sorter=order)] // 3
    across = np.roll((normals.repeat(3, axis=0) + normals[twin]).reshape(-1, 3, 3), -1, axis=1)
    corners = np.zeros_like(vertices)
    angle = _corner_angles(vertices[faces])
    for i in range(3):
        np.add.at(corners, faces[:, i], angle[:, i, None] * normals)
    return RegionMesh(vertices, faces, normals, across, corners, tree)


def _read_corners(path: Path, what: str) -> Array:
    """Read the corners of an STL file's triangles, binary or ASCII, (3m, 3)."""
    content = read_file(path, what, "closed STL", _MOST_BYTES, missing="Check [region] file.")
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= 84 and len(content) == 84 + 50 * count:
        corners = np.frombuffer(content, _FACET, count, 84)["corners"].reshape(-1, 3)
    else:
        words = content.lower().split()
        at = [i for i, word in enumerate(words) if word == b"vertex"]
        try:
            corners = np.array([[float(w) for w in words[i + 1 : i + 4]] for i in at])
        except ValueError as error:
            raise InputError(what, "a corner is not three numbers", _REMEDY) from error
    if corners.ndim != 2 or not len(corners) or len(corners) % 3 or corners.shape[1:] != (3,):
        raise InputError(what, "it is no STL file, or has no triangles", _REMEDY)
    if not np.isfinite(corners).all():
        raise InputError(what, "it has a corner that is not finite", _REMEDY)
    return np.asarray(corners, dtype=np.float64) + 0.0


def _require_closed(vertices: Array, faces: Indices, what: str) -> None:
    """Refuse a surface whose half-edges are not all paired, or whose volume is not positive."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    forth = np.sort(start * np.int64(len(vertices)) + end)
    back = np.sort(end * np.int64(len(vertices)) + start)
    if not np.array_equal(forth, back) or (np.diff(forth) == 0).any() or (start == end).any():
        raise InputError(what, "it is not a closed surface", _REMEDY)
    corner = vertices[faces] - vertices.mean(axis=0)
    if not np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) > 0:
        raise InputError(what, "it is turned inside out", _REMEDY)


def _barycentric(corner: Array, point: Array) -> Array:
    """Return barycentric coordinates (k, 3) of points (k, 3) in their triangles."""
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    square = np.maximum(np.einsum("ij,ij->i", area, area), 1e-300)
    to = corner - point[:, None]
    parts = [np.cross(to[:, (i + 1) % 3], to[:, (i + 2) % 3]) for i in range(3)]
    return np.stack([np.einsum("ij,ij->i", p, area) / square for p in parts], axis=1)


def _corner_angles(corner: Array) -> Array:
    """Return the corner angles of triangles (m, 3, 3), (m, 3)."""
    ahead = unit(np.roll(corner, -1, axis=1) - corner)
    behind = unit(np.roll(corner, 1, axis=1) - corner)
    return np.asarray(np.arccos(np.clip(np.einsum("mij,mij->mi", ahead, behind), -1.0, 1.0)))
