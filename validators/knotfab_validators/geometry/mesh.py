"""A part's surface as an indexed triangle mesh, and what follows from its corners and faces at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.compiled import compiled

__all__ = [
    "Corners",
    "Mesh",
    "bound_triangles",
    "connect",
    "corner_faces",
    "enclosed_volume",
    "merge_equal",
    "move_points",
    "number_bodies",
]

Corners = NDArray[np.floating[Any]]
"""(m, 3, 3) the corners of triangles, each with coordinates of its own, as a file gives them."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in mm: `vertices` (n, 3) finite, `faces` (m, 3) indices, m >= 1.

    Corners at exactly equal coordinates are one vertex; nothing else is repaired: faces with a
    repeated corner, and equal faces, stay.
    """

    vertices: Array
    faces: Ints

    @property
    def usable(self) -> bool:
        """True if there are faces, and all coordinates are finite."""
        return bool(len(self.faces) and np.isfinite(self.vertices).all())

    @cached_property
    def normals(self) -> tuple[Array, Array]:
        """Unit normals (m, 3), zero where a face has no area, and areas (m,), mm²."""
        corner = self.vertices[self.faces]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        length = np.sqrt(np.einsum("ij,ij->i", normal, normal))
        return normal / np.where(length > 0, length, 1.0)[:, None], length / 2


def merge_equal(corners: Corners) -> Mesh:
    """Index triangles (m, 3, 3) by their exactly equal corners (0.0 and -0.0 are equal).

    Vertices are in the order in which the triangles name them first: neighbours lie beside each other.
    """
    flat = (corners.reshape(-1, 3) + corners.dtype.type(0.0)).astype(np.float64)
    first, index = _number_equal(flat.view(np.uint64))
    return Mesh(flat[first], index.reshape(-1, 3))


@compiled
def _number_equal(rows: NDArray[np.uint64]) -> tuple[Ints, Ints]:
    """Find by a hash table where each different row of (n, 3) comes first, and the rows' numbers."""
    size = 4
    while size < 2 * len(rows):
        size *= 2
    table = np.full(size, -1, dtype=np.int64)
    first, index = np.empty(len(rows), dtype=np.int64), np.empty(len(rows), dtype=np.int64)
    count = 0
    for k in range(len(rows)):
        hashed = np.uint64(0)
        for axis in range(3):  # the finalizer of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)
            hashed = (hashed ^ rows[k, axis]) + np.uint64(0x9E3779B97F4A7C15)
            hashed = (hashed ^ (hashed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            hashed = (hashed ^ (hashed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            hashed ^= hashed >> np.uint64(31)
        slot = np.int64(hashed & np.uint64(size - 1))
        while True:
            other = table[slot]
            if other < 0:
                table[slot], first[count], index[k] = count, k, count
                count += 1
                break
            at = first[other]
            if (
                rows[at, 0] == rows[k, 0]
                and rows[at, 1] == rows[k, 1]
                and rows[at, 2] == rows[k, 2]
            ):
                index[k] = other
                break
            slot = (slot + 1) & (size - 1)
    return first[:count], index


def bound_triangles(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Return the least and the greatest coordinates (m, k) of triangles with these corners, each (m, k)."""
    # much faster than numpy's own minimum along so short an axis
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def corner_faces(mesh: Mesh) -> tuple[Ints, Ints]:
    """Return faces around each vertex: `faces` (3 m,) and `first` (n + 1,), where each vertex's begin."""
    corner = mesh.faces.reshape(-1)
    order = np.argsort(corner, kind="stable")
    count = np.bincount(corner, minlength=len(mesh.vertices))
    return order // 3, np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def connect(start: Ints, end: Ints, count: int) -> tuple[Ints, int]:
    """Return connected components of a graph: the component (count,) of each node, and how many there are.

    Args:
        start, end: (k,) the nodes that each edge joins.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return np.asarray(label, dtype=np.int64), int(number)


def number_bodies(mesh: Mesh) -> tuple[Ints, int]:
    """Give the connected surface (n,) of each vertex, in the order of their first faces; how many there are.

    -1 for vertices that no face uses.
    """
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    label, _ = connect(start, end, len(mesh.vertices))
    found, first = np.unique(label[mesh.faces[:, 0]], return_index=True)
    rank = np.full(len(mesh.vertices), -1, dtype=np.int64)
    rank[found[np.argsort(first)]] = np.arange(len(found))
    return np.asarray(rank[label], dtype=np.int64), len(found)


def enclosed_volume(mesh: Mesh) -> float:
    """Compute the volume of a closed mesh, mm³, by the divergence theorem; negative if inside out."""
    corner = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    return float(np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6)


def move_points(points: Array, motion: Array) -> Array:
    """Return points (n, 3) moved by a rigid motion (4, 4)."""
    return np.asarray(points @ motion[:3, :3].T + motion[:3, 3])
