"""The make-up of a mesh: its edges, corners where it is pinched, bodies, genera and volumes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.mesh import Mesh, connect
from knotfab_validators.geometry.triangle_loops import find_flat

__all__ = ["Surface", "duplicate_faces", "flat_faces", "survey"]


FLAT = 1e-12  # a share of the longest edge's square: twice the area of a face that has none
ROUNDS = 64  # faces about a corner that are counted one by one; corners with more of them are rare


@dataclass(frozen=True)
class Surface:
    """A mesh with finite vertices, taken apart.

    Edges are pairs (k, 2) of vertices: `open_edges` belong to an odd number of faces (one: the rim
    of a hole), `crowded_edges` to more than two, and the faces of `flipped_edges` run through
    them more often one way than the other. `pinched` are vertices where several fans of faces
    meet; they are looked for only where every edge has its two faces. `body` (m,) is each face's
    body: what is joined across edges of two faces. `genus` and `volumes_mm3` (signed) have one
    value per body, and mean something only where the mesh is closed, wound in one way and not
    pinched.
    """

    open_edges: Ints
    crowded_edges: Ints
    flipped_edges: Ints
    pinched: Ints
    flat: Ints
    duplicate: Ints
    body: Ints
    genus: Ints
    volumes_mm3: Array

    @property
    def closed(self) -> bool:
        """True if it encloses a volume: closed, and wound in one way."""
        return not (len(self.open_edges) or len(self.flipped_edges))

    @property
    def manifold(self) -> bool:
        """True if it is a surface at every edge and corner."""
        return self.closed and not (len(self.crowded_edges) or len(self.pinched))


def survey(mesh: Mesh) -> Surface:
    """Return edges, corners, bodies, genera and volumes of a mesh with finite vertices and some faces.

    The genus g follows from V - E + F = 2 - 2g of each body, the volume from the divergence
    theorem: a sixth of the sum of det(a, b, c) over its faces.
    """
    faces, vertices = mesh.faces, mesh.vertices
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * np.int64(len(vertices)) + high
    order = np.argsort(key)
    key = key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    count = np.diff(first, append=len(key))
    forward = np.add.reduceat((start < end)[order].astype(np.int64), first)
    edges = np.stack([low[order[first]], high[order[first]]], axis=1)

    paired = count == 2
    one, other = order[first[paired]], order[first[paired] + 1]
    body, bodies = connect(one // 3, other // 3, len(faces))
    is_open, is_flipped = count % 2 == 1, (count % 2 == 0) & (2 * forward != count)
    whole = bool(paired.all()) and not is_flipped.any()
    points = _vertices_of_bodies(faces, body, bodies, len(vertices))
    euler = (
        points
        - np.bincount(body[order[first] // 3], minlength=bodies)
        + np.bincount(body, minlength=bodies)
    )
    corner = vertices[faces] - vertices[faces[0, 0]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    six = np.einsum("ij,ij->i", corner[:, 0], normal)
    return Surface(
        open_edges=edges[is_open],
        crowded_edges=edges[count > 2],
        flipped_edges=edges[is_flipped],
        pinched=_find_pinched(faces, one, other, len(vertices)) if whole else np.empty(0, np.int64),
        flat=flat_faces(mesh),
        duplicate=duplicate_faces(mesh),
        body=body,
        genus=1 - euler // 2,
        volumes_mm3=np.bincount(body, six, minlength=bodies) / 6,
    )


def flat_faces(mesh: Mesh) -> Ints:
    """Return faces without an area: a corner twice, or three corners in a line (but for rounding)."""
    return np.flatnonzero(find_flat(mesh.vertices, mesh.faces, FLAT))


def duplicate_faces(mesh: Mesh) -> Ints:
    """Return faces whose three corners are exactly an earlier face's, in any order.

    A hash of each corner's coordinates, added up over the face, finds the candidates; they are
    then compared by their coordinates.
    """
    bits = np.ascontiguousarray(mesh.vertices + 0.0).view(np.uint64)
    hashed = np.zeros(len(bits), dtype=np.uint64)
    for axis in range(3):
        hashed = _scramble(hashed ^ bits[:, axis])
    total = hashed[mesh.faces].sum(axis=1, dtype=np.uint64)
    order = np.argsort(total)
    same = np.flatnonzero(np.diff(total[order]) == 0)
    if not len(same):
        return np.empty(0, dtype=np.int64)
    some = np.unique(np.concatenate([order[same], order[same + 1]]))
    corner = mesh.vertices[mesh.faces[some]] + 0.0
    by = np.lexsort(corner.transpose(2, 0, 1), axis=-1)
    rows = np.take_along_axis(corner, by[..., None], axis=1).reshape(len(some), 9)
    _, kept = np.unique(rows, axis=0, return_index=True)
    return np.asarray(np.delete(some, kept), dtype=np.int64)


def _scramble(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Scramble 64 bits (the finalizer of SplitMix64: Steele, Lea and Flood, OOPSLA 2014)."""
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _find_pinched(faces: Ints, one: Ints, other: Ints, count: int) -> Ints:
    """Find vertices whose faces form more than one fan; `one` and `other` are paired half-edges.

    Half-edge 3f + i leads from corner i of face f to the next. From a half-edge one turns about
    its start to the twin of the half-edge before it; the round must meet every face there.
    """
    twin = np.empty(faces.size, dtype=np.int64)
    twin[one], twin[other] = other, one
    leaving = np.full(count, -1, dtype=np.int64)
    leaving[faces.reshape(-1)] = np.arange(faces.size)
    active = np.flatnonzero(leaving >= 0)
    begun = at = leaving[active]
    met = np.zeros(count, dtype=np.int64)
    for _ in range(ROUNDS):
        met[active] += 1
        at = twin[at - at % 3 + (at + 2) % 3]
        going = at != begun
        active, begun, at = active[going], begun[going], at[going]
        if not len(active):
            break
    bad = met != np.bincount(faces.reshape(-1), minlength=count)
    if len(active):
        from igl import is_vertex_manifold

        bad[active] = ~is_vertex_manifold(np.ascontiguousarray(faces))[active]
    return np.flatnonzero(bad)


def _vertices_of_bodies(faces: Ints, body: Ints, bodies: int, count: int) -> Ints:
    """Count how many vertices each body has; one that two bodies share counts for both."""
    corner, owner = faces.reshape(-1), np.full(count, -1, dtype=np.int64)
    label = np.repeat(body, 3)
    owner[corner] = label
    if (owner[corner] == label).all():
        return np.bincount(owner[owner >= 0], minlength=bodies)
    pairs = np.unique(label * np.int64(count) + corner)
    return np.bincount(pairs // count, minlength=bodies)
