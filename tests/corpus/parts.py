"""Bodies made without the maker: tubes, blocks, balls and drums, and what damages them by one fault."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


SIDES = 24  # sides of the tubes that are damaged
RING, SIDE = 10, 5  # where most of the damage is done
FACE = 2 * (RING * SIDES + SIDE)


def flip(body: Body, faces: Iterable[int]) -> Body:
    turned = body.faces.copy()
    chosen = list(faces)
    turned[chosen] = turned[chosen, ::-1]
    return Body(body.vertices, turned)


def repeat_faces(body: Body, faces: Iterable[int]) -> Body:
    return Body(body.vertices, np.concatenate([body.faces, body.faces[list(faces)]]))


def add_back(body: Body) -> Body:
    """A face of which there is another copy, wound the other way."""
    return Body(body.vertices, np.concatenate([body.faces, body.faces[FACE : FACE + 1, ::-1]]))


def unmerge(body: Body) -> Body:
    """One face has a corner of its own, 1e-4 mm from where it was."""
    faces, corner = body.faces.copy(), body.vertices[body.faces[FACE, 0]] + [0.0, 0.0, 1e-4]
    faces[FACE, 0] = len(body.vertices)
    return Body(np.concatenate([body.vertices, corner[None]]), faces)


def t_junction(body: Body) -> Body:
    """A face cut in two at the middle of an edge; its neighbour keeps the edge whole."""
    a, b, c = body.faces[FACE]
    middle = (body.vertices[a] + body.vertices[b]) / 2
    m = len(body.vertices)
    halves = np.array([[a, m, c], [m, b, c]])
    faces = np.concatenate([np.delete(body.faces, FACE, axis=0), halves])
    return Body(np.concatenate([body.vertices, middle[None]]), faces)


def fin(body: Body) -> Body:
    """A third face on an edge."""
    a, b, _ = body.faces[FACE]
    out = body.vertices[a] + 0.5 * (body.vertices[a] - _centres(body)[RING])
    vertices = np.concatenate([body.vertices, out[None]])
    return Body(vertices, np.concatenate([body.faces, [[a, b, len(body.vertices)]]]))


def collapse(body: Body) -> Body:
    vertices = body.vertices.copy()
    vertices[body.faces[FACE, 0]] = vertices[body.faces[FACE, 1]]
    return Body(vertices, body.faces)


def needle(body: Body) -> Body:
    """An edge with a vertex on it that only a face without area uses: closed, but degenerate."""
    a, b, c = (int(v) for v in body.faces[FACE])
    vertices = np.concatenate([body.vertices, [(body.vertices[a] + body.vertices[b]) / 2]])
    rounded = vertices.astype(np.float32).astype(np.float64)
    # in single precision the middle lies on the line only where all coordinates allow it
    rounded[[a, b]] = np.round(rounded[[a, b]] * 64) / 64
    rounded[-1] = (rounded[a] + rounded[b]) / 2
    m = len(body.vertices)
    halves = np.array([[a, m, c], [m, b, c], [a, b, m]])
    return Body(rounded, np.concatenate([np.delete(body.faces, FACE, axis=0), halves]))


def repeat_corner(body: Body) -> Body:
    a, b, _ = body.faces[FACE]
    return Body(body.vertices, np.concatenate([body.faces, [[a, b, b]]]))


def handle(body: Body) -> Body:
    """A four-sided bar from one side of the ring's inside to the other."""
    middle = body.vertices.mean(axis=0)
    rings = body.vertices.reshape(-1, SIDES, 3)
    quads = rings[:, [*range(1, SIDES), 0]] + rings
    inner = np.linalg.norm((quads / 2 - middle)[..., :2], axis=2).argmin(axis=1)
    n = len(rings)
    ends = []
    for ring in (0, n // 2):
        side = int(inner[ring])
        after = (side + 1) % SIDES
        here, there = ring * SIDES, (ring + 1) % n * SIDES
        ends.append([here + side, there + side, there + after, here + after])
    one, other = ends
    gone = [2 * (r * SIDES + int(inner[r])) + k for r in (0, n // 2) for k in (0, 1)]
    # seen from one end the corners of the other run the other way round; the shortest bar is straight
    turns = [[other[(turn - k) % 4] for k in range(4)] for turn in range(4)]
    pairs = min(turns, key=lambda t: float(np.linalg.norm(body.vertices[one] - body.vertices[t])))
    bar = []
    for k in range(4):
        p, q, r, s = one[k], one[(k + 1) % 4], pairs[(k + 1) % 4], pairs[k]
        bar += [[p, s, r], [p, r, q]]
    return Body(body.vertices, np.concatenate([np.delete(body.faces, gone, axis=0), bar]))


def cut_and_cap(body: Body, rings: int = 1) -> Body:
    """`rings` rings of faces taken out, and both ends closed by a fan."""
    far = RING + rings
    kept = np.delete(body.faces, range(2 * RING * SIDES, 2 * far * SIDES), axis=0)
    n = len(body.vertices)
    ends = body.vertices.reshape(-1, SIDES, 3)[[RING, far]].mean(axis=1)
    j = np.arange(SIDES)
    after = (j + 1) % SIDES
    first = np.stack([0 * j + n, RING * SIDES + j, RING * SIDES + after], axis=-1)
    last = np.stack([0 * j + n + 1, far * SIDES + after, far * SIDES + j], axis=-1)
    return Body(np.concatenate([body.vertices, ends]), np.concatenate([kept, first, last]))


def spike(body: Body) -> Body:
    vertices = body.vertices.copy()
    at = RING * SIDES + SIDE
    vertices[at] += 2.4 * (_centres(body)[RING] - vertices[at])
    return Body(vertices, body.faces)


def dent(body: Body, by: float) -> Body:
    """The surface about one place of ring 10 moved along its normals by up to `by` mm."""
    centre: Array = np.repeat(_centres(body), SIDES, axis=0)
    out = body.vertices - centre
    out /= np.linalg.norm(out, axis=1)[:, None]
    off = np.linalg.norm(body.vertices - body.vertices[RING * SIDES + SIDE], axis=1)
    return Body(body.vertices + (by * np.exp(-((off / 1.5) ** 2)))[:, None] * out, body.faces)


def _centres(body: Body) -> Array:
    """(n, 3) the middle of each ring of a bare tube."""
    middles: Array = body.vertices.reshape(-1, SIDES, 3).mean(axis=1)
    return middles
