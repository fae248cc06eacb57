"""Even samples of closed polylines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array, Indices

__all__ = ["arc_lengths", "number_runs", "pair_nearby", "sample_evenly"]


def arc_lengths(points: Array, *, closed: bool = True) -> Array:
    """Return (n + 1,) arc length at each vertex of a polyline (n, k), the whole last; (n,) of an open one."""
    steps = np.diff(points, axis=0, append=points[:1]) if closed else np.diff(points, axis=0)
    edges = np.linalg.norm(steps, axis=1)
    return np.concatenate([[0.0], np.cumsum(edges)])


def sample_evenly(points: Array, step: float, *, at_most: bool = False, fewest: int = 8) -> Array:
    """Return points at equal distances along a closed polyline, from its first vertex on.

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


def number_runs(counts: Indices) -> tuple[Indices, Indices]:
    """Number the members of runs of lengths (n,): the run that each belongs to, and its number there."""
    run = np.repeat(np.arange(len(counts)), counts)
    return run, np.arange(len(run)) - np.repeat(np.cumsum(counts) - counts, counts)


def pair_nearby(curves: Sequence[Array], reach: float) -> tuple[Indices, Array]:
    """Return (m, 2) pairs of points closer than `reach`, and (m,) how far apart they are along their curve.

    Args:
        curves: closed polylines [(n, k)], whose points are numbered one after the other.

    Returns:
        The pairs, and the shorter way between the two; infinite where they are of different curves.
    """
    from scipy.spatial import cKDTree

    sizes = [len(c) for c in curves]
    curve = np.repeat(np.arange(len(curves)), sizes)
    arcs = [arc_lengths(c) for c in curves]
    arc, total = np.concatenate([a[:-1] for a in arcs]), np.repeat([a[-1] for a in arcs], sizes)
    pairs = cKDTree(np.concatenate(curves)).query_pairs(reach, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    along = np.abs(arc[i] - arc[j])
    along = np.minimum(along, total[i] - along)
    along[curve[i] != curve[j]] = np.inf
    return pairs, along
