"""Measure how far tubes and parts stick out of a closed mesh, the allowed region."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.collision import collision_body, collision_distance
from knotfab_validators.geometry.inside import surface_distance, winding_numbers
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.sampling import cut_edges, quarter_triangles

__all__ = ["measure_part_excess", "measure_tube_excess"]


SAMPLE_MM = 1.0  # sides of a part's faces between whose corners and middles it is not measured
MOST_SAMPLES = 200_000
# a share of the coordinates: nearer to the surface single precision may mistake its side
SINGLE = 1e-4
MOST_EXACT = 5_000_000  # points times faces of exact winding numbers


def measure_tube_excess(
    surface: Mesh, start: Array, end: Array, radius_mm: float
) -> tuple[Array, Array]:
    """Measure how far the tube about the edges from `start` to `end` (k, 3) sticks out of a closed surface.

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
    points = np.concatenate([along, end])  # the ends of open curves too
    excess = radius_mm - _depth(surface, points)
    gap, nearest = _least_distance(surface, start, end)
    return np.concatenate([points, nearest[None]]), np.append(excess, radius_mm - gap)


def measure_part_excess(surface: Mesh, part: Mesh) -> tuple[Array, Array]:
    """Measure how far a part sticks out: at its vertices, and at points 1 mm apart at most on its faces.

    On parts so large that these would be more than 200,000, at points farther apart.
    """
    corner = part.vertices[part.faces]
    points = [part.vertices[np.unique(part.faces)]]
    step, left = SAMPLE_MM, MOST_SAMPLES
    while len(corner) and left > 0:
        longest = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2).max(axis=1)
        corner = quarter_triangles(corner[longest > step][: max(left // 12, 1)])
        points.append(corner.reshape(-1, 3))
        left -= len(points[-1])
    chosen = np.concatenate(points)
    return chosen, -_depth(surface, chosen)


def _depth(surface: Mesh, points: Array) -> Array:
    """(n,) distance to the surface, positive inside (where the winding number is above 1/2).

    libigl's own signed distances are not asked: they are distances times 1 - 2 w, and its fast
    winding number w has an error of a thousandth. Near the surface w is summed up exactly.
    """
    distance = surface_distance(points, surface)
    winding = winding_numbers(points, surface, exact=False)
    unsure = distance < SINGLE * np.abs(surface.vertices).max()
    unsure |= np.abs(winding - np.rint(winding)) > 0.2
    some = np.flatnonzero(unsure)[: max(MOST_EXACT // len(surface.faces), 1)]
    winding[some] = winding_numbers(points[some], surface)
    return np.where(winding > 0.5, distance, -distance)


def _least_distance(surface: Mesh, start: Array, end: Array) -> tuple[float, Array]:
    """Least distance between edges and faces, and its place (3,) on the edges, which are thin triangles."""
    number = np.arange(len(start))
    corners = np.stack([number, number + len(start), number + len(start)], axis=1)
    edges = Mesh(np.concatenate([start, end]), corners)
    gap, nearest = collision_distance(collision_body(edges), collision_body(surface))
    return gap, nearest[0]
