"""Bodies for the corpus without the maker: tubes by a sweep of our own, blocks, balls and drums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Ints

from .curves import Array


@dataclass(frozen=True)
class Body:
    """Triangles: `vertices` (n, 3) mm, `faces` (m, 3), wound counter-clockwise seen from outside."""

    vertices: Array
    faces: Ints

    def move(self, by: Sequence[float] | Array) -> Body:
        return Body(self.vertices + np.asarray(by, dtype=np.float64), self.faces)

    def scale(self, factor: float) -> Body:
        return Body(self.vertices * factor, self.faces)

    def without(self, *faces: int) -> Body:
        return Body(self.vertices, np.delete(self.faces, faces, axis=0))

    def middle_of(self, face: int) -> Array:
        middle: Array = self.vertices[self.faces[face]].mean(axis=0)
        return middle


def join(*bodies: Body) -> Body:
    """All bodies in one mesh, their vertices apart."""
    starts = np.cumsum([0] + [len(b.vertices) for b in bodies])
    return Body(
        np.concatenate([b.vertices for b in bodies]),
        np.concatenate([b.faces + s for b, s in zip(bodies, starts, strict=False)]),
    )


def tube(curve: Array, radius: float, sides: int = 24) -> Body:
    """The tube about a closed curve (n, 3): ring i has the vertices i * sides to (i + 1) * sides - 1.

    Faces 2 (i * sides + j) and the next one lie between rings i and i + 1. The rings are widened
    so that their polygon has the circle's area.
    """
    n = len(curve)
    tangent = np.roll(curve, -1, axis=0) - np.roll(curve, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    across = np.zeros_like(curve)
    least = np.eye(3)[int(np.abs(tangent[0]).argmin())]
    across[0] = _unit(np.cross(tangent[0], least))
    for i in range(1, n):  # carried along the curve, always at right angles to it
        across[i] = _unit(across[i - 1] - tangent[i] * (across[i - 1] @ tangent[i]))
    last = _unit(across[-1] - tangent[0] * (across[-1] @ tangent[0]))
    open_by = np.arctan2(np.cross(last, across[0]) @ tangent[0], last @ across[0])
    turn = 2 * np.pi * np.arange(sides) / sides + open_by * np.arange(n)[:, None] / n
    other = np.cross(tangent, across)
    spoke = np.cos(turn)[..., None] * across[:, None] + np.sin(turn)[..., None] * other[:, None]
    alpha = 2 * np.pi / sides
    wide = radius * np.sqrt(alpha / np.sin(alpha))
    vertices = (curve[:, None] + wide * spoke).reshape(-1, 3)
    ring, j = np.arange(n)[:, None], np.arange(sides)[None]
    here, there, after = ring * sides, (ring + 1) % n * sides, (j + 1) % sides
    p, q, r, s = here + j, there + j, there + after, here + after
    return Body(vertices, np.stack([p, r, q, p, s, r], axis=-1).reshape(-1, 3))


def tubes(curves: Sequence[Array], radius: float, sides: int = 24) -> Body:
    """One tube about each curve."""
    return join(*(tube(curve, radius, sides) for curve in curves))


def box(low: Sequence[float], high: Sequence[float]) -> Body:
    """An axis-parallel box of 12 faces."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return blocks(np.ones((1, 1, 1), dtype=bool), (x0, x1), (y0, y1), (z0, z1))


def blocks(
    cells: NDArray[np.bool_], x: Sequence[float], y: Sequence[float], z: Sequence[float]
) -> Body:
    """The surface of the union of some cells (i, j, k) of a grid with planes at x, y and z, mm.

    Closed and manifold as long as no two cells meet in an edge or corner alone.
    """
    shape = tuple(n + 1 for n in cells.shape)
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1, dtype=np.float64).reshape(-1, 3)
    padded = np.pad(cells, 1)
    faces = []
    for axis in range(3):
        ahead, side = (axis + 1) % 3, (axis + 2) % 3
        step = np.moveaxis(padded, axis, 0)
        for towards in (1, -1):
            # a wall on the side `towards` of each cell whose neighbour there is empty
            bare = step & ~np.roll(step, -towards, axis=0)
            at = np.argwhere(np.moveaxis(bare, 0, axis)) - 1
            at[:, axis] += towards > 0
            corners = []
            for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = at.copy()
                corner[:, ahead] += a
                corner[:, side] += b
                corners.append(np.ravel_multi_index(tuple(corner.T), shape))
            p, q, r, s = corners if towards > 0 else corners[::-1]
            faces.append(np.stack([p, q, r, p, r, s], axis=-1).reshape(-1, 3))
    every = np.concatenate(faces)
    used, index = np.unique(every, return_inverse=True)
    return Body(grid[used], index.reshape(-1, 3).astype(np.int64))


def ball(radius: float, n: int = 24) -> Body:
    """A ball about the origin, of n meridians and n / 2 bands."""
    latitude = np.pi * np.arange(1, n // 2) / (n // 2)
    ring = np.column_stack([np.sin(latitude), np.cos(latitude)])
    return _revolve(radius * ring, n, radius, -radius)


def drum(radius: float, height: float, n: int = 32) -> Body:
    """An upright cylinder on the plane z = 0."""
    return _revolve(np.array([[radius, height], [radius, 0.0]]), n, height, 0.0)


def _revolve(profile: Array, n: int, top: float, bottom: float) -> Body:
    """The surface of revolution about z of a profile (k, 2) of (r, z), from top to bottom."""
    angle = 2 * np.pi * np.arange(n) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    rings = [np.column_stack([r * circle, np.full(n, z)]) for r, z in profile]
    vertices = np.concatenate([*rings, [[0.0, 0.0, top], [0.0, 0.0, bottom]]])
    j = np.arange(n)
    after = (j + 1) % n
    last, north = (len(rings) - 1) * n, len(rings) * n
    faces = [np.stack([0 * j + north, j, after], axis=-1)]
    for k in range(len(rings) - 1):
        here, there = k * n, (k + 1) * n
        faces.append(np.stack([here + j, there + j, there + after], axis=-1))
        faces.append(np.stack([here + j, there + after, here + after], axis=-1))
    faces.append(np.stack([0 * j + north + 1, last + after, last + j], axis=-1))
    return Body(vertices, np.concatenate(faces).astype(np.int64))


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit
