"""Read a part's surface from STL, OBJ, PLY or 3MF, as an indexed triangle mesh in mm.

The readers are this package's own: strangers' files are met here, so that every count is held
against the bytes there are before anything is allocated; and trimesh, which reads all of these, loads
manifold3d, the maker's library, with itself.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from knotfab_validators.files.bad_file import MOST_TRIANGLES, BadFile
from knotfab_validators.files.obj import corners_obj, is_obj
from knotfab_validators.files.ply import corners_ply, is_ply
from knotfab_validators.files.stl import corners_stl, is_stl
from knotfab_validators.files.threemf import corners_3mf, is_3mf
from knotfab_validators.geometry.mesh import Corners, Mesh, merge_equal

__all__ = ["read_mesh"]

from knotfab_validators.files.bad_file import MOST_MM, read_bytes

MOST_BYTES = 2_000_000_000


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
    raise BadFile(f"{name}: it is not an STL, OBJ, PLY or 3MF file")
