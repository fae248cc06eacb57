"""Measure whether a mesh fills a convex solid with matter, except for its intended openings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.mesh import Mesh, winding_numbers
from knotfab_validators.tube.tube_fit import LIMIT

FACET_MM = 0.025  # how far inside a round face its facets may lie
SIDES = 32  # sides of the prism that represents a round hole


@dataclass(frozen=True)
class HalfSpaces:
    """The points p of a convex region, `normals @ p >= offsets`; normals (k, 3) have length 1."""

    normals: Array
    offsets: Array

    def depth(self, points: Array) -> Array:
        """Return how deep points (n, 3) lie inside, mm, (n,); negative outside."""
        return np.asarray((points @ self.normals.T - self.offsets).min(axis=1))

    def way_out(self, point: Array, along: Array) -> float:
        """Return the distance from a point (3,) inside along a unit vector (3,) to the surface, mm."""
        rate = self.normals @ along
        left = np.maximum(self.normals @ point - self.offsets, 0.0)
        leaves = rate < -1e-9
        # ignore a plane through the point that is nearly parallel to the direction
        return float((left[leaves] / -rate[leaves]).min()) if leaves.any() else 0.0


@dataclass(frozen=True)
class Solid:
    """What a part must fill: the hull of `corners` (n, 3), mm, less `openings`, which are hulls too."""

    name: str
    corners: Array
    openings: tuple[HalfSpaces, ...] = field(default=())

    @property
    def hull(self) -> HalfSpaces:
        return hull_of(self.corners)

    @property
    def middle(self) -> Array:
        """A point (3,) well inside, and in no opening."""
        centre = (self.corners.min(axis=0) + self.corners.max(axis=0)) / 2
        tried = np.concatenate([centre + t * (self.corners - centre) for t in (0.0, 0.5, 0.8)])
        deep = np.min([self.hull.depth(tried), *(-o.depth(tried) for o in self.openings)], axis=0)
        return np.asarray(tried[int(deep.argmax())])

    @property
    def allowed_mm(self) -> float:
        """The depth at which a face may lie, set by its thickness as a tube's is by its radius."""
        widths = np.ptp(self.corners @ self.hull.normals.T, axis=0)
        return LIMIT * float(widths.min()) / 2 + FACET_MM


def hull_of(corners: Array) -> HalfSpaces:
    """Build the convex hull of points (n, 3).

    Raises:
        ValueError: they lie in one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        planes = ConvexHull(corners).equations
    except QhullError as error:
        raise ValueError("its corners enclose nothing") from error
    _, first = np.unique(np.round(planes, 9), axis=0, return_index=True)
    planes = planes[first]
    return HalfSpaces(-planes[:, :3], planes[:, 3])


def find_hollow(mesh: Mesh, solid: Solid) -> tuple[float, Array] | None:
    """Find the deepest face in a solid below `allowed_mm`: its depth, mm, and its place (3,).

    If no face lies in the solid and its `middle` is not in matter, all of it is missing: the depth is
    infinite.
    """
    hull, allowed = solid.hull, solid.allowed_mm
    corners = mesh.vertices[mesh.faces]
    for normal, offset in zip(hull.normals, hull.offsets, strict=True):
        corners = corners[(corners @ normal > offset + allowed).any(axis=1)]
    worst, at = 0.0, solid.middle
    for triangle in corners:
        piece = clip_all(triangle, hull, allowed)
        if not len(piece) or any(o.depth(piece).min() >= -allowed for o in solid.openings):
            continue
        piece = np.concatenate(
            [piece, piece.mean(axis=0)[None]]
        )  # all corners may lie at the limit
        depth = hull.depth(piece)
        if depth.max() > worst:
            worst, at = float(depth.max()), piece[int(depth.argmax())]
    if worst > allowed:
        return worst, at
    if winding_numbers(solid.middle[None], mesh)[0] < 0.5:
        return np.inf, solid.middle
    return None


def clip_all(polygon: Array, hull: HalfSpaces, inset: float = 0.0) -> Array:
    """Clip a polygon (n, 3) to the inside of a hull, `inset` away from its faces; (0, 3) if nothing is
    left.
    """
    high = polygon @ hull.normals.T - hull.offsets - inset
    for k in np.flatnonzero((high < 0).any(axis=0)):
        polygon = clip(polygon, hull.normals[k], hull.offsets[k] + inset)
        if len(polygon) < 3:
            return np.empty((0, 3))
    return polygon


def clip(polygon: Array, normal: Array, offset: float) -> Array:
    """Clip a polygon (n, 3) to the half space `normal @ p >= offset`."""
    high = polygon @ normal - offset
    found = []
    for k, here in enumerate(polygon):
        after = (k + 1) % len(polygon)
        if high[k] >= 0:
            found.append(here)
        if (high[k] >= 0) != (high[after] >= 0):
            found.append(here + high[k] / (high[k] - high[after]) * (polygon[after] - here))
    return np.array(found).reshape(-1, 3)


def prism(outline: Array, low: float, high: float, motion: Array) -> Array:
    """Return the corners of a prism over an outline (n, 2), from z = low to high, moved by (3, 4)."""
    ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in (low, high)]
    return np.asarray(np.concatenate(ends) @ motion[:, :3].T + motion[:, 3])


def round_outline(at: Sequence[float], radius: float) -> Array:
    """Return a polygon (n, 2) around a circle."""
    t = 2 * np.pi * np.arange(SIDES) / SIDES
    return np.asarray(np.array(at) + radius / np.cos(np.pi / SIDES) * np.c_[np.cos(t), np.sin(t)])
