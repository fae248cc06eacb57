"""Check that the tube lies in the scene's region, and the part in the printer's volume."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array
from knotfab_validators.check import at_most, skip_check, spot, worst_apart
from knotfab_validators.geometry.curves import (
    Curves,
    cut_edges,
    halve_sides,
    quarter_triangles,
    view_axes,
)
from knotfab_validators.geometry.mesh import (
    Mesh,
    collision_body,
    collision_distance,
    move_points,
    surface_distance,
    winding_numbers,
)

if TYPE_CHECKING:
    from knotfab_formats.bounds import Matrix
    from knotfab_formats.piece import Region

BED_TOLERANCE_MM = 1e-3
REGION_TOLERANCE_MM = 1e-6  # rounding between scene and part coordinates
SAMPLE_MM = 1.0  # largest spacing of the points measured on a part's faces
MOST_SAMPLES = 200_000
# share of the coordinates: nearer to the surface, single precision may mistake the side
SINGLE = 1e-4
MOST_EXACT = 5_000_000  # points times faces for which exact winding numbers are affordable


def measure_excess(points: Array, region: Region, radius_mm: float = 0.0) -> Array:
    """Measure how far balls around points (n, 3) stick out of a box, cylinder or sphere, mm (n,).

    The result is negative inside, and measured along the region's own axes: for a box the largest excess over
    its faces, for a cylinder (axis y) the larger of those over its mantle and its ends. The region's size
    must be known.
    """
    if region.size_mm is None or region.kind == "mesh":
        raise ValueError("the region's size is left open, or it is a mesh")
    axes = view_axes(region.azimuth_deg, region.elevation_deg)
    p = (points - np.array(region.center_mm)) @ axes.T
    half = np.array(region.size_mm) / 2
    if region.kind == "sphere":
        excess = np.linalg.norm(p, axis=1) - half[0]
    elif region.kind == "cylinder":
        around = np.hypot(p[:, 0], p[:, 2]) - half[0]
        excess = np.maximum(around, np.abs(p[:, 1]) - half[1])
    else:
        excess = (np.abs(p) - half).max(axis=1)
    result: Array = excess + radius_mm
    return result


def check_region(
    region: Region,
    pose: Matrix | None,
    curves: Curves | None,
    mesh: Mesh | None = None,
    surface: Mesh | None = None,
) -> Check:
    """Check `region`: the tubes around `curves`, or else the whole `mesh`, stay inside.

    Box, cylinder and sphere are convex, so that the vertices of centre line or mesh decide; for a
    region that is a mesh the least distance between centre line and surface does, and a part without
    a known tube is measured at points 1 mm apart.

    Args:
        pose: from the coordinates of curves and mesh to the scene's; None: they are the same.
        surface: surface of a region that is a mesh, yet to be moved by its `center_mm`.
    """
    if region.kind == "mesh" and surface is None:
        return skip_check("region", "the region's mesh is not given")
    if region.kind != "mesh" and region.size_mm is None:
        return skip_check("region", "the scene leaves the region's size open")
    tube = curves is not None and curves.radius_mm is not None
    if not tube and mesh is None:
        return skip_check("region", "neither the part nor the tube's radius is given")
    matrix = np.eye(4) if pose is None else np.array(pose, dtype=np.float64)
    if surface is not None:
        surface = Mesh(surface.vertices + np.array(region.center_mm), surface.faces)
    radius = 0.0
    if tube:
        assert curves is not None and curves.radius_mm is not None
        radius, what = curves.radius_mm, "the tube"
        points, excess = _tube(region, surface, curves, radius, matrix)
    else:
        assert mesh is not None
        what = "the part"
        points, excess = _part(region, surface, mesh, matrix)
    worst = worst_apart(excess, points, max(2 * radius, 1.0), REGION_TOLERANCE_MM)
    return at_most(
        "region",
        float(excess[worst[0]]),
        0.0,
        "mm",
        f"how far {what} sticks out of the {region.kind} (negative: inside), nearest to its "
        f"boundary at {spot(points[worst[0]])} of the scene",
        tolerance=REGION_TOLERANCE_MM,
        at=(points[worst] - matrix[:3, 3]) @ matrix[:3, :3],
    )


def _tube(
    region: Region, surface: Mesh | None, curves: Curves, radius: float, matrix: Array
) -> tuple[Array, Array]:
    """Return points of the centre lines in the scene, and how far the tube sticks out there."""
    if surface is None:
        points = move_points(np.concatenate(curves.polygons), matrix)
        return points, measure_excess(points, region, radius)
    start, end = (move_points(p, matrix) for p in (curves.edges.start, curves.edges.end))
    return measure_tube_excess(surface, start, end, radius)


def _part(region: Region, surface: Mesh | None, mesh: Mesh, matrix: Array) -> tuple[Array, Array]:
    """Return points of the part in the scene, and how far it sticks out there."""
    vertices = move_points(mesh.vertices, matrix)
    if surface is None:
        return vertices, measure_excess(vertices, region)
    return measure_part_excess(surface, Mesh(vertices, mesh.faces))


def check_build_volume(mesh: Mesh, build_volume_mm: tuple[float, float, float]) -> Check:
    """Check `build_volume`: the part lies in the bed's positive octant and inside the printer's volume."""
    vertices = mesh.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    excess = np.maximum(vertices - np.array(build_volume_mm), -vertices).max(axis=1)
    worst = worst_apart(excess, vertices, 1.0, BED_TOLERANCE_MM)
    size = " x ".join(f"{s:.2f}" for s in high - low)
    room = " x ".join(f"{s:g}" for s in build_volume_mm)
    axis = "xyz"[int(np.maximum(high - np.array(build_volume_mm), -low).argmax())]
    return at_most(
        "build_volume",
        float(excess[worst[0]]),
        0.0,
        "mm",
        f"how far the part of {size} mm sticks out of the printer's {room} mm, most along {axis}, "
        "where its corner lies at the origin",
        tolerance=BED_TOLERANCE_MM,
        at=vertices[worst],
    )


def measure_tube_excess(
    surface: Mesh, start: Array, end: Array, radius_mm: float
) -> tuple[Array, Array]:
    """Measure how far the tube around edges from `start` to `end` (k, 3) sticks out of a closed surface.

    The tube is inside exactly where its centre line is, and keeps a radius from the surface: FCL
    gives the least distance between all edges and all faces, 0 where they cross (a wall may poke
    in between two vertices). Where the line itself is outside, it is measured at points half a radius
    apart at most.

    Returns:
        Points (n, 3) of the centre line, and how far the tube sticks out there, mm; negative
        inside. The largest is exact where the whole centre line is inside.
    """
    total = float(np.linalg.norm(end - start, axis=1).sum())
    which, begin, _ = cut_edges(start, end, max(radius_mm / 2, total / MOST_SAMPLES))
    along = start[which] + begin[:, None] * (end - start)[which]
    points = np.concatenate([along, end])  # includes the ends of open curves
    excess = radius_mm - _depth(surface, points)
    gap, nearest = _least_distance(surface, start, end)
    return np.concatenate([points, nearest[None]]), np.append(excess, radius_mm - gap)


def measure_part_excess(surface: Mesh, part: Mesh) -> tuple[Array, Array]:
    """Measure how far a part sticks out, at its vertices and at points on its faces at most 1 mm apart.

    If these would be more than 200,000, they are spaced wider.
    """
    corner = part.vertices[part.faces]
    points = [part.vertices[np.unique(part.faces)]]
    step, left = SAMPLE_MM, MOST_SAMPLES
    while len(corner) and left > 0:
        longest = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2).max(axis=1)
        corner = corner[longest > step][: max(left // 12, 1)]
        corner = quarter_triangles(corner, halve_sides(corner))
        points.append(corner.reshape(-1, 3))
        left -= len(points[-1])
    chosen = np.concatenate(points)
    return chosen, -_depth(surface, chosen)


def _depth(surface: Mesh, points: Array) -> Array:
    """Return the distance (n,) to the surface, positive inside (where the winding number is above 1/2).

    libigl's own signed distances are avoided: they are distances times 1 - 2 w, with a fast winding
    number w whose error is a thousandth. Near the surface w is computed exactly.
    """
    distance = surface_distance(points, surface)
    winding = winding_numbers(points, surface, exact=False)
    unsure = distance < SINGLE * np.abs(surface.vertices).max()
    unsure |= np.abs(winding - np.rint(winding)) > 0.2
    some = np.flatnonzero(unsure)[: max(MOST_EXACT // len(surface.faces), 1)]
    winding[some] = winding_numbers(points[some], surface)
    return np.where(winding > 0.5, distance, -distance)


def _least_distance(surface: Mesh, start: Array, end: Array) -> tuple[float, Array]:
    """Return the least distance between edges and faces, and the place (3,) on the edges."""
    number = np.arange(len(start))
    corners = np.stack([number, number + len(start), number + len(start)], axis=1)
    edges = Mesh(np.concatenate([start, end]), corners)
    gap, nearest = collision_distance(collision_body(edges), collision_body(surface))
    return gap, nearest[0]
