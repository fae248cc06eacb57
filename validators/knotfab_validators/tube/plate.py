"""Check that matter fills the plate in which a piece stands, all through and all over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import at_most, places, spot
from knotfab_validators.geometry.mesh import Mesh, winding_numbers

if TYPE_CHECKING:
    from knotfab_validators.geometry.curves import Slab

NAME = "mount"
PROUD_MM = 0.035  # how far a corner may stand out of the plate
LIMIT_MM = 0.06  # how far inside the plate's surface a face may lie
SPACING_MM = 8.0  # between places where matter is looked for
FOOT = 0.8  # radii above a plate's face: a centre line that is lower has its foot in the plate
SPLIT = 3  # sample points along each side of a face's part in the plate


def check_plate(mesh: Mesh, plate: Slab, reach: Array) -> Check:
    """Check `mount` of a piece in a plate: no face lies inside the plate, and matter is all over it.

    `reach` (n, 3) are points over which it must extend: the frame's corners, and the piece's feet.

    The union of the plate with feet that stand in it has no inner faces. A void, a slit between a
    foot and the plate, an unlisted hole or a thinner plate has some.
    """
    turn = _axes(plate.out)
    flat = plate.outline @ turn.T
    solid = _shape(plate, turn)
    sheet = shapely.Polygon(flat[:, :2]).buffer(PROUD_MM)
    beside = ~shapely.contains_xy(sheet, (reach @ turn.T)[:, 0], (reach @ turn.T)[:, 1])
    if beside.any():
        detail = (
            f"the plate does not extend to the frame or under a foot, at {spot(reach[beside][0])}"
        )
        return Check(NAME, "fail", True, "misfit", None, "", detail, places(reach[beside]))
    local = mesh.vertices @ turn.T - (0.0, 0.0, float(flat[0, 2]))
    low, high = LIMIT_MM - plate.thickness_mm, -LIMIT_MM
    worst, at = 0.0, plate.outline[0]
    height = local[:, 2][mesh.faces]
    near = (height.min(axis=1) < high) & (height.max(axis=1) > low)
    points = _sample(local[mesh.faces[near]], low, high)
    if len(points):
        inside = shapely.contains_xy(solid, points[:, 0], points[:, 1])
        points = points[inside]
        sides = shapely.distance(solid.boundary, shapely.points(points[:, :2]))
        deep = np.minimum(sides, np.minimum(-points[:, 2], points[:, 2] + plate.thickness_mm))
        if len(deep):
            k = int(deep.argmax())
            worst = float(deep[k])
            at = (points[k] + (0.0, 0.0, float(flat[0, 2]))) @ turn
    detail = "how deep a face lies at most in the plate that the piece stands in"
    if worst > LIMIT_MM:
        detail += f", which has a hole, void or slit at {spot(at)}"
        return at_most(NAME, worst, LIMIT_MM, "mm", detail, at=[at])
    empty = _find_empty(mesh, solid, plate, turn, float(flat[0, 2]))
    if len(empty):
        detail = f"there is no matter in the plate, such as at {spot(empty[0])}"
        return Check(NAME, "fail", True, "missing", None, "", detail, places(empty))
    return at_most(NAME, worst, LIMIT_MM, "mm", detail)


def inside_plate(points: Array, plate: Slab) -> Mask:
    """Tell which points (n, 3) lie in the plate or on its surface."""
    turn = _axes(plate.out)
    local = points @ turn.T
    height = local[:, 2] - float(plate.outline[0] @ plate.out)
    solid = shapely.Polygon((plate.outline @ turn.T)[:, :2]).buffer(PROUD_MM)
    within = (height < PROUD_MM) & (height > -plate.thickness_mm - PROUD_MM)
    within &= shapely.contains_xy(solid, local[:, 0], local[:, 1])
    return np.asarray(within)


def list_feet(polygons: Sequence[Array], plate: Slab, radius: float) -> Array:
    """List the points (n, 3) of centre lines that lie so near to a plate's face that it must be there."""
    points = np.concatenate(polygons)
    return np.asarray(points[(points - plate.outline[0]) @ plate.out < FOOT * radius])


def _axes(out: Array) -> Array:
    """Return two directions along a plate, and its normal, as rows (3, 3)."""
    side = np.cross(np.eye(3)[int(np.abs(out).argmin())], out)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(out, side), out])


def _shape(plate: Slab, turn: Array) -> shapely.Geometry:
    holes = (plate.holes @ turn.T)[:, :2]
    solid = shapely.Polygon((plate.outline @ turn.T)[:, :2])
    for hole in holes:
        solid = solid.difference(shapely.Point(hole).buffer(plate.hole_mm / 2, quad_segs=64))
    return solid


def _sample(corners: Array, low: float, high: float) -> Array:
    """Sample points (n, 3) all over the parts of triangles (m, 3, 3) between two heights."""
    weights = np.array(
        [(i, j, SPLIT - i - j) for i in range(SPLIT + 1) for j in range(SPLIT + 1 - i)]
    )
    found = []
    for triangle in corners:
        part = _cut(_cut(triangle, 1.0, low), -1.0, -high)
        for k in range(1, len(part) - 1):
            found.append(weights / SPLIT @ part[[0, k, k + 1]])
    return np.concatenate(found) if found else np.empty((0, 3))


def _cut(polygon: Array, way: float, least: float) -> Array:
    """Clip a convex polygon to where `way` times the height is at least `least`, (k, 3)."""
    side = way * polygon[:, 2] - least if len(polygon) else np.empty(0)
    kept = []
    for k in range(len(polygon)):
        after = (k + 1) % len(polygon)
        if side[k] >= 0:
            kept.append(polygon[k])
        if (side[k] >= 0) != (side[after] >= 0):
            share = side[k] / (side[k] - side[after])
            kept.append(polygon[k] + share * (polygon[after] - polygon[k]))
    return np.array(kept).reshape(-1, 3)


def _find_empty(
    mesh: Mesh, solid: shapely.Geometry, plate: Slab, turn: Array, face: float
) -> Array:
    """Find places (k, 3) halfway through the plate that are not in matter."""
    inner = solid.buffer(-LIMIT_MM)
    x0, y0, x1, y1 = inner.bounds
    x, y = np.meshgrid(np.arange(x0, x1, SPACING_MM), np.arange(y0, y1, SPACING_MM))
    flat = np.column_stack([x.ravel(), y.ravel()])
    flat = flat[shapely.contains_xy(inner, flat[:, 0], flat[:, 1])]
    middle = np.full(len(flat), face - plate.thickness_mm / 2)
    points = np.column_stack([flat, middle]) @ turn
    return np.asarray(points[winding_numbers(points, mesh) < 0.5])
