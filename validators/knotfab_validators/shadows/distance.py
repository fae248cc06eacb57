"""Exact distances on a grid of pixels, by compiled loops."""

from __future__ import annotations

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.compiled import compiled

__all__ = ["depth_in"]


def depth_in(mask: Mask) -> Array:
    """Return (H, W) the distance of each pixel of a mask to the nearest one outside it, 0 outside; pixels.

    The diagonal of the grid where nothing is outside.
    """
    if mask.all():
        return np.full(mask.shape, float(np.hypot(*mask.shape)))
    return np.asarray(np.sqrt(_square_depth(np.ascontiguousarray(mask))))


@compiled
def _square_depth(mask: Mask) -> Array:
    """Square the distances: in each column first, then by the lower envelope of parabolas in each row.

    A. Meijster, J. B. T. M. Roerdink and W. H. Hesselink, "A general algorithm for computing distance
    transforms in linear time", 2000; all in whole numbers.
    """
    height, width = mask.shape
    far = height + width
    down = np.empty((height, width), dtype=np.int64)
    for x in range(width):
        down[0, x] = far if mask[0, x] else 0
    for y in range(1, height):
        for x in range(width):
            down[y, x] = min(down[y - 1, x] + 1, far) if mask[y, x] else 0
    for y in range(height - 2, -1, -1):
        for x in range(width):
            down[y, x] = min(down[y, x], down[y + 1, x] + 1)
    squares = np.zeros((height, width))
    apex, begins = np.empty(width, dtype=np.int64), np.empty(width, dtype=np.int64)
    for y in range(height):
        g, end = down[y], 0
        while end < width:
            if g[end] == 0:
                end += 1
                continue
            # a run of the mask is nearer to the pixels beside it than all others are
            begin = max(end - 1, 0)
            while end < width and g[end] > 0:
                end += 1
            stop, last = min(end + 1, width), 0
            apex[0], begins[0] = begin, begin
            for x in range(begin + 1, stop):
                while last >= 0:
                    at, old = begins[last], apex[last]
                    if (at - old) ** 2 + g[old] ** 2 <= (at - x) ** 2 + g[x] ** 2:
                        break
                    last -= 1
                if last < 0:
                    last, apex[0], begins[0] = 0, x, begin
                    continue
                old = apex[last]
                meet = 1 + (x * x - old * old + g[x] ** 2 - g[old] ** 2) // (2 * (x - old))
                if meet < stop:
                    last += 1
                    apex[last], begins[last] = x, meet
            for x in range(stop - 1, begin - 1, -1):
                squares[y, x] = (x - apex[last]) ** 2 + g[apex[last]] ** 2
                if x == begins[last]:
                    last -= 1
    return squares
