"""What damages a tube of the corpus: each function takes a body and gives it back with one fault."""

from collections.abc import Iterable

import numpy as np

from .curves import Array
from .parts import Body

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
