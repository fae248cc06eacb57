"""Downward tips that begin in mid-air: where a printer would have to start on nothing."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.mesh import Mesh, connect
from knotfab_validators.printing.bridges import Stretches

__all__ = ["find_islands"]


UPWARD = 0.05  # z of a normal from which a face is the top of something
LEVEL_MM = 1e-6  # corners joined by an edge this level are one place


def find_islands(mesh: Mesh, air: Stretches, layer_mm: float) -> Array:
    """Find (n, 3) the tips in mid-air, lowest first: local minima of the surface, material above.

    The grid of columns sees a stretch that nothing holds, but it does not see a tip or a leg that
    is thinner than its cells. So from the column's face the way leads down along the surface, each
    time to the lowest neighbouring corner (of all corners, where they lie level). A stretch is an
    island if that ends above the first layer, in a place from which no face looks up.
    """
    start = np.unique(air.face[air.island])
    if not len(start):
        return np.empty((0, 3))
    z, faces = mesh.vertices[:, 2], mesh.faces
    place = _level_places(mesh)
    high = np.concatenate([faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)])
    low = np.concatenate([np.roll(faces, -1, axis=1).reshape(-1), faces.reshape(-1)])
    down = np.flatnonzero((z[low] < z[high]) & (place[low] != place[high]))
    down = down[np.argsort(-z[low[down]], kind="stable")]
    way = np.arange(len(z))
    way[place[high[down]]] = place[low[down]]  # the last one, the lowest, stays
    for _ in range(64):  # twice as far each time
        further = way[way]
        if np.array_equal(further, way):
            break
        way = further
    lowest_corner = faces[start][np.arange(len(start)), z[faces[start]].argmin(axis=1)]
    ends = np.unique(way[place[lowest_corner]])
    normals, _ = mesh.normals
    upward = np.full(len(z), -1.0)
    np.maximum.at(upward, place[faces].reshape(-1), np.repeat(normals[:, 2], 3))
    lowest = ends[(z[ends] > layer_mm) & (upward[ends] < UPWARD)]
    found: Array = mesh.vertices[lowest[np.argsort(z[lowest], kind="stable")]]
    return found


def _level_places(mesh: Mesh) -> Ints:
    """Return (n,) one vertex of those that a vertex is joined to by level edges."""
    n, z = len(mesh.vertices), mesh.vertices[:, 2]
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    level = np.abs(z[start] - z[end]) <= LEVEL_MM
    label, _ = connect(start[level], end[level], n)
    _, first = np.unique(label, return_index=True)
    place: Ints = first[label]
    return place
