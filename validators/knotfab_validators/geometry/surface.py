"""Survey of a mesh: its edges, pinched corners, bodies, genera and volumes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.mesh import Mesh, bound_triangles, connect
from knotfab_validators.geometry.triangles import find_flat

FLAT = 1e-12  # twice the area of a face that counts as flat, as a share of its longest edge squared
ROUNDS = 64  # faces around a corner that are walked one at a time; few corners have more


@dataclass(frozen=True)
class Surface:
    """A mesh with finite vertices, taken apart.

    Edges are pairs (k, 2) of vertices: `open_edges` belong to an odd number of faces (one: the rim
    of a hole), `crowded_edges` to more than two, and the faces of `flipped_edges` run through them
    more often one way than the other. `pinched` are vertices where several fans of faces meet; they
    are looked for only where every edge has its two faces. `body` (m,) is each face's body: what is
    joined across edges of two faces. `genus` and `volumes_mm3` (signed) have one value per body,
    and mean something only where the mesh is closed, wound in one way and not pinched.
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
    """Survey a mesh with finite vertices and some faces.

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
    """Return the indices of faces without area: a repeated corner, or three in a line up to rounding."""
    return np.flatnonzero(find_flat(mesh.vertices, mesh.faces, FLAT))


def duplicate_faces(mesh: Mesh) -> Ints:
    """Return the indices of faces with exactly the three corners of an earlier face, in any order.

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

    Half-edge 3f + i leads from corner i of face f to the next one. The twin of the half-edge before
    it leaves the same corner: repeated, this walk around the corner must reach every face there.
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
    """Count the vertices of each body; one that two bodies share counts for both."""
    corner, owner = faces.reshape(-1), np.full(count, -1, dtype=np.int64)
    label = np.repeat(body, 3)
    owner[corner] = label
    if (owner[corner] == label).all():
        return np.bincount(owner[owner >= 0], minlength=bodies)
    pairs = np.unique(label * np.int64(count) + corner)
    return np.bincount(pairs // count, minlength=bodies)


# Circle-valued functions on a closed surface of genus 1, whose level sets run around it once.


# bounds on an edge's weight: cotangents of slivers are large or negative
LEAST_WEIGHT, MOST_WEIGHT = 0.05, 20.0


@dataclass(frozen=True)
class CircleFunction:
    """A function from a surface to the circle R/Z, linear on every face.

    `phase` (n,) is its value at each vertex, mod 1. Within a face it grows from the first corner to the
    other two by `rise` (m, 2), real numbers.
    """

    phase: Array
    rise: Array


@dataclass(frozen=True)
class _Edges:
    """The edges (k, 2) of a mesh, lower vertex first.

    The half-edge of face f that leaves its corner i belongs to the edge `of_face`[f, i] (m, 3), and
    runs along it where `sign`[f, i] is 1, against it where that is -1.
    """

    ends: Ints
    of_face: Ints
    sign: Ints


def circle_functions(mesh: Mesh) -> tuple[CircleFunction, CircleFunction]:
    """Find the two harmonic circle-valued functions of least energy on a closed oriented surface of genus 1.

    On a long tube the first winds once along it, and hardly changes around it. A discrete harmonic 1-form
    with positive weights has no zero on such a surface (Gortler, Gotsman and Thurston, "Discrete one-forms
    on meshes", CAGD 23(2), 2006), so that each level set is one closed curve.

    Integer 1-forms on the edges are made harmonic by a function of the vertices. That function is the phase,
    since integers vanish on the circle. Gauss's reduction gives the shortest two combinations of the forms.

    Args:
        mesh: one body of genus 1 that uses all its vertices, each edge in two faces, once either way.
    """
    edges = _edges(mesh)
    weight = _weigh(mesh, edges)
    forms = _closed_forms(edges, len(mesh.vertices))
    phase = _solve(len(mesh.vertices), edges, weight, forms)
    forms = forms + phase[:, edges.ends[:, 1]] - phase[:, edges.ends[:, 0]]
    found = []
    for pair in _reduce((forms * weight) @ forms.T):
        ahead = edges.sign * (pair @ forms)[edges.of_face]
        rise = np.stack([ahead[:, 0], -ahead[:, 2]], axis=1)
        found.append(CircleFunction((pair @ phase) % 1.0, rise))
    return found[0], found[1]


def _edges(mesh: Mesh) -> _Edges:
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    key, number = np.unique(low * np.int64(len(mesh.vertices)) + high, return_inverse=True)
    ends = np.stack(np.divmod(key, len(mesh.vertices)), axis=1)
    sign = np.where(start < end, 1, -1)
    return _Edges(ends, number.reshape(-1, 3), sign.reshape(-1, 3))


def _weigh(mesh: Mesh, edges: _Edges) -> Array:
    """Return the weights (k,) of the edges: half the sum of the two opposite cotangents, kept positive."""
    corner = mesh.vertices[mesh.faces]
    one, other = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    area = np.linalg.norm(np.cross(one, other), axis=2)
    cotangent = np.einsum("mij,mij->mi", one, other) / np.maximum(area, 1e-300)
    # the cotangent at the corner opposite half-edge i
    across = np.roll(cotangent, 1, axis=1)
    weight = 0.5 * np.bincount(edges.of_face.reshape(-1), across.reshape(-1))
    return np.clip(weight, LEAST_WEIGHT, MOST_WEIGHT)


def _closed_forms(edges: _Edges, vertices: int) -> Array:
    """Return two closed integer 1-forms (2, k) that span the surface's cohomology, by tree and cotree.

    A spanning tree of the vertices and one of the faces, across other edges, leave two edges (Erickson and
    Whittlesey, "Greedy optimal homotopy and homology generators", SODA 2005). Each of these closes a loop of
    faces through their tree; its form counts how the loop crosses edges.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order

    def tree(one: Ints, other: Ints, number: Ints, count: int) -> tuple[Ints, Ints]:
        """Return each node's parent in a spanning tree, and the edge to it; -1 if none."""
        pair, first = np.unique(
            np.minimum(one, other) * np.int64(count) + np.maximum(one, other), return_index=True
        )
        row, column = np.divmod(pair, count)
        graph = coo_matrix((number[first] + 1, (row, column)), shape=(count, count)).tocsr()
        _, before = breadth_first_order(graph, 0, directed=False)
        node = np.flatnonzero(before >= 0)
        to = np.full(count, -1, dtype=np.int64)
        ends = np.minimum(node, before[node]), np.maximum(node, before[node])
        to[node] = np.asarray(graph[ends]).reshape(-1) - 1
        return before.astype(np.int64), to

    free: Mask = np.ones(len(edges.ends), dtype=bool)
    low, high = edges.ends.T
    _, up = tree(low, high, np.arange(len(free)), vertices)
    free[up[up >= 0]] = False
    sides = np.argsort(edges.of_face.reshape(-1), kind="stable").reshape(-1, 2) // 3
    rest = np.flatnonzero(free)
    before, up = tree(sides[rest, 0], sides[rest, 1], rest, len(edges.of_face))
    free[up[up >= 0]] = False
    # whether each face runs along the edge to its parent
    along = (edges.sign * (edges.of_face == up[:, None])).sum(axis=1)
    forms = np.zeros((2, len(free)))
    for form, edge in zip(forms, np.flatnonzero(free), strict=True):
        leave, arrive = sides[edge]
        if edges.sign[leave][edges.of_face[leave] == edge][0] < 0:
            leave, arrive = arrive, leave
        form[edge] = 1.0
        for face, way in ((arrive, 1.0), (leave, -1.0)):  # above the meeting point the two cancel
            while before[face] >= 0:
                form[up[face]] += way * along[face]
                face = before[face]
    return forms


def _solve(vertices: int, edges: _Edges, weight: Array, forms: Array) -> Array:
    """Solve a Laplace equation for each closed form: the functions (2, n) that make it harmonic."""
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import splu

    count = len(weight)
    row = np.tile(np.arange(count), 2)
    sign = np.repeat([-1.0, 1.0], count)
    differ = coo_matrix((sign, (row, edges.ends.T.reshape(-1))), shape=(count, vertices)).tocsc()
    weigh = diags(weight)
    laplace = (differ.T @ weigh @ differ).tocsc()[1:, 1:]  # the first vertex is fixed at 0
    factors = splu(laplace, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    right = -(differ.T @ (weigh @ forms.T))[1:]
    return np.concatenate([np.zeros((2, 1)), factors.solve(np.ascontiguousarray(right)).T], axis=1)


def _reduce(gram: Array) -> tuple[Ints, Ints]:
    """Reduce a quadratic form (2, 2) by Gauss's method to its two shortest independent integer vectors."""
    short, long = np.array([1, 0]), np.array([0, 1])
    for _ in range(100):
        if short @ gram @ short > long @ gram @ long:
            short, long = long, short
        times = round(float(short @ gram @ long) / float(short @ gram @ short))
        if times == 0:
            break
        long = long - times * short
    return short, long


# Estimate how many pairs of a mesh's faces have overlapping bounding boxes.


# sampled faces of each size class, whose boxes are compared with all others
SAMPLES = 6
MOST_BOXES = 10_000_000  # pairs of overlapping boxes that are always accepted
MOST_CELLS, MOST_CELLS_A_FACE = 30_000_000, 50  # entries of a grid; a sound part has 1 to 5 a face
FLATTEST = 1e-4  # of the longest side: a mesh is taken to be no thinner
MOST_A_FACE = 100  # pairs a face that are accepted beyond that; a sound part has 10 to 40


class TooMuchWork(Exception):
    """A check would take too long on this part; the message says why."""


def bound_work(count: float, most: int, what: str) -> None:
    """Require that a check has at most `most` steps of work.

    Raises:
        TooMuchWork: it has more; `what` names them.
    """
    if count > most:
        raise TooMuchWork(f"{count:.0f} {what}, more than {most}")


def tell_heap(mesh: Mesh, boxes: float | None = None) -> str | None:
    """Say why a mesh is such a heap of faces that no tree of boxes helps; None where it is not.

    Args:
        boxes: about how many pairs of boxes overlap, if that is known already.
    """
    boxes = overlapping_boxes(mesh) if boxes is None else boxes
    if boxes > max(MOST_BOXES, MOST_A_FACE * len(mesh.faces)):
        return f"some {boxes:.1g} pairs of faces have boxes that overlap"
    cells = count_cells(mesh)
    if cells > max(MOST_CELLS, MOST_CELLS_A_FACE * len(mesh.faces)):
        each = cells / len(mesh.faces)
        return f"{len(mesh.faces)} faces lie on each other, each in some {each:.1g} cells of a common grid"
    return None


def count_cells(mesh: Mesh) -> float:
    """Count the entries of a grid of about as many cubes as faces, with each face in all that it may meet.

    Libraries keep faces in such grids, which many faces close to each other fill beyond any memory.
    """
    low, high = bound_triangles(*mesh.vertices[mesh.faces].swapaxes(0, 1))
    size = high.max(axis=0) - low.min(axis=0)
    size = np.maximum(size, FLATTEST * max(float(size.max()), 1e-300))
    per_mm = np.cbrt(len(mesh.faces) / size.prod())
    cells = np.minimum(np.floor((high - low) * per_mm) + 1, np.maximum(size * per_mm, 1.0))
    return float(cells.prod(axis=1).sum())


@compiled
def _count_met(low: Array, high: Array, face: int) -> int:
    """Count the boxes, from low to high (m, 3), that meet the box of one face, including itself."""
    met = 0
    for k in range(len(low)):
        apart = False
        for axis in range(3):
            apart |= low[k, axis] > high[face, axis] or high[k, axis] < low[face, axis]
        met += not apart
    return met


def overlapping_boxes(mesh: Mesh) -> float:
    """Estimate how many pairs of faces have overlapping bounding boxes, from a sample of every size.

    A few long slanting faces may have more overlaps than all others together. So faces are sorted by size
    into layers, each 16 times as many as the one before.
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
