"""A part's surface as an indexed triangle mesh, and queries that need nothing but its corners and faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab_formats.libraries import took_part
from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.rays import count_above, is_balanced

Corners = NDArray[np.floating[Any]]
"""(m, 3, 3) the corners of triangles, each with coordinates of its own, as a file gives them."""


@dataclass(frozen=True, eq=False)
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

    @cached_property
    def contiguous(self) -> tuple[Array, Ints]:
        """Vertices and faces as libigl wants them."""
        return np.ascontiguousarray(self.vertices), np.ascontiguousarray(self.faces)

    @cached_property
    def balanced(self) -> bool:
        """Whether the surface has no rim, so that its winding numbers are whole."""
        return is_balanced(self.faces, len(self.vertices))


def merge_equal(corners: Corners) -> Mesh:
    """Index triangles (m, 3, 3) by exactly equal corners (0.0 equals -0.0).

    Vertices are in the order in which the triangles name them first: neighbours lie beside each other.
    """
    flat = (corners.reshape(-1, 3) + corners.dtype.type(0.0)).astype(np.float64)
    first, index = _number_equal(flat.view(np.uint64))
    return Mesh(flat[first], index.reshape(-1, 3))


# corners, itself among them, that a rounded one has near it on average at most: faces that are all so small
# would make pairs without end
MOST_NEAR = 40


def join_rounded(mesh: Mesh, within: float) -> tuple[Mesh, float]:
    """Merge vertices on open edges that are at most `within` mm apart, as rounding by a writer leaves them.

    Faces that lose their area are dropped. Returns the mesh, and the widest gap that was closed, mm. A mesh
    that merging does not close is returned as it is, with 0.
    """
    edges = _open_edges(mesh.faces)
    ends = np.unique(edges)
    if not len(ends):
        return mesh, 0.0
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    tree, count = cKDTree(mesh.vertices[ends]), len(ends)
    if tree.count_neighbors(tree, within) > MOST_NEAR * count:
        return mesh, 0.0
    pairs = tree.query_pairs(within, output_type="ndarray")
    if not len(pairs):
        return mesh, 0.0
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, group = connected_components(graph, directed=False)
    first = np.full(group.max() + 1, len(mesh.vertices), dtype=np.int64)
    np.minimum.at(first, group, ends)
    new = np.arange(len(mesh.vertices))
    new[ends] = first[group]
    faces = new[mesh.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    joined = faces[whole]
    if not len(joined) or len(_open_edges(joined)):
        return mesh, 0.0
    gap = float(np.linalg.norm(np.subtract(*mesh.vertices[ends[pairs.T]]), axis=1).max())
    kept, index = np.unique(joined, return_inverse=True)
    return Mesh(mesh.vertices[kept], index.reshape(-1, 3)), gap


def _open_edges(faces: Ints) -> Ints:
    """Return the edges (n, 2) that an odd number of faces share."""
    if not len(faces):
        return np.empty((0, 2), dtype=np.int64)
    one, other = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    count = int(faces.max()) + 1
    keys = np.sort(np.minimum(one, other) * count + np.maximum(one, other))
    begins = np.flatnonzero(np.diff(keys, prepend=-1))
    odd = np.diff(begins, append=len(keys)) % 2 == 1
    return np.stack(np.divmod(keys[begins[odd]], count), axis=1)


@compiled
def _number_equal(rows: NDArray[np.uint64]) -> tuple[Ints, Ints]:
    """Find distinct rows of (n, 3) by hashing: where each comes first, and the number of each row."""
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
    """Return least and greatest coordinates (m, k) of triangles with corners a, b, c, (m, k)."""
    # much faster than a minimum of numpy along so short an axis
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def corner_faces(mesh: Mesh) -> tuple[Ints, Ints]:
    """List the faces around each vertex: `faces` (3 m,), where vertex i's begin at `first`[i], (n + 1,)."""
    corner = mesh.faces.reshape(-1)
    order = np.argsort(corner, kind="stable")
    count = np.bincount(corner, minlength=len(mesh.vertices))
    return order // 3, np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def connect(start: Ints, end: Ints, count: int) -> tuple[Ints, int]:
    """Find the connected components of a graph: the component of each node (count,), and their number.

    Args:
        start, end: (k,) the nodes that each edge joins.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return np.asarray(label, dtype=np.int64), int(number)


def number_bodies(mesh: Mesh) -> tuple[Ints, int]:
    """Number the connected surfaces of a mesh: that of each vertex (n,), and how many there are.

    They are in the order of their first faces; vertices that no face uses get -1.
    """
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    label, _ = connect(start, end, len(mesh.vertices))
    found, first = np.unique(label[mesh.faces[:, 0]], return_index=True)
    rank = np.full(len(mesh.vertices), -1, dtype=np.int64)
    rank[found[np.argsort(first)]] = np.arange(len(found))
    return np.asarray(rank[label], dtype=np.int64), len(found)


def body_volumes(mesh: Mesh, label: Ints, count: int) -> Array:
    """Compute the volume (count,), mm³, of each surface of `number_bodies`; negative if inside out."""
    corner = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    six = np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))
    return np.asarray(np.bincount(label[mesh.faces[:, 0]], six, minlength=count) / 6)


def enclosed_volume(mesh: Mesh) -> float:
    """Compute the volume of a closed mesh, mm³, by the divergence theorem; negative if inside out."""
    corner = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    return float(np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6)


def move_points(points: Array, motion: Array) -> Array:
    """Apply a rigid motion (4, 4) to points (n, 3)."""
    return np.asarray(points @ motion[:3, :3].T + motion[:3, 3])


# Distances of points from a surface, and winding numbers around them (libigl).


@lru_cache(maxsize=2)  # `tube` asks it for distances, `feature` and `gap` cast rays
def face_tree(mesh: Mesh) -> Any:
    """Return a tree of the faces' boxes (libigl's AABB), which is asked with `mesh.contiguous`."""
    from igl import AABB

    tree: Any = AABB()
    tree.init(*mesh.contiguous)
    return tree


def surface_distance(points: Array, mesh: Mesh) -> Array:
    """Return the distances (n,), mm, from points (n, 3) to the nearest face."""
    square = face_tree(mesh).squared_distance(*mesh.contiguous, np.ascontiguousarray(points))[0]
    return np.sqrt(np.maximum(np.asarray(square, dtype=np.float64), 0.0))


def winding_numbers(points: Array, mesh: Mesh, *, exact: bool = True) -> Array:
    """Return generalised winding numbers (n,) at points (n, 3): 1 in matter, 0 outside.

    Exact ones count the faces above each point; where the surface has a rim, or the point all but lies on
    it, they sum the solid angles of all faces. The others have an error of about a thousandth, and more
    near the surface (Barill et al., "Fast winding numbers for soups and clouds", ACM TOG
    37(4), 2018).
    """
    from igl import fast_winding_number, winding_number

    took_part("libigl", "told inside from outside")
    if not len(points):
        return np.zeros(0)
    wind = winding_number if exact else fast_winding_number
    found, unsure = np.zeros(len(points)), np.ones(len(points), dtype=np.bool_)
    if exact and len(points) > 1 and mesh.balanced:
        found, unsure = count_above(points, mesh.vertices, mesh.faces)
    if unsure.any():
        summed = wind(*mesh.contiguous, np.ascontiguousarray(points[unsure]))
        found[unsure] = np.asarray(summed, dtype=np.float64).ravel()
    return found


# A tube swept around until it meets itself, but not sewn there: its two rims are joined.

NEAR = 0.25  # largest distance between the rims' centres, as a share of their radius
ALIKE = 0.2  # largest difference between the rims' radii, as a share of either


def sew_rims(mesh: Mesh) -> Mesh | None:
    """Close a surface with two matching rims in one place by a strip of faces; None without such rims.

    VTK's tubes around closed lines are like this: the rings at the seam are turned against each other.

    Args:
        mesh: one body, consistently wound.
    """
    rims = _rims(mesh)
    if len(rims) != 2:
        return None
    one, other = rims[0], rims[1][::-1]  # now both run the same way around the tube
    a, b = mesh.vertices[one], mesh.vertices[other]
    sizes = [float(np.linalg.norm(p - p.mean(axis=0), axis=1).mean()) for p in (a, b)]
    apart = float(np.linalg.norm(a.mean(axis=0) - b.mean(axis=0)))
    if apart > NEAR * min(sizes) or max(sizes) - min(sizes) > ALIKE * max(sizes):
        return None
    nearest = int(np.linalg.norm(b - a[0], axis=1).argmin())
    strip = _zip(one, np.roll(other, -nearest), a, np.roll(b, -nearest, axis=0))
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, strip]))


def _rims(mesh: Mesh) -> list[Ints]:
    """Return the closed loops of half-edges without a twin, as vertices in order; none if they branch."""
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    count = np.int64(len(mesh.vertices))
    bare = ~np.isin(start * count + end, end * count + start)
    start, end = start[bare], end[bare]
    if len(np.unique(start)) != len(start):
        return []
    after = dict(zip(start.tolist(), end.tolist(), strict=True))
    rims = []
    while after:
        first, at = after.popitem()
        rim = [first]
        while at != first:
            rim.append(at)
            if at not in after:
                return []
            at = after.pop(at)
        rims.append(np.array(rim))
    return rims


def _zip(one: Ints, other: Ints, a: Array, b: Array) -> Ints:
    """Return the faces of a strip between two rings of vertices (n,) and (m,), at points a and b.

    Each step advances on the ring of which the smaller share has been covered.
    """
    shares = []
    for points in (a, b):
        step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        shares.append(np.cumsum(step) / step.sum())
    faces, i, j = [], 0, 0
    while i < len(one) or j < len(other):
        here, there = one[i % len(one)], other[j % len(other)]
        if j == len(other) or (i < len(one) and shares[0][i] <= shares[1][j]):
            i += 1
            faces.append((one[i % len(one)], here, there))
        else:
            j += 1
            faces.append((there, other[j % len(other)], here))
    return np.array(faces)


# The exact distance between two triangle bodies, by FCL's trees of boxes.


def collision_body(mesh: Mesh) -> Any:
    """Load the mesh into FCL. Triangles with two equal corners stand for edges."""
    import fcl

    model = fcl.BVHModel()
    took_part("python-fcl", "measured the clearance of bodies")
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return fcl.CollisionObject(model)


def collision_distance(one: Any, other: Any) -> tuple[float, Array]:
    """Return the least distance between two bodies, 0 if they cross, and the nearest points (2, 3)."""
    import fcl

    request, result = fcl.DistanceRequest(enable_nearest_points=True), fcl.DistanceResult()
    distance = max(float(fcl.distance(one, other, request, result)), 0.0)
    return distance, np.asarray(result.nearest_points, dtype=np.float64)


@dataclass(frozen=True)
class Parted:
    """A part separated into its tubes and its bars; a bar is a body without a handle."""

    strands: Mesh
    bars: Mesh | None


@lru_cache(maxsize=2)  # as printed, and as it is once it has shrunk
def part_bars(mesh: Mesh) -> Parted:
    """Separate bars from tubes by Euler's characteristic: 2 for a ball, 0 for a torus."""
    if not mesh.usable:
        return Parted(mesh, None)
    label, count = number_bodies(mesh)
    of = label[mesh.faces[:, 0]]
    corners = np.bincount(label[label >= 0], minlength=count)
    ball = 2 * corners - np.bincount(of, minlength=count) == 4
    bar = ball & (body_volumes(mesh, label, count) > 0)  # a cavity is no bar
    if not bar.any() or bar.all():
        return Parted(mesh, None)
    return Parted(_keep(mesh, ~bar[of]), _keep(mesh, bar[of]))


def _keep(mesh: Mesh, faces: Mask) -> Mesh:
    used, index = np.unique(mesh.faces[faces], return_inverse=True)
    return Mesh(mesh.vertices[used], index.reshape(-1, 3))
