"""The straight edges of all centre lines together; an open one has no closing edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .read_knots import Curves

__all__ = ["CurveEdges", "curve_edges"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CurveEdges:
    """Edges from `start` to `end` (k, 3), mm, and the number (k,) of the curve each belongs to."""

    start: Array
    end: Array
    curve: NDArray[np.int64]

    def lengths_mm(self, curves: int) -> Array:
        """(curves,) length of each curve."""
        length = np.linalg.norm(self.end - self.start, axis=1)
        return np.asarray(np.bincount(self.curve, length, minlength=curves), dtype=np.float64)


def curve_edges(curves: Curves) -> CurveEdges:
    """The edges of all curves, in their order; a closed curve's last edge leads to its first point."""
    starts, ends, numbers = [], [], []
    for i, (polygon, closed) in enumerate(zip(curves.polygons, curves.closed, strict=True)):
        following = np.roll(polygon, -1, axis=0)
        count = len(polygon) if closed else len(polygon) - 1
        starts.append(polygon[:count])
        ends.append(following[:count])
        numbers.append(np.full(count, i, dtype=np.int64))
    return CurveEdges(np.concatenate(starts), np.concatenate(ends), np.concatenate(numbers))
