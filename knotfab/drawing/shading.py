"""A mesh drawn by a compiled depth buffer: which pixels it covers, and how its surface lies there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.base.compiled import compiled

__all__ = ["draw_faces"]


@compiled
def draw_faces(
    places: Array, normals: Array, faces: NDArray[np.int64], pixels: int
) -> tuple[NDArray[np.bool_], Array]:
    """Draw triangles into a square of `pixels`; at each pixel's centre the one nearest to the eye is kept.

    Args:
        places: (n, 3): column and row, in pixels from the upper left corner, and what is larger the nearer
            a point is and linear on the page: the inverse of its distance, times any constant.
        normals: (n, 3) at the points.
        faces: (m, 3).

    Returns:
        (pixels, pixels) whether there is a face, and (pixels, pixels, 3) the normal there, between those of
        its corners as they are seen, which is not quite as they lie; not of unit length.
    """
    found = np.zeros((pixels, pixels), dtype=np.bool_)
    depth = np.zeros((pixels, pixels))
    normal = np.zeros((pixels, pixels, 3))
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, bx, by = places[a, 0], places[a, 1], places[b, 0], places[b, 1]
        cx, cy = places[c, 0], places[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        top, bottom = min(ay, by, cy), max(ay, by, cy)
        # the centre of pixel k is at k + 0.5
        for row in range(max(0, math.ceil(top - 0.5)), min(pixels, math.floor(bottom - 0.5) + 1)):
            y = row + 0.5
            for column in range(
                max(0, math.ceil(left - 0.5)), min(pixels, math.floor(right - 0.5) + 1)
            ):
                x = column + 0.5
                of_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                of_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                of_c = 1.0 - of_a - of_b
                if of_a < 0.0 or of_b < 0.0 or of_c < 0.0:
                    continue
                near = of_a * places[a, 2] + of_b * places[b, 2] + of_c * places[c, 2]
                if near <= depth[row, column]:
                    continue
                found[row, column] = True
                depth[row, column] = near
                for k in range(3):
                    normal[row, column, k] = (
                        of_a * normals[a, k] + of_b * normals[b, k] + of_c * normals[c, k]
                    )
    return found, normal
