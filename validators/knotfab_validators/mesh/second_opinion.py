"""Faces that meet where they must not: libigl's exact predicates, and pymeshlab's second opinion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from knotfab_validators.arrays import Ints
from knotfab_validators.geometry.heap import overlapping_boxes, tell_heap
from knotfab_validators.geometry.mesh import Mesh

__all__ = ["Opinions", "crossing_faces", "opinions", "self_intersections"]


MOST_COUNTED = 5_000_000  # above so many crossings the first is enough
TURNS = Rotation.from_euler(
    "xyz", [(1, 2, 3), (2, 3, 1), (3, 1, 2), (4, 5, 6)]
).as_matrix()  # radians


@dataclass(frozen=True)
class Opinions:
    """The findings of the two libraries in one mesh.

    `pairs` (k, 2) are faces that meet by libigl, all of them or, where `counted` is False, the first
    that was found. `seen` are the faces that cross others by pymeshlab; None where it could not be
    asked, and `why` says so. Both None: the mesh is such a heap that neither was asked.
    """

    pairs: Ints | None
    counted: bool
    seen: Ints | None
    why: str = ""


def opinions(mesh: Mesh) -> Opinions:
    """Ask both libraries; faces without an area must have been left out.

    libigl (AABB tree, Shewchuk's exact predicates) takes faces that only touch for meeting: a
    corner, an edge or a plane in common that is not in the index is enough. pymeshlab (Möller's
    test in floating point) sees those that cross, of which each lies on both sides of the other.
    So where faces only touch libigl alone finds them. Both let go faces of the same three corners:
    those are duplicates, and another check's.
    """
    boxes = overlapping_boxes(mesh)
    if why := tell_heap(mesh, boxes):
        return Opinions(None, False, None, why)
    counted = boxes <= MOST_COUNTED
    pairs = self_intersections(mesh, first_only=not counted)
    asked = mesh if counted or not len(pairs) else Mesh(mesh.vertices, mesh.faces[pairs[0]])
    try:
        seen = crossing_faces(asked)
    except ImportError as error:
        return Opinions(pairs, counted, None, f"pymeshlab cannot be loaded here ({error})")
    if not len(pairs):
        seen = _ask_again(mesh, seen)
    return Opinions(pairs, counted, seen if asked is mesh else pairs[0][seen])


def _ask_again(mesh: Mesh, seen: Ints) -> Ints:
    """Keep the faces that pymeshlab still takes for crossing when it is asked of them alone, turned.

    In a plane aslant to the axes its rounding takes long, thin faces beside each other for crossing; a real
    crossing stays one however it is turned.
    """
    for turn in TURNS:
        if not len(seen):
            break
        used, faces = np.unique(mesh.faces[seen], return_inverse=True)
        corners = mesh.vertices[used]
        turned = (corners - corners.mean(axis=0)) @ turn.T
        seen = seen[crossing_faces(Mesh(turned, faces.reshape(-1, 3)))]
    return seen


def self_intersections(mesh: Mesh, first_only: bool = False) -> Ints:
    """Find pairs (k, 2) of faces that meet outside shared corners and edges, by exact predicates."""
    from igl import predicates

    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(mesh.vertices, dtype=np.float64),
        np.ascontiguousarray(mesh.faces, dtype=np.int64),
        first_only,
    )
    return np.asarray(pairs, dtype=np.int64).reshape(-1, 2)


def crossing_faces(mesh: Mesh) -> Ints:
    """Return faces that cross others by pymeshlab's filter, which repairs nothing.

    Raises:
        ImportError: pymeshlab, or a library of the system that it needs, is missing.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(
        pymeshlab.Mesh(
            vertex_matrix=np.ascontiguousarray(mesh.vertices, dtype=np.float64),
            face_matrix=np.ascontiguousarray(mesh.faces, dtype=np.int32),
        )
    )
    meshes.apply_filter("compute_selection_by_self_intersections_per_face")
    found = meshes.current_mesh()
    if found.selected_face_number() == 0:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(np.asarray(found.face_selection_array()))
