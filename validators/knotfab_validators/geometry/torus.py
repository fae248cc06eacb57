"""Circle-valued functions on a closed surface of genus 1, whose level sets run round it once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.mesh import Mesh

__all__ = ["CircleFunction", "circle_functions"]

# an edge's weights: cotangents of slivers are large or negative
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
    """Find the two harmonic functions of least energy from a closed oriented surface of genus 1 to a circle.

    Of a long tube the first goes once along it, and hardly changes round it. A discrete harmonic 1-form
    of positive weights has no zero on such a surface (Gortler, Gotsman and Thurston, "Discrete one-forms
    on meshes", CAGD 23(2), 2006), so that each level set is one closed curve.

    Integers on the edges are made harmonic by a function of the vertices, which is the phase, for
    integers vanish on the circle; the shortest two combinations of the forms are Gauss's.

    Args:
        mesh: one body of genus 1 that uses all its vertices, each edge in two faces, either way once.
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
    """Return (k,) half the sum of the two cotangents across each edge, kept positive."""
    corner = mesh.vertices[mesh.faces]
    one, other = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    area = np.linalg.norm(np.cross(one, other), axis=2)
    cotangent = np.einsum("mij,mij->mi", one, other) / np.maximum(area, 1e-300)
    # the cotangent of the corner that the half-edge i does not touch
    across = np.roll(cotangent, 1, axis=1)
    weight = 0.5 * np.bincount(edges.of_face.reshape(-1), across.reshape(-1))
    return np.clip(weight, LEAST_WEIGHT, MOST_WEIGHT)


def _closed_forms(edges: _Edges, vertices: int) -> Array:
    """Return (2, k) closed integer 1-forms, a basis of the surface's cohomology: by tree and cotree.

    A tree of the vertices, a tree of the faces across the other edges, and two edges in neither
    (Erickson and Whittlesey, "Greedy optimal homotopy and homology generators", SODA 2005). Each
    of these closes a loop of faces through their tree; its form counts how the loop crosses edges.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order

    def tree(one: Ints, other: Ints, number: Ints, count: int) -> tuple[Ints, Ints]:
        """Return for each node the node before it on the way from the first, and the edge to it; -1: none."""
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
    # whether each face runs along the edge that leads up from it
    along = (edges.sign * (edges.of_face == up[:, None])).sum(axis=1)
    forms = np.zeros((2, len(free)))
    for form, edge in zip(forms, np.flatnonzero(free), strict=True):
        leave, arrive = sides[edge]
        if edges.sign[leave][edges.of_face[leave] == edge][0] < 0:
            leave, arrive = arrive, leave
        form[edge] = 1.0
        for face, way in ((arrive, 1.0), (leave, -1.0)):  # above where they meet the two cancel
            while before[face] >= 0:
                form[up[face]] += way * along[face]
                face = before[face]
    return forms


def _solve(vertices: int, edges: _Edges, weight: Array, forms: Array) -> Array:
    """Return (2, n) the functions whose differences make closed forms harmonic: a Laplace equation each."""
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import splu

    count = len(weight)
    row = np.tile(np.arange(count), 2)
    sign = np.repeat([-1.0, 1.0], count)
    differ = coo_matrix((sign, (row, edges.ends.T.reshape(-1))), shape=(count, vertices)).tocsc()
    weigh = diags(weight)
    laplace = (differ.T @ weigh @ differ).tocsc()[1:, 1:]  # the first vertex is held at 0
    factors = splu(laplace, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    right = -(differ.T @ (weigh @ forms.T))[1:]
    return np.concatenate([np.zeros((2, 1)), factors.solve(np.ascontiguousarray(right)).T], axis=1)


def _reduce(gram: Array) -> tuple[Ints, Ints]:
    """Return the two shortest independent pairs of integers by a quadratic form (2, 2): Gauss's reduction."""
    short, long = np.array([1, 0]), np.array([0, 1])
    for _ in range(100):
        if short @ gram @ short > long @ gram @ long:
            short, long = long, short
        times = round(float(short @ gram @ long) / float(short @ gram @ short))
        if times == 0:
            break
        long = long - times * short
    return short, long
