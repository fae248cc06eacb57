"""Closed meshes with known measures, for the tests of printability."""

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.mesh import Mesh, merge_equal
from tests.corpus.parts import blocks as cells_of


def blocks(x: list[float], y: list[float], z: list[float], filled: object) -> Mesh:
    """The solid of those cells of a rectilinear grid that `filled` (nx, ny, nz) marks."""
    body = cells_of(np.asarray(filled, dtype=bool), x, y, z)
    return Mesh(body.vertices, body.faces)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    return blocks(*([a, b] for a, b in zip(low, high, strict=True)), np.ones((1, 1, 1)))


def prism(corners: object, length: float) -> Mesh:
    """A convex polygon (n, 2) in x and z, counter-clockwise seen from -y, drawn out along y."""
    p = np.asarray(corners, dtype=float)
    n = len(p)
    front = np.column_stack([p[:, 0], np.zeros(n), p[:, 1]])
    back = front + [0.0, length, 0.0]
    triangles = []
    for i in range(1, n - 1):
        triangles += [front[[0, i, i + 1]], back[[0, i + 1, i]]]
    for i in range(n):
        j = (i + 1) % n
        triangles += [
            np.array([front[i], back[i], back[j]]),
            np.array([front[i], back[j], front[j]]),
        ]
    return merge_equal(np.array(triangles))


def cone(tip: tuple[float, float, float], radius: float, height: float, sides: int = 48) -> Mesh:
    """A cone that stands on its tip."""
    t = 2 * np.pi * np.arange(sides) / sides
    rim = np.column_stack([radius * np.cos(t), radius * np.sin(t), np.full(sides, height)]) + tip
    top = np.array([0.0, 0.0, height]) + tip
    triangles = []
    for i in range(sides):
        j = (i + 1) % sides
        triangles += [np.array([rim[i], rim[j], top]), np.array([rim[j], rim[i], tip])]
    return merge_equal(np.array(triangles))


def together(*meshes: Mesh) -> Mesh:
    return merge_equal(np.concatenate([m.vertices[m.faces] for m in meshes]))


def inward(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1].copy())


def move(mesh: Mesh, turn: Array | None = None, shift: object = (0.0, 0.0, 0.0)) -> Mesh:
    points = mesh.vertices if turn is None else mesh.vertices @ turn.T
    return Mesh(points + np.asarray(shift, dtype=float), mesh.faces)


def quarter(mesh: Mesh) -> Mesh:
    """Turned by 90° about z, back on the positive octant."""
    turned = move(mesh, np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    low = turned.vertices.min(axis=0)
    return move(turned, shift=(-low[0], -low[1], 0.0))


def bridge(span: float, width: float, height: float = 10.0, pier: float = 5.0) -> Mesh:
    """Two piers and a deck 2 mm thick between them, along x."""
    x = [0.0, pier, pier + span, 2 * pier + span]
    return blocks(x, [0.0, width], [0.0, height, height + 2.0], [[[1, 1]], [[0, 1]], [[1, 1]]])


def table(top: float = 20.0, leg: float = 4.0, height: float = 10.0) -> Mesh:
    """A square top 2 mm thick on one leg in its middle."""
    a = (top - leg) / 2
    filled = np.zeros((3, 3, 2))
    filled[:, :, 1] = filled[1, 1, 0] = 1
    line = [0.0, a, a + leg, top]
    return blocks(line, line, [0.0, height, height + 2.0], filled)
