"""A part's surface as an indexed triangle mesh, and what all readers refuse files with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_TRIANGLES", "BadFile", "Corners", "Mesh", "merge_equal", "short"]

MOST_TRIANGLES = 20_000_000
"""Of one file: more would not fit the memory of the machines that the checks are meant for."""

MOST_SHOWN = 80  # characters of what a file says, in a sentence about it

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
Corners = NDArray[np.floating[Any]]
"""(m, 3, 3) the corners of triangles, each with coordinates of its own, as a file gives them."""


class BadFile(ValueError):
    """A file that cannot be read; the message is one sentence that names it."""


def short(thing: object) -> str:
    """What a file says, as it is shown in a sentence: on one line, and cut where it is long."""
    try:
        text = thing if isinstance(thing, str) else str(thing)
    except (ValueError, RecursionError):  # a number of thousands of digits; lists in lists
        return "something too long to be shown"
    shown = text[: MOST_SHOWN + 1]
    shown = "".join(c if c.isprintable() else "?" for c in shown)
    return shown if len(text) <= MOST_SHOWN else shown[:MOST_SHOWN] + "..."


@dataclass(frozen=True)
class Mesh:
    """Triangles in mm: `vertices` (n, 3) finite, `faces` (m, 3) indices, m >= 1.

    Corners at exactly equal coordinates are one vertex; nothing else is repaired: faces with a
    repeated corner, and equal faces, stay.
    """

    vertices: Array
    faces: Faces


def merge_equal(corners: Corners) -> Mesh:
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
