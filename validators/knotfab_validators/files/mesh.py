"""Read a part's surface from STL, 3MF or plain arrays, as an indexed triangle mesh in mm.

The readers of STL and 3MF are this package's own: every count is held against the bytes there are before
anything is allocated. `knotfab validate` makes arrays of other formats, by libraries that the maker uses.
"""

from __future__ import annotations

import codecs
import io
import re
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.errors import short
from knotfab_validators.arrays import Array, Ints
from knotfab_validators.check import DECIMAL_COMMA, MOST_MM, MOST_TRIANGLES, BadFile, read_bytes
from knotfab_validators.files.threemf import corners_3mf, is_3mf
from knotfab_validators.geometry.mesh import Corners, Mesh, join_rounded, merge_equal, number_bodies

if TYPE_CHECKING:
    from knotfab_formats.scene import Scene

ROUNDING_MM = 1e-4  # a hundredth of what any printer resolves
MOST_BYTES = 2_000_000_000
UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}


def read_mesh(
    path: Path, unit: str = "mm", notes: list[str] | None = None, *, strict: bool = False
) -> Mesh:
    """Read all bodies of a file as one mesh. The content decides the format or, where it cannot, the name.

    A 3MF's objects are placed as its build items say, and converted to mm. The other formats carry no unit:
    their numbers are in `unit` (one of `UNITS_MM`).

    Args:
        notes: gets a sentence about each thing that was passed over.
        strict: refuse a 3MF that slicers read in different ways.

    Raises:
        BadFile: the file cannot be read, holds no triangles, or has coordinates that are not finite or lie
            farther from the origin than `MOST_MM`.
    """
    content = read_bytes(path, MOST_BYTES).removeprefix(codecs.BOM_UTF8)
    told: list[str] = []
    corners = _corners(content, path, told, strict)
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
    mesh, gap = join_rounded(merge_equal(corners), ROUNDING_MM)
    if gap and notes is not None:
        notes.append(
            f"{path.name}: corners up to {gap:.2g} mm apart were joined, as rounded numbers"
        )
    return mesh


def _corners(content: bytes, path: Path, notes: list[str], strict: bool) -> Corners:
    name = path.name
    if not content:
        raise BadFile(f"{name}: is empty")
    if is_3mf(content):
        return corners_3mf(content, name, notes, strict=strict)
    if content.startswith(np.lib.format.MAGIC_PREFIX):
        return _corners_plain(content, name)
    kind = path.suffix.lower().removeprefix(".")
    if is_stl(content) or kind == "stl":  # the STL reader says best what is wrong with an STL
        return corners_stl(content, name, notes)
    if content.startswith(b"glTF") or kind in ("glb", "gltf"):
        raise BadFile(
            f"{name}: it is glTF, a picture of a part to look at: name part.stl beside it"
        )
    if kind in ("3mf", "ply"):
        raise BadFile(f"{name}: is not a {kind.upper()} file, or is damaged")
    raise BadFile(f"{name}: it is not an STL or 3MF file, nor an OBJ or PLY that can be read")


def _corners_plain(content: bytes, name: str) -> Corners:
    """Read the corners (n, 3, 3) from numpy's own file format."""
    try:
        corners = np.load(io.BytesIO(content), allow_pickle=False)
    except Exception as error:  # numpy parses the header as Python, and may raise anything
        raise BadFile(f"{name}: holds no arrays ({short(error)})") from error
    if corners.dtype != np.float64 or corners.ndim != 3 or corners.shape[1:] != (3, 3):
        raise BadFile(f"{name}: holds no corners of triangles, (n, 3, 3) of doubles")
    return np.ascontiguousarray(corners)


# The plates on which the frame for several lamps is printed: 3MF files beside the scene.


@dataclass(frozen=True)
class Plate:
    """A plate: its whole mesh in its own print coordinates, and the motion of each body into the scene.

    `body` (n,) is the number of each vertex's body, in the order of their first faces; `to_part` (k, 4, 4)
    are the scene's motions. There may be more bodies than motions, or fewer.
    """

    name: str
    mesh: Mesh
    body: Ints
    to_part: Array

    @property
    def bodies(self) -> int:
        return int(self.body.max()) + 1

    def in_part(self, points: Array, body: Ints) -> Array:
        """Move points (n, 3) of the plate, which lie on the bodies (n,), to where they are in the scene."""
        motion = self.to_part[body.clip(max=len(self.to_part) - 1)]
        moved: Array = np.einsum("nij,nj->ni", motion[:, :3, :3], points) + motion[:, :3, 3]
        return moved


def read_table(folder: Path, scene: Scene) -> list[Plate]:
    """Read the plates of the frame that holds the lamps.

    Raises:
        BadFile: a plate cannot be read.
    """
    found = []
    for plate in scene.lamps.table:
        mesh = read_mesh(folder / plate.file)
        to_part = np.array(plate.matrices, dtype=np.float64)
        found.append(Plate(plate.file, mesh, number_bodies(mesh)[0], to_part))
    return found


