"""Winding numbers of an oriented linework in the plane, at pixel centres and at given points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.compiled import compiled

__all__ = ["Linework", "winding_at", "wound_mask"]


@dataclass(frozen=True)
class Linework:
    """Oriented straight edges whose winding numbers are well defined: their ends cancel.

    `start` and `end` are (n, 2), in pixels; `weight` (n,) counts how often an edge is run through.
    """

    start: Array
    end: Array
    weight: Ints


def _rising_edges(lines: Linework) -> tuple[Linework, Array]:
    """Return the edges that cross a row at all, turned so that y grows, and dx/dy of each."""
    up = lines.end[:, 1] < lines.start[:, 1]
    low = np.where(up[:, None], lines.end, lines.start)
    high = np.where(up[:, None], lines.start, lines.end)
    weight = np.where(up, -lines.weight, lines.weight)
    some = high[:, 1] > low[:, 1]
    low, high, weight = low[some], high[some], weight[some]
    slope = (high[:, 0] - low[:, 0]) / (high[:, 1] - low[:, 1])
    return Linework(low, high, weight), slope


def wound_mask(parts: Iterable[Linework], width: int, height: int) -> Mask:
    """Find where the winding number of all `parts` together is not 0, (height, width); pixel centres are
    integers.

    A scan line algorithm: each edge adds its weight to all pixels of a row that lie to the right
    of its crossing, by one entry and a running sum. An edge meets the rows of the half-open
    interval [y_low, y_high), so a vertex on a row counts once.
    """
    raster = np.zeros((height, width), dtype=np.int32)
    for lines in parts:
        start, end = (np.ascontiguousarray(x, dtype=np.float64) for x in (lines.start, lines.end))
        _add_edges(raster, start, end, np.ascontiguousarray(lines.weight, dtype=np.int64))
    return _find_wound(raster)


@compiled
def _add_edges(raster: NDArray[np.int32], start: Array, end: Array, weight: Ints) -> None:
    """Add each edge's weight to the first pixel right of it in each row that it crosses."""
    height, width = raster.shape
    for k in range(len(start)):
        low, high, turn = start[k], end[k], weight[k]
        if high[1] < low[1]:
            low, high, turn = end[k], start[k], -weight[k]
        if not high[1] > low[1]:
            continue
        slope = (high[0] - low[0]) / (high[1] - low[1])
        first = int(min(max(np.ceil(low[1]), 0.0), height))
        last = int(min(max(np.ceil(high[1]), 0.0), height))
        for row in range(first, last):
            column = max(np.ceil(low[0] + (row - low[1]) * slope), 0.0)
            if column < width:
                raster[row, int(column)] += turn


@compiled
def _find_wound(raster: NDArray[np.int32]) -> Mask:
    """Find where the running sum of a row is not 0."""
    height, width = raster.shape
    mask = np.zeros((height, width), dtype=np.bool_)
    for row in range(height):
        total = 0
        for column in range(width):
            total += raster[row, column]
            mask[row, column] = total != 0
    return mask


def winding_at(points: Array, lines: Linework) -> Ints:
    """Return winding numbers (m,) at points (m, 2); a tree over the edges finds those left of a point."""
    if len(points) == 0 or len(lines.start) == 0:
        return np.zeros(len(points), dtype=np.int64)
    edges, slope = _rising_edges(lines)
    left = float(np.minimum(edges.start[:, 0], edges.end[:, 0]).min()) - 1.0
    tree = shapely.STRtree(shapely.linestrings(np.stack([edges.start, edges.end], axis=1)))
    rays = shapely.linestrings(
        np.stack([np.column_stack([np.minimum(points[:, 0], left), points[:, 1]]), points], axis=1)
    )
    at, edge = tree.query(rays)
    x, y = points[at, 0], points[at, 1]
    hit = (
        (edges.start[edge, 1] <= y)
        & (y < edges.end[edge, 1])
        & (edges.start[edge, 0] + (y - edges.start[edge, 1]) * slope[edge] <= x)
    )
    sums = np.bincount(at[hit], edges.weight[edge[hit]], minlength=len(points))
    numbers: Ints = np.rint(sums).astype(np.int64)
    return numbers
