"""The triangles of an STL file, binary or text."""

from __future__ import annotations

import re

import numpy as np

from .mesh import BadFile, Corners

__all__ = ["corners_stl", "is_stl"]

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
MOST_NAME = 1000  # bytes after the last `endsolid`


def is_stl(content: bytes) -> bool:
    """Whether the content is a binary STL of the right length, or begins as one of text."""
    return len(content) == _length(content) or content.lstrip()[:5].lower() == b"solid"


def _length(content: bytes) -> int:
    """How long a binary STL with this header is; -1 without a header."""
    return (
        84 + FACET.itemsize * int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    )


def corners_stl(content: bytes, name: str) -> Corners:
    """(m, 3, 3) corners as stored: single precision when binary.

    The length decides before the first word, since some binary files begin with `solid` too.

    Raises:
        BadFile: it is no STL, or is cut off.
    """
    if len(content) == _length(content):
        corners: Corners = np.frombuffer(content, dtype=FACET, offset=84)["corners"]
        return corners
    if content.lstrip()[:5].lower() == b"solid":
        return _corners_text(content, name)
    if not content:
        raise BadFile(f"{name}: is empty")
    count = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if count > 0 and len(content) - 84 > 50:
        raise BadFile(
            f"{name}: is not an STL file, or is cut off: its header promises {count} triangles, "
            f"what follows is {(len(content) - 84) / 50:.6g}"
        )
    raise BadFile(f"{name}: is not an STL file, or is cut off")


def _corners_text(content: bytes, name: str) -> Corners:
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
