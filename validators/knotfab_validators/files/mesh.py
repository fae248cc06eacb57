"""Read a part's surface from STL, OBJ, PLY or 3MF, as an indexed triangle mesh in mm.

The readers are this package's own: strangers' files are met here, so that every count is held
against the bytes there are before anything is allocated; and trimesh, which reads all of these, loads
manifold3d, the maker's library, with itself.
"""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np

from knotfab_validators.files.bad_file import MOST_TRIANGLES, BadFile
from knotfab_validators.files.obj import corners_obj, is_obj
from knotfab_validators.files.ply import corners_ply, is_ply
from knotfab_validators.files.stl import corners_stl, is_stl
from knotfab_validators.files.threemf import corners_3mf, is_3mf
from knotfab_validators.geometry.mesh import Corners, Mesh, merge_equal

__all__ = ["UNITS_MM", "read_mesh"]

from knotfab_validators.files.bad_file import MOST_MM, read_bytes

MOST_BYTES = 2_000_000_000
UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}


def read_mesh(path: Path, unit: str = "mm", notes: list[str] | None = None) -> Mesh:
    """The mesh of a file, all its bodies together; the content tells the format, then the name.

    A 3MF's objects are placed as its build items say, and its unit is brought to mm. The other
    formats know no unit: their numbers are of the given one (`UNITS_MM`).

    Args:
        notes: gets sentences about what was passed over.

    Raises:
        BadFile: the file cannot be read, holds no triangles, or coordinates that are not finite, or
            farther from the origin than `MOST_MM`.
    """
    content = read_bytes(path, MOST_BYTES).removeprefix(codecs.BOM_UTF8)
    told: list[str] = []
    corners = _corners(content, path, told)
    if unit != "mm" and is_3mf(content):
        told.append(f"{path.name}: a 3MF says its own unit; the one given is not used")
    elif unit != "mm":
        corners = UNITS_MM[unit] * corners.astype(np.float64)
    if notes is not None:
        notes += told
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


def _corners(content: bytes, path: Path, notes: list[str]) -> Corners:
    name = path.name
    if not content:
        raise BadFile(f"{name}: is empty")
    if is_3mf(content):
        return corners_3mf(content, name, notes)
    if is_ply(content):
        return corners_ply(content, name)
    if is_stl(content):
        return corners_stl(content, name, notes)
    if path.suffix.lower() == ".obj" or is_obj(content):
        return corners_obj(content, name)
    kind = path.suffix.lower().removeprefix(".")
    if kind in ("3mf", "ply"):
        raise BadFile(f"{name}: is not a {kind.upper()} file, or is damaged")
    if kind == "stl":
        return corners_stl(content, name, notes)  # says what is wrong with it
    raise BadFile(f"{name}: it is not an STL, OBJ, PLY or 3MF file")
