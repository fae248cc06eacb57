"""Winding numbers of an oriented linework in the plane, at pixel centres and at given points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.sampling import number_runs

__all__ = ["Linework", "winding_at", "winding_raster"]


@dataclass(frozen=True)
class Linework:
    """Oriented straight edges whose winding numbers are well defined: their ends cancel.

    `start` and `end` are (n, 2), in pixels; `weight` (n,) counts how often an edge is run through.
    """

    start: Array
    end: Array
    weight: Ints


def _rising_edges(lines: Linework) -> tuple[Linework, Array]:
    """The edges that cross a row at all, turned so that y grows, and dx/dy of each."""
    up = lines.end[:, 1] < lines.start[:, 1]
    low = np.where(up[:, None], lines.end, lines.start)
    high = np.where(up[:, None], lines.start, lines.end)
    weight = np.where(up, -lines.weight, lines.weight)
    some = high[:, 1] > low[:, 1]
    low, high, weight = low[some], high[some], weight[some]
    slope = (high[:, 0] - low[:, 0]) / (high[:, 1] - low[:, 1])
    return Linework(low, high, weight), slope


def winding_raster(lines: Linework, width: int, height: int) -> Ints:
    """Winding numbers (height, width) at the pixel centres, which lie at integers.

    A scan line algorithm: each edge adds its weight to all pixels of a row that lie to the right
    of its crossing, by one entry and a running sum. An edge meets the rows of the half-open
    interval [y_low, y_high), so a vertex on a row counts once.
    """
    edges, slope = _rising_edges(lines)
    first = np.clip(np.ceil(edges.start[:, 1]), 0, height).astype(np.int64)
    last = np.clip(np.ceil(edges.end[:, 1]), 0, height).astype(np.int64)
    count = last - first
    which, row = number_runs(count)
    row += first[which]
    x = edges.start[which, 0] + (row - edges.start[which, 1]) * slope[which]
    column = np.clip(np.ceil(x), 0, width).astype(np.int64)
    steps = np.bincount(
        row * (width + 1) + column, edges.weight[which], minlength=height * (width + 1)
    )
    raster: Ints = np.cumsum(
        np.rint(steps).astype(np.int64).reshape(height, width + 1)[:, :width], axis=1
    )
    return raster


def winding_at(points: Array, lines: Linework) -> Ints:
    """Winding numbers (m,) at points (m, 2); a tree over the edges finds those left of a point."""
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
