"""A picture bent by a few control points: a smooth field maps each pixel to the place that it is taken from.

The field is a uniform bicubic B-spline (docs/conventions.md), so a bound that all control points keep is kept
everywhere, as are bounds on their differences by its slopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.picture.silhouette import holes_of, pieces_of

ROWS, COLUMNS = 15, 11  # rows and columns of control points; the outermost lie outside the frame
_UNIT = 1e-4  # control points are written in this share of the picture's height
# sample places for slopes, dense enough for so smooth a field
_GRID = 120, 120
_CRUMB = 1e-4  # share of the picture's pixels below which a piece or hole is ignored


@dataclass(frozen=True)
class Bending:
    """How far a picture is bent, as shares of its height: over its silhouette on average (root mean square)
    and at most; `stretch` is the largest factor by which a length in it grew or shrank."""

    rms: float
    most: float
    stretch: float


def read_points(rows: Sequence[str]) -> Array:
    """Parse control points, right and down, as shares of the picture's height, (ROWS, COLUMNS, 2)."""
    return _UNIT * np.array(
        [[pair.split(",") for pair in row.split()] for row in rows], dtype=float
    )


def write_points(points: Array) -> tuple[str, ...]:
    """Format control points for `read_points`, one text per row."""
    whole = np.rint(points / _UNIT).astype(int)
    return tuple(" ".join(f"{x},{y}" for x, y in row) for row in whole)


def spline_basis(at: Array, length: float, count: int) -> Array:
    """Return the weights of `count` control points at places `at`, px, along a side, (len(at), count)."""
    s = 1.0 + np.clip((at + 0.5) / length, 0.0, 1.0) * (count - 3)
    away = np.abs(s[:, None] - np.arange(count))
    near, far = 2.0 / 3.0 - away**2 + 0.5 * away**3, np.maximum(2.0 - away, 0.0) ** 3 / 6.0
    return np.where(away < 1.0, near, far)


def displace(points: Array, height: int, width: int) -> Array:
    """Return for each pixel how far right and down to look in the picture, px, (height, width, 2)."""
    down = spline_basis(np.arange(height, dtype=float), height, ROWS)
    across = spline_basis(np.arange(width, dtype=float), width, COLUMNS)
    return np.asarray(height * np.einsum("ri,ijd,cj->rcd", down, points, across, optimize=True))


def bend_mask(mask: Mask, points: Array) -> Mask:
    """Return the bent mask: each pixel holds what lies where the field points; outside is empty."""
    from knotfab.geometry.kernels import look_up  # only where a picture is bent: loops load numba

    bent = np.empty(mask.shape, dtype=np.bool_)
    look_up(np.ascontiguousarray(mask), displace(points, *mask.shape), bent)
    return bent


def stretch_of(points: Array, aspect: float) -> tuple[float, float]:
    """Return the field's largest and smallest local stretch; the smallest is negative where it folds.

    Args:
        aspect: the picture's width over its height.
    """
    away = displace(points, *_GRID) / _GRID[0]
    ux = np.gradient(away, axis=1) * _GRID[1] / aspect
    uy = np.gradient(away, axis=0) * _GRID[0]
    a, b, c, d = 1.0 + ux[..., 0], uy[..., 0], ux[..., 1], 1.0 + uy[..., 1]
    half, det = 0.5 * (a * a + b * b + c * c + d * d), a * d - b * c
    root = np.sqrt(np.maximum(half * half - det * det, 0.0))
    longest = np.sqrt(half + root)
    return float(longest.max()), float((det / longest).min())


def measure_bending(bent: Mask, points: Array) -> Bending:
    """Measure how far the field moves the bent silhouette."""
    away = displace(points, *bent.shape)
    moved = np.hypot(away[..., 0], away[..., 1])[bent] / bent.shape[0]
    if not len(moved):
        return Bending(0.0, 0.0, 1.0)
    longest, shortest = stretch_of(points, bent.shape[1] / bent.shape[0])
    stretch = max(longest, 1.0 / shortest) if shortest > 0 else np.inf
    return Bending(float(np.sqrt((moved**2).mean())), float(moved.max()), float(stretch))


def keeps_shape(mask: Mask, bent: Mask) -> bool:
    """Return whether both masks have equally many pieces and holes, crumbs aside."""
    least = _CRUMB * mask.size

    def count(one: Mask) -> list[int]:
        return [int((found(one)[1] >= least).sum()) for found in (pieces_of, holes_of)]

    return count(mask) == count(bent)
