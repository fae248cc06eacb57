"""A part's surface as an indexed triangle mesh, and the error of a file that holds none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BadFile", "Corners", "Mesh", "merge_equal"]

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
Corners = NDArray[np.floating[Any]]
"""(m, 3, 3) the corners of triangles, each with coordinates of its own, as a file gives them."""


class BadFile(ValueError):
    """A file that cannot be read; the message is one sentence that names it."""


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
