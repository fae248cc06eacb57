"""The triangles of a Wavefront OBJ file: `v` and `f` lines, polygons cut into fans."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .mesh import BadFile, Corners

__all__ = ["corners_obj", "is_obj"]

WORDS = frozenset(
    b"v vt vn vp f o g s l p mtllib usemtl #".split()  # what a line of a mesh begins with
)


def is_obj(content: bytes) -> bool:
    """Whether the first lines that say anything are those of an OBJ file."""
    head = [line.split(maxsplit=1)[0] for line in content[:4096].splitlines()[:-1] if line.split()]
    return bool(head) and all(word in WORDS or word.startswith(b"#") for word in head)


def corners_obj(content: bytes, name: str) -> Corners:
    """(m, 3, 3) corners of the faces; a polygon becomes a fan about its first corner.

    Indices count from 1, negative ones back from the vertex last read. Lines, points, normals and
    textures are passed over; units are not known to the format, and taken as mm.

    Raises:
        BadFile: a line is broken, or an index names no vertex; the message names the line.
    """
    points: list[bytes] = []
    fans: list[tuple[int, int, int]] = []
    line_of: list[int] = []
    for number, line in enumerate(content.replace(b"\\\n", b" ").splitlines(), start=1):
        words = line.split(b"#", 1)[0].split()
        if not words:
            continue
        if words[0] == b"v":
            if len(words) < 4:
                raise BadFile(f"{name}: line {number} is a vertex of {len(words) - 1} numbers")
            points += words[1:4]
        elif words[0] == b"f":
            corners = [_index(word, len(points) // 3, name, number) for word in words[1:]]
            if len(corners) < 3:
                raise BadFile(f"{name}: line {number} is a face of {len(corners)} corners")
            for b, c in pairwise(corners[1:]):
                fans.append((corners[0], b, c))
                line_of.append(number)
    try:
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise BadFile(f"{name}: has a vertex that is not three numbers") from error
    faces = np.array(fans, dtype=np.int64).reshape(-1, 3)
    outside = (faces >= len(vertices)).any(axis=1)
    if outside.any():
        first = int(outside.argmax())
        raise BadFile(
            f"{name}: line {line_of[first]} names vertex {int(faces[first].max()) + 1}, and there are "
            f"{len(vertices)}"
        )
    corners_of: Corners = vertices[faces]
    return corners_of


def _index(word: bytes, count: int, name: str, line: int) -> int:
    """The vertex (from 0) that `7`, `7/1`, `7//3` or `-1` names when `count` have been read."""
    try:
        index = int(word.split(b"/", 1)[0])
    except ValueError as error:
        raise BadFile(f"{name}: line {line} has a corner that is no index") from error
    if index == 0 or index < -count:
        raise BadFile(f"{name}: line {line} names vertex {index}, and there are {count} before it")
    if index > 2**62:
        raise BadFile(f"{name}: line {line} names a vertex that cannot be")
    return index - 1 if index > 0 else count + index