# The triangles of an STL file, binary or text.

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
VERTEX = rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)\s+"
TEXT_FACET = re.compile(
    rb"\s*facet\s+normal(?:\s+\S+){3}\s+outer\s+loop\s+"
    + VERTEX * 3
    + rb"endloop\s+endfacet(?!\S)",
    re.IGNORECASE,
)
MOST_BEHIND = 65_536  # bytes
SOLID = re.compile(rb"\s*(end)?\s?solid(?!\w)[^\r\n]*", re.IGNORECASE)
END = re.compile(rb"[\s\0]*\Z")
BEGINNING = re.compile(rb"\s*(?:[#;][^\r\n]*\s+|//[^\r\n]*\s+)*solid(?!\w)", re.IGNORECASE)
COMMENT = re.compile(rb"\s*(?:#|;|//)[^\r\n]*")


def is_stl(content: bytes) -> bool:
    """Return whether the content is a binary STL of the right length, or begins like a text one."""
    return len(content) == _length(content) or _is_text(content)


def _is_text(content: bytes) -> bool:
    """Return whether it begins like a text STL; some programs write that word into binary headers, too."""
    return bool(BEGINNING.match(content)) and b"\0" not in content[:1000]


def _length(content: bytes) -> int:
    """Return the length that a binary STL with this header must have; -1 without a header.

    Some programs never fill the count in: where it is 0, whole triangles that follow count, as in slicers.
    """
    if len(content) < 84:
        return -1
    count = int.from_bytes(content[80:84], "little")
    uncounted = count == 0 and (len(content) - 84) % FACET.itemsize == 0
    return len(content) if uncounted else 84 + FACET.itemsize * count


def corners_stl(content: bytes, name: str, notes: list[str] | None = None) -> Corners:
    """Return (m, 3, 3) corners as stored: single precision when binary.

    The length decides before the first word, since some binary files begin with `solid` too. Up to
    `MOST_BEHIND` bytes behind a binary file's last triangle are ignored with a note, unless they
    would make up triangles: then the header's count is wrong.

    Raises:
        BadFile: it is not an STL, or is cut off.
    """
    if len(content) == _length(content):
        corners: Corners = np.frombuffer(content, dtype=FACET, offset=84)["corners"]
        if notes is not None and len(corners) and not any(content[80:84]):
            notes.append(f"{name}: its header counts no triangles; all {len(corners)} are read")
        return corners
    if _is_text(content):
        return _corners_text(content, name, notes)
    behind = len(content) - _length(content)
    if _length(content) > 84 and 0 < behind <= MOST_BEHIND and behind % FACET.itemsize:
        if notes is not None:
            bytes_were = "1 byte" if behind == 1 else f"{behind} bytes"
            notes.append(f"{name}: passed over {bytes_were} behind the last triangle")
        corners = np.frombuffer(content[:-behind], dtype=FACET, offset=84)["corners"]
        return corners
    if not content:
        raise BadFile(f"{name}: is empty")
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if count > 0 and len(content) - 84 > 50:
        raise BadFile(
            f"{name}: it is not an STL file, or is cut off: its header promises {count} triangles, "
            f"what follows is {(len(content) - 84) / 50:.6g}"
        )
    raise BadFile(f"{name}: it is not an STL file, or is cut off")


def _corners_text(content: bytes, name: str, notes: list[str] | None) -> Corners:
    """Parse the corners (m, 3, 3) of a text STL, in which several solids may follow each other."""
    numbers, at, inside = array("d"), 0, False
    while True:
        if facet := TEXT_FACET.match(content, at):
            try:
                numbers.extend(map(float, facet.groups()))
            except ValueError as error:
                if b"," in b"".join(facet.groups()):
                    raise BadFile(f"{name}: {DECIMAL_COMMA}") from error
                raise BadFile(f"{name}: has a corner that is not three numbers") from error
            if b"_" in facet.group():  # Python accepts 1_000 as a number; STL does not
                raise BadFile(f"{name}: has a corner that is not three numbers")
            at = facet.end()
        elif line := SOLID.match(content, at):
            inside, at = not line.group(1), line.end()
        elif line := COMMENT.match(content, at):
            at = line.end()
        else:
            break
    ended = bool(END.match(content, at))
    if inside and ended and numbers and notes is not None:
        notes.append(f"{name}: its last solid has no end (endsolid), and is read up to there")
    if not ended or (inside and not numbers):
        where = content.count(b"\n", 0, at) + 1
        raise BadFile(
            f"{name}: it is not an STL file, or is cut off: after line {where} comes neither a facet nor "
            "the end"
        )
    return np.frombuffer(numbers, dtype=np.float64).reshape(-1, 3, 3)
