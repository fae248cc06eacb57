"""A closed mesh as the allowed region: read it, and measure how far tubes and parts stick out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .read_mesh import BadFile, Mesh, read_mesh
from .sampling import quarters
from .surface import survey

__all__ = ["part_beyond", "read_region_mesh", "tube_beyond"]

Array = NDArray[np.float64]

SAMPLE_MM = 1.0  # sides of a part's faces between whose corners and middles it is not measured
MOST_SAMPLES = 200_000
SINGLE = 1e-4  # of the coordinates: nearer to the surface, single precision may mistake its side
MOST_EXACT = 5_000_000  # points times faces of exact winding numbers


def read_region_mesh(path: Path, where: str) -> Mesh:
    """The closed mesh of an STL file, in mm.

    Args:
        where: how an error names the key of the scene.

    Raises:
        BadFile: it cannot be read, has a hole or faces wound against each other, or is inside out.
    """
    try:
        mesh = read_mesh(path)
    except BadFile as error:
        raise BadFile(f"{where}: {error}") from error
    found = survey(mesh)
    if not found.closed:
        edges = len(found.open_edges) + len(found.flipped_edges)
        raise BadFile(f"{where}: {path.name} is not a closed surface ({edges} edges are not right)")
    if not found.volumes_mm3.sum() > 0:
        raise BadFile(f"{where}: {path.name} encloses nothing, or is turned inside out")
    return mesh


def tube_beyond(surface: Mesh, start: Array, end: Array, radius_mm: float) -> tuple[Array, Array]:
    """How far the tube about the edges from `start` to `end` (k, 3) sticks out of a closed surface.

    The tube is inside exactly where its centre line is, and keeps a radius from the surface: FCL
    gives the least distance between all edges and all faces, 0 where they cross (a wall may poke
    in between two vertices). Where the line itself is outside, it is measured at points half a radius
    apart at most.

    Returns:
        Points (n, 3) of the centre line, and how far the tube sticks out there, mm; negative
        inside. The largest is exact where the whole centre line is inside.
    """
    points = _along(start, end, radius_mm / 2)
    excess = radius_mm - _depth(surface, points)
    gap, nearest = _least_distance(surface, start, end)
    return np.concatenate([points, nearest[None]]), np.append(excess, radius_mm - gap)


def part_beyond(surface: Mesh, part: Mesh) -> tuple[Array, Array]:
    """How far a part sticks out: at its vertices, and at points 1 mm apart at most on its faces.

    On parts so large that these would be more than 200,000, at points farther apart.
    """
    corner = part.vertices[part.faces]
    points = [part.vertices[np.unique(part.faces)]]
    step, left = SAMPLE_MM, MOST_SAMPLES
    while len(corner) and left > 0:
        longest = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2).max(axis=1)
        corner = quarters(corner[longest > step][: max(left // 12, 1)])
        points.append(corner.reshape(-1, 3))
        left -= len(points[-1])
    chosen = np.concatenate(points)
    return chosen, -_depth(surface, chosen)


def _depth(surface: Mesh, points: Array) -> Array:
    """(n,) distance to the surface, positive inside (where the winding number is above 1/2).

    libigl's own signed distances are not asked: they are distances times 1 - 2 w, and its fast
    winding number w has an error of a thousandth. Near the surface w is summed up exactly.
    """
    from igl import fast_winding_number, point_mesh_squared_distance, winding_number

    p, v, f = (np.ascontiguousarray(a) for a in (points, surface.vertices, surface.faces))
    distance = np.sqrt(np.asarray(point_mesh_squared_distance(p, v, f)[0], dtype=np.float64))
    winding = np.asarray(fast_winding_number(v, f, p), dtype=np.float64)
    unsure = (distance < SINGLE * np.abs(v).max()) | (np.abs(winding - np.rint(winding)) > 0.2)
    some = np.flatnonzero(unsure)[: max(MOST_EXACT // len(f), 1)]
    if len(some):
        winding[some] = winding_number(v, f, p[some])
    return np.where(winding > 0.5, distance, -distance)


def _along(start: Array, end: Array, step: float) -> Array:
    """Points (n, 3) on the edges, their ends among them, `step` apart at most."""
    edge = end - start
    length = np.linalg.norm(edge, axis=1)
    step = max(step, float(length.sum()) / MOST_SAMPLES)
    pieces = np.maximum(np.ceil(length / step), 1).astype(np.int64) + 1
    which = np.repeat(np.arange(len(start)), pieces)
    number = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    part = number / (pieces[which] - 1)
    return np.asarray(start[which] * (1 - part)[:, None] + end[which] * part[:, None])


def _least_distance(surface: Mesh, start: Array, end: Array) -> tuple[float, Array]:
    """Between edges and faces, and the place (3,) on the edges; edges are triangles without width."""
    import fcl

    number = np.arange(len(start))
    corners = np.stack([number, number + len(start), number + len(start)], axis=1)
    bodies = []
    for vertices, faces in (
        (np.concatenate([start, end]), corners),
        (surface.vertices, surface.faces),
    ):
        body = fcl.BVHModel()
        body.beginModel(len(vertices), len(faces))
        body.addSubModel(vertices, faces)
        body.endModel()
        bodies.append(fcl.CollisionObject(body))
    result = fcl.DistanceResult()
    request = fcl.DistanceRequest(enable_nearest_points=True)
    gap = fcl.distance(bodies[0], bodies[1], request, result)
    return max(float(gap), 0.0), np.asarray(result.nearest_points[0], dtype=np.float64)
