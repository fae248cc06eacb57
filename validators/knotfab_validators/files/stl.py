"""The triangles of an STL file, binary or text."""

from __future__ import annotations

import re
from array import array

import numpy as np

from knotfab_validators.files.bad_file import DECIMAL_COMMA, BadFile
from knotfab_validators.geometry.mesh import Corners

__all__ = ["corners_stl", "is_stl"]

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
END = re.compile(rb"\s*\Z")


def is_stl(content: bytes) -> bool:
    """Tell whether the content is a binary STL of the right length, or begins as one of text."""
    return len(content) == _length(content) or _is_text(content)


def _is_text(content: bytes) -> bool:
    """Tell whether it begins as text; some programs write the word into a binary file's header too."""
    return content.lstrip()[:5].lower() == b"solid" and b"\0" not in content[:1000]


def _length(content: bytes) -> int:
    """Return the length of a binary STL with this header; -1 without a header."""
    return (
        84 + FACET.itemsize * int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    )


def corners_stl(content: bytes, name: str, notes: list[str] | None = None) -> Corners:
    """Return (m, 3, 3) corners as stored: single precision when binary.

    The length decides before the first word, since some binary files begin with `solid` too. Up to
    `MOST_BEHIND` bytes behind a binary file's last triangle are no triangles, and are passed over with a
    note, unless they are as long as some: then the header's count is wrong.

    Raises:
        BadFile: it is no STL, or is cut off.
    """
    if len(content) == _length(content):
        corners: Corners = np.frombuffer(content, dtype=FACET, offset=84)["corners"]
        return corners
    if _is_text(content):
        return _corners_text(content, name)
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


def _corners_text(content: bytes, name: str) -> Corners:
    """Return (m, 3, 3) corners of an STL file of words; several solids may follow each other."""
    numbers, at, inside = array("d"), 0, False
    while True:
        if facet := TEXT_FACET.match(content, at):
            try:
                numbers.extend(map(float, facet.groups()))
            except ValueError as error:
                if b"," in b"".join(facet.groups()):
                    raise BadFile(f"{name}: {DECIMAL_COMMA}") from error
                raise BadFile(f"{name}: has a corner that is not three numbers") from error
            if b"_" in facet.group():  # Python's own way of writing numbers
                raise BadFile(f"{name}: has a corner that is not three numbers")
            at = facet.end()
        elif line := SOLID.match(content, at):
            inside, at = not line.group(1), line.end()
        else:
            break
    if inside or not END.match(content, at):
        where = content.count(b"\n", 0, at) + 1
        raise BadFile(
            f"{name}: it is not an STL file, or is cut off: after line {where} comes neither a facet nor "
            "the end"
        )
    return np.frombuffer(numbers, dtype=np.float64).reshape(-1, 3, 3)
