"""Read a part's surface from STL, 3MF or plain arrays, as an indexed triangle mesh in mm.

The readers of STL and 3MF are this package's own: every count is held against the bytes there are before
anything is allocated. `knotfab validate` makes arrays of other formats, by libraries that the maker uses.
"""

from __future__ import annotations

import codecs
import io
from pathlib import Path

import numpy as np

from knotfab_validators.files.bad_file import MOST_MM, MOST_TRIANGLES, BadFile, read_bytes, short
from knotfab_validators.files.stl import corners_stl, is_stl
from knotfab_validators.files.threemf import corners_3mf, is_3mf
from knotfab_validators.geometry.mesh import Corners, Mesh, merge_equal

__all__ = ["UNITS_MM", "read_mesh"]

MOST_BYTES = 2_000_000_000
UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}


def read_mesh(path: Path, unit: str = "mm", notes: list[str] | None = None) -> Mesh:
    """Read the mesh of a file, all its bodies together; the content tells the format, then the name.

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
    if content.startswith(np.lib.format.MAGIC_PREFIX):
        return _corners_plain(content, name)
    kind = path.suffix.lower().removeprefix(".")
    if is_stl(content) or kind == "stl":  # this says what is wrong with an STL
        return corners_stl(content, name, notes)
    if kind in ("3mf", "ply"):
        raise BadFile(f"{name}: is not a {kind.upper()} file, or is damaged")
    raise BadFile(f"{name}: it is not an STL or 3MF file, nor an OBJ or PLY that can be read")


def _corners_plain(content: bytes, name: str) -> Corners:
    """Return the corners (n, 3, 3) that numpy's own format holds."""
    try:
        corners = np.load(io.BytesIO(content), allow_pickle=False)
    except Exception as error:  # numpy reads the header as Python, and raises what that raises
        raise BadFile(f"{name}: holds no arrays ({short(error)})") from error
    if corners.dtype != np.float64 or corners.ndim != 3 or corners.shape[1:] != (3, 3):
        raise BadFile(f"{name}: holds no corners of triangles, (n, 3, 3) of doubles")
    return np.ascontiguousarray(corners)
