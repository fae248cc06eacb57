"""Read a part's surface from STL, OBJ, PLY or 3MF, as an indexed triangle mesh in mm.

The readers are this package's own: strangers' files are met here, so that every count is held
against the bytes there are before anything is allocated; and trimesh, which reads all of these, loads
manifold3d, the maker's library, with itself.
"""

from __future__ import annotations

import stat
from pathlib import Path

import numpy as np

from .mesh import MOST_TRIANGLES, BadFile, Corners, Mesh, merge_equal
from .read_3mf import corners_3mf, is_3mf
from .read_obj import corners_obj, is_obj
from .read_ply import corners_ply, is_ply
from .read_stl import corners_stl, is_stl

__all__ = ["BadFile", "Mesh", "merge_equal", "read_bytes", "read_mesh"]

MOST_BYTES = 2_000_000_000
MOST_MM = 1e7
"""Ten kilometres: coordinates beyond are nonsense or another unit, and squares of squares overflow."""


def read_mesh(path: Path) -> Mesh:
    """The mesh of a file, all its bodies together; the content tells the format, then the name.

    A 3MF's objects are placed as its build items say, and its unit is brought to mm. The other
    formats know no unit: their numbers are mm.

    Raises:
        BadFile: the file cannot be read, holds no triangles, or coordinates that are not finite, or
            farther from the origin than `MOST_MM`.
    """
    content = read_bytes(path, MOST_BYTES)
    corners = _corners(content, path)
    if not len(corners):
        raise BadFile(f"{path.name}: holds no triangles")
    if len(corners) > MOST_TRIANGLES:
        raise BadFile(f"{path.name}: has {len(corners)} triangles, more than {MOST_TRIANGLES}")
    bad = ~np.isfinite(corners).all(axis=(1, 2))
    if bad.any():
        first = int(bad.argmax())
        raise BadFile(
            f"{path.name}: {int(bad.sum())} of {len(corners)} triangles have a corner that is not "
            f"finite, the first is number {first}"
        )
    far = float(np.abs(corners).max())
    if far > MOST_MM:
        raise BadFile(
            f"{path.name}: has coordinates as large as {far:.3g} mm; a part's are at most {MOST_MM:g}"
        )
    return merge_equal(corners)


def read_bytes(path: Path, most: int) -> bytes:
    """The content of a regular file of at most `most` bytes; anything else would hang or never end.

    Raises:
        BadFile: it is a folder, a device or a pipe, is too large, or cannot be read.
    """
    try:
        about = path.stat()
        if stat.S_ISDIR(about.st_mode):
            raise BadFile(f"{path.name}: is a folder, not a file")
        if not stat.S_ISREG(about.st_mode):
            raise BadFile(f"{path.name}: is not a plain file")
        if about.st_size > most:
            raise BadFile(f"{path.name}: is larger than {most / 1e6:.6g} MB")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        why = getattr(error, "strerror", None) or error
        raise BadFile(f"{path.name}: cannot be read ({why})") from error


def _corners(content: bytes, path: Path) -> Corners:
    name = path.name
    if not content:
        raise BadFile(f"{name}: is empty")
    if is_3mf(content):
        return corners_3mf(content, name)
    if is_ply(content):
        return corners_ply(content, name)
    if is_stl(content):
        return corners_stl(content, name)
    if path.suffix.lower() == ".obj" or is_obj(content):
        return corners_obj(content, name)
    kind = path.suffix.lower().removeprefix(".")
    if kind in ("3mf", "ply"):
        raise BadFile(f"{name}: is not a {kind.upper()} file, or is damaged")
    if kind == "stl":
        return corners_stl(content, name)  # says what is wrong with it
    raise BadFile(f"{name}: is not an STL, OBJ, PLY or 3MF file")
