"""Read a part's surface from STL (binary or text) or 3MF, as an indexed triangle mesh in mm."""

from __future__ import annotations

import io
import locale
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BadFile", "Mesh", "merge_equal", "read_mesh"]

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

MOST_BYTES = 2_000_000_000  # of a file, or of what a 3MF unpacks to
MOST_NAME = 1000  # bytes after the last `endsolid`
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
MM_PER_UNIT = (0.001, 1.0, 10.0, 25.4, 304.8, 1000.0)  # micrometre, mm, cm, inch, foot, metre


class BadFile(ValueError):
    """A file that cannot be read; the message is one sentence that names it."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in mm: `vertices` (n, 3) finite, `faces` (m, 3) indices, m >= 1.

    Corners at exactly equal coordinates are one vertex; nothing else is repaired.
    """

    vertices: Array
    faces: Faces


def read_mesh(path: Path) -> Mesh:
    """The mesh of an STL or 3MF file, all its bodies together.

    A 3MF's objects are placed as its build items say, and its unit is brought to mm.

    Raises:
        BadFile: the file cannot be read, holds no triangles, or coordinates that are not finite.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BadFile(f"{path.name}: is larger than {MOST_BYTES // 10**9} GB")
        content = path.read_bytes()
    except OSError as error:
        raise BadFile(f"{path.name}: cannot be read ({error.strerror})") from error
    if content[:4] == b"PK\x03\x04":
        corners = _corners_3mf(content, path.name)
    else:
        corners = _corners_stl(content, path.name)
    if not len(corners):
        raise BadFile(f"{path.name}: holds no triangles")
    bad = ~np.isfinite(corners).all(axis=(1, 2))
    if bad.any():
        first = int(bad.argmax())
        raise BadFile(
            f"{path.name}: {int(bad.sum())} of {len(corners)} triangles have a corner that is not "
            f"finite, the first is number {first}"
        )
    return merge_equal(corners)


def merge_equal(corners: NDArray[np.floating[Any]]) -> Mesh:
    """Index triangles (m, 3, 3) by their exactly equal corners (0.0 and -0.0 are equal).

    Two rounds of `np.unique` on whole numbers: first of (x, y), then of that pair and z.
    """
    flat = corners.reshape(-1, 3) + corners.dtype.type(0.0)
    number = [np.unique(flat[:, axis], return_inverse=True)[1] for axis in range(3)]
    count = len(flat)
    pair = np.unique(number[0] * np.int64(count) + number[1], return_inverse=True)[1]
    _, first, index = np.unique(
        pair * np.int64(count) + number[2], return_index=True, return_inverse=True
    )
    return Mesh(flat[first].astype(np.float64), index.reshape(-1, 3).astype(np.int64))


def _corners_stl(content: bytes, name: str) -> NDArray[np.floating[Any]]:
    """(m, 3, 3) corners as stored: single precision when binary.

    Read here rather than by trimesh, which loads manifold3d, the maker's library, with itself.
    """
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if len(content) == 84 + 50 * count:
        return np.frombuffer(content, dtype=STL_FACET, offset=84)["corners"]
    if content.lstrip()[:5].lower() == b"solid":
        return _corners_text(content, name)
    if not content:
        raise BadFile(f"{name}: is empty")
    if count > 0 and len(content) - 84 > 50:
        raise BadFile(
            f"{name}: is not an STL file, or is cut off: its header promises {count} triangles, "
            f"what follows is {(len(content) - 84) / 50:.6g}"
        )
    raise BadFile(f"{name}: is not an STL file, or is cut off")


def _corners_text(content: bytes, name: str) -> NDArray[np.floating[Any]]:
    """(m, 3, 3) corners of an STL file of words: three `vertex x y z` to each `facet`."""
    text = content.lower()
    found = re.findall(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
    facets = len(re.findall(rb"\bfacet\s+normal\b", text))
    if len(found) != 3 * facets or b"endsolid" not in text[-MOST_NAME:]:
        raise BadFile(f"{name}: is not an STL file, or is cut off")
    try:
        return np.array(found, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise BadFile(f"{name}: has a corner that is not three numbers") from error


def _corners_3mf(content: bytes, name: str) -> NDArray[np.floating[Any]]:
    """(m, 3, 3) corners of all build items, mm."""
    import lib3mf

    before = locale.setlocale(locale.LC_ALL)  # lib3mf sets it to "C", where text files are ASCII
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MOST_BYTES:
                raise BadFile(f"{name}: unpacks to more than {MOST_BYTES // 10**9} GB")
        model = lib3mf.get_wrapper().CreateModel()
        model.QueryReader("3mf").ReadFromBuffer(content)
        scale = MM_PER_UNIT[int(model.GetUnit())]
        merged = model.MergeToModel()  # one mesh per build item, transforms applied
        objects = merged.GetMeshObjects()
        parts: list[NDArray[np.floating[Any]]] = [np.empty((0, 3, 3))]
        while objects.MoveNext():
            body = objects.GetCurrentMeshObject()
            n, m = body.GetVertexCount(), body.GetTriangleCount()
            points = (lib3mf.Position * n)(*body.GetVertices())
            corners = (lib3mf.Triangle * m)(*body.GetTriangleIndices())
            vertices = np.frombuffer(points, dtype=np.float32).reshape(n, 3)
            faces = np.frombuffer(corners, dtype=np.uint32).reshape(m, 3)
            parts.append(vertices[faces] * scale)
    except BadFile:
        raise
    except Exception as error:  # a parser that meets garbage may raise anything
        raise BadFile(f"{name}: is not a 3MF file, or is damaged") from error
    finally:
        locale.setlocale(locale.LC_ALL, before)
    return np.concatenate(parts)
