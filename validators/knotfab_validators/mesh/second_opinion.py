"""Faces that meet where they must not: libigl's exact predicates, and pymeshlab's second opinion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.compiled import compiled
from knotfab_validators.geometry.mesh import Mesh, bound_triangles

__all__ = [
    "Opinions",
    "crossing_faces",
    "opinions",
    "overlapping_boxes",
    "self_intersections",
    "tell_heap",
]


SAMPLES = (
    6  # faces of each of some sizes whose boxes are compared with all others: how much work it is
)
MOST_BOXES = 10_000_000  # pairs of overlapping boxes that are tested, or as many as
MOST_A_FACE = 100  # times the number of faces: a good part has some 10 to 40 a face
MOST_COUNTED = 5_000_000  # with more of them the first crossing is enough


@dataclass(frozen=True)
class Opinions:
    """What the two libraries found in one mesh.

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
    return Opinions(pairs, counted, seen if asked is mesh else pairs[0][seen])


def tell_heap(mesh: Mesh, boxes: float | None = None) -> str | None:
    """Why a mesh is such a heap of faces that no tree of boxes helps; None where it is not.

    Args:
        boxes: about how many pairs of boxes overlap, where that is known.
    """
    boxes = overlapping_boxes(mesh) if boxes is None else boxes
    if boxes <= max(MOST_BOXES, MOST_A_FACE * len(mesh.faces)):
        return None
    return f"some {boxes:.1g} pairs of faces have boxes that overlap"


def self_intersections(mesh: Mesh, first_only: bool = False) -> Ints:
    """Pairs (k, 2) of faces that meet elsewhere than in what they share, by exact predicates."""
    from igl import predicates

    _, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(mesh.vertices, dtype=np.float64),
        np.ascontiguousarray(mesh.faces, dtype=np.int64),
        first_only,
    )
    return np.asarray(pairs, dtype=np.int64).reshape(-1, 2)


def crossing_faces(mesh: Mesh) -> Ints:
    """Faces that cross others by pymeshlab's filter, which repairs nothing.

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


@compiled
def _count_met(low: Array, high: Array, face: int) -> int:
    """How many boxes, from low to high (m, 3), meet that of one face, itself among them."""
    met = 0
    for k in range(len(low)):
        apart = False
        for axis in range(3):
            apart |= low[k, axis] > high[face, axis] or high[k, axis] < low[face, axis]
        met += not apart
    return met


def overlapping_boxes(mesh: Mesh) -> float:
    """About how many pairs of faces have bounding boxes that overlap, from a few faces of every size.

    A few long faces aslant may have more overlaps than all others together: by size the faces are told
    apart in layers, each 16 times as many as the one before.
    """
    low, high = bound_triangles(*mesh.vertices[mesh.faces].swapaxes(0, 1))
    count = len(mesh.faces)
    order = np.argsort(-np.linalg.norm(high - low, axis=1), kind="stable")
    draw = np.random.default_rng(0)
    total, first = 0.0, 0
    while first < count:
        layer = order[first : max(SAMPLES, 16 * first)]
        met = 0
        chosen = draw.permutation(layer)[:SAMPLES]
        for face in chosen:
            met += _count_met(low, high, int(face)) - 1
        total += met / len(chosen) * len(layer)
        first += len(layer)
    return total / 2
