"""Even samples of closed polylines."""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Array

__all__ = ["arc_lengths", "sample_evenly"]


def arc_lengths(points: Array) -> Array:
    """(n + 1,) arc length at each vertex of a closed polyline (n, k), the whole length last."""
    edges = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    return np.concatenate([[0.0], np.cumsum(edges)])


def sample_evenly(points: Array, step: float, *, at_most: bool = False, fewest: int = 8) -> Array:
    """Points at equal distances along a closed polyline, from its first vertex on.

    Args:
        points: (n, k), the first not repeated.
        step: the distance wanted; the one taken divides the whole length.
        at_most: never farther apart than `step`; otherwise as near to it as can be.
        fewest: points, however short the polyline.

    Returns:
        (m, k), m at least `fewest`.
    """
    arc = arc_lengths(points)
    pieces = arc[-1] / step
    count = max(fewest, int(np.ceil(pieces)) if at_most else round(pieces))
    at = np.arange(count) * (arc[-1] / count)
    closed = np.concatenate([points, points[:1]])
    return np.stack([np.interp(at, arc, column) for column in closed.T], axis=1)
