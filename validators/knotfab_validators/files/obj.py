"""The triangles of a Wavefront OBJ file: `v` and `f` lines, polygons cut into triangles."""

from __future__ import annotations

import re
from array import array
from itertools import pairwise

import numpy as np

from knotfab_validators.arrays import Ints
from knotfab_validators.files.bad_file import DECIMAL_COMMA, MOST_TRIANGLES, BadFile, short
from knotfab_validators.geometry.ears import cut_polygon
from knotfab_validators.geometry.mesh import Corners

__all__ = ["corners_obj", "is_obj"]

SHAPELESS = frozenset(  # statements without a surface; lines and points have none
    b"vt vn vp g s o mg l p usemtl mtllib usemap maplib bevel c_interp d_interp lod "
    b"shadow_obj trace_obj".split()
)
SURFACES = frozenset(  # a shape that is not read: it must not be passed over in silence
    b"cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech call csh "
    b"bzp bsp cdc cdp res fo".split()
)
LINE = re.compile(rb"\S[^\r\n]*")
CONTINUED = re.compile(rb"\\\r?\n")
CORNER = re.compile(rb"([+-]?\d+)(?:/(?:-?\d+)?){0,2}")
FOLDED = 1e-9  # a share of a polygon's area squared
MOST_WORK = 20_000_000  # corners times corners of concave polygons
MOST_CORNERS = 10_000  # corners of one face
MOST_DIGITS = 18


def is_obj(content: bytes) -> bool:
    """Tell whether the first lines that say anything are those of an OBJ file."""
    head = [line.split(maxsplit=1)[0] for line in content[:4096].splitlines()[:-1] if line.split()]
    known = SHAPELESS | {b"v", b"f"}
    return bool(head) and all(word in known or word.startswith(b"#") for word in head)


def corners_obj(content: bytes, name: str) -> Corners:
    """(m, 3, 3) corners of the faces; a polygon becomes a fan, a concave one other triangles.

    Indices count from 1, negative ones back from the vertex last read; one may name a vertex that
    comes later in the file. Lines, points, normals and textures are passed over, other files that
    it names are not opened; units are not known to the format, and taken as mm.

    Raises:
        BadFile: a line is broken, an index names no vertex, or there are curved surfaces; the
            message names the line.
    """
    # blanks as many as the text that they replace, so that places in the file stay as they are
    text = CONTINUED.sub(lambda found: b" " * len(found.group()), content)
    points, fans, places = array("d"), array("q"), array("q")
    try:
        for found in LINE.finditer(text):
            line = found.group()
            words = (line.partition(b"#")[0] if b"#" in line else line).split()
            if not words:
                continue
            if words[0] == b"v":
                if len(words) != 4 or b"_" in line:
                    points.extend(_vertex(words))
                    continue
                try:
                    points.extend((float(words[1]), float(words[2]), float(words[3])))
                except ValueError:
                    _vertex(words)
            elif words[0] == b"f":
                corners = _polygon(words, len(points) // 3)
                for b, c in pairwise(corners[1:]):
                    fans.extend((corners[0], b, c))
                    places.append(found.start())
                if len(places) > MOST_TRIANGLES:
                    raise _Wrong(f"makes them more than {MOST_TRIANGLES} triangles")
            elif words[0] not in SHAPELESS:
                shown = short(words[0].decode("latin-1"))
                kind = "a curved surface" if words[0] in SURFACES else "no word of this format"
                raise _Wrong(f"begins with {shown}, {kind}")
    except _Wrong as error:
        raise BadFile(f"{name}: line {_number(content, found.start())} {error}") from error
    vertices = np.frombuffer(points, dtype=np.float64).reshape(-1, 3)
    faces = np.frombuffer(fans, dtype=np.int64).reshape(-1, 3)
    outside = (faces >= len(vertices)).any(axis=1)
    if outside.any():
        first = int(outside.argmax())
        raise BadFile(
            f"{name}: line {_number(content, places[first])} names vertex "
            f"{int(faces[first].max()) + 1}, and there are {len(vertices)}"
        )
    return _cut_concave(vertices[faces], faces, np.frombuffer(places, dtype=np.int64), name)


def _cut_concave(corners: Corners, faces: Ints, places: Ints, name: str) -> Corners:
    """(m, 3, 3) corners, with other triangles in place of a fan that folds back: its polygon is concave.

    A polygon that crosses itself may keep its fan; checks of the surface see that it crosses.

    Args:
        faces: (m, 3) fans, each of the line at one of `places` (m,).
    """
    first = np.flatnonzero(np.diff(places, prepend=-1))
    if len(first) == len(faces) or not np.isfinite(corners).all():
        return corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    which = np.repeat(np.arange(len(first)), np.diff(first, append=len(faces)))
    whole = np.add.reduceat(normal, first, axis=0)
    folded = np.einsum("ij,ij->i", normal, whole[which])
    folds = folded < -FOLDED * np.einsum("ij,ij->i", whole, whole)[which]
    work = 0
    for polygon in np.unique(which[folds]):
        own = np.flatnonzero(which == polygon)
        # every corner once: the first triangle's, and of each more its last
        ring = np.concatenate([corners[own[0]], corners[own[1:], 2]])
        work += len(ring) ** 2
        if work > MOST_WORK:
            raise BadFile(
                f"{name}: its concave polygons have too many corners to be cut into triangles"
            )
        if (cut := cut_polygon(ring)) is not None:
            corners[own] = ring[cut]
    return corners


class _Wrong(ValueError):
    """What is wrong with a line."""


def _number(content: bytes, place: int) -> int:
    """The number of the line that a place of the file is in, from 1."""
    return max(content.count(b"\n", 0, place), content.count(b"\r", 0, place)) + 1


def _vertex(words: list[bytes]) -> list[float]:
    """x, y and z; a weight or a colour may follow."""
    if not 4 <= len(words) <= 8:
        raise _Wrong(f"is a vertex of {len(words) - 1} numbers")
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError as error:
        if any(b"," in word for word in words):
            raise _Wrong(f"is a vertex: {DECIMAL_COMMA}") from error
        raise _Wrong("is a vertex that is not three numbers") from error
    if any(b"_" in word for word in words):  # Python's own way of writing numbers
        raise _Wrong("is a vertex that is not three numbers")
    return numbers[:3]


def _polygon(words: list[bytes], count: int) -> list[int]:
    """The vertices (from 0) of a face, when `count` have been read."""
    if not 4 <= len(words) <= MOST_CORNERS + 1:
        raise _Wrong(f"is a face of {len(words) - 1} corners")
    try:  # plain numbers are most there is
        corners = [int(word) - 1 for word in words[1:]]
    except ValueError:
        corners = [-1]
    if min(corners) < 0 or max(corners) > 10**MOST_DIGITS or any(b"_" in word for word in words):
        return [_index(word, count) for word in words[1:]]
    return corners


def _index(word: bytes, count: int) -> int:
    """The vertex (from 0) that `7`, `7/1`, `7//3` or `-1` names when `count` have been read."""
    found = CORNER.fullmatch(word)
    if found is None:
        raise _Wrong(f"has a corner that is no index, {short(word.decode('latin-1'))}")
    if len(found.group(1)) > MOST_DIGITS:
        raise _Wrong("names a vertex that cannot be")
    index = int(found.group(1))
    if index == 0 or index < -count:
        raise _Wrong(f"names vertex {index}, and there are {count} before it")
    return index - 1 if index > 0 else count + index
