"""Several closed surfaces as one mesh, and back again; meshes as solids that can be united."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array

if TYPE_CHECKING:
    from manifold3d import Manifold

__all__ = [
    "Mesh",
    "as_manifold",
    "as_mesh",
    "box_of",
    "face_normals",
    "join_meshes",
    "keep_faces",
    "split_shells",
    "unit",
]

Mesh = tuple[Array, NDArray[np.int32]]
"""Vertices (n, 3) mm and faces (m, 3)."""


def as_manifold(mesh: Mesh) -> Manifold:
    """Return a watertight mesh as a solid of manifold3d, in double precision."""
    from manifold3d import Manifold, Mesh64

    vertices, faces = mesh
    return Manifold(
        Mesh64(
            np.ascontiguousarray(vertices, dtype=np.float64),
            np.ascontiguousarray(faces, dtype=np.uint64),
        )
    )


def as_mesh(solid: Manifold) -> Mesh:
    """Return the surface of a solid."""
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    return vertices, np.array(mesh.tri_verts, dtype=np.int32)


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return all meshes as one, in their order; no vertex is shared between them."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + shift for (_, faces), shift in zip(meshes, first, strict=True)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces).astype(np.int32)


def box_of(meshes: Sequence[Mesh]) -> tuple[Array, Array]:
    """Return lowest and highest corner (3,) of all meshes together, mm."""
    low = np.min([vertices.min(axis=0) for vertices, _ in meshes], axis=0)
    return low, np.max([vertices.max(axis=0) for vertices, _ in meshes], axis=0)


def face_normals(corners: Array) -> Array:
    """Return (m, 3) out of triangles (m, 3, 3), each as long as twice its area."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def unit(vectors: Array) -> Array:
    """Return (..., 3) vectors of length 1 in the same directions; what has no length stays."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-300))


def keep_faces(vertices: Array, faces: NDArray[np.int32]) -> Mesh:
    """Return some of a mesh's faces (k, 3) with the vertices that they use."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)


def split_shells(mesh: Mesh) -> list[Mesh]:
    """Return the connected surfaces of a mesh, in the order of their first faces.

    Faces that share a vertex are connected; vertices that belong to no face are dropped.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    vertices, faces = mesh
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    n = len(vertices)
    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    of_faces = label[faces[:, 0]]
    names, first = np.unique(of_faces, return_index=True)
    return [keep_faces(vertices, faces[of_faces == name]) for name in names[np.argsort(first)]]
