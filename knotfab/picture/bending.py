"""A picture bent by a few control points: a smooth field says for each pixel where in the picture it looks.

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
# places in which slopes are looked at: so smooth a field has no steeper ones between
_GRID = 120, 120
_CRUMB = 1e-4  # a share of the picture: a piece or hole has no fewer pixels


@dataclass(frozen=True)
class Bending:
    """The bending of a picture, as shares of its height: over its silhouette on average (root mean square)
    and at most; `stretch`, the longest that a step of one in it became, or 1 over the shortest."""

    rms: float
    most: float
    stretch: float


def read_points(rows: Sequence[str]) -> Array:
    """Read (ROWS, COLUMNS, 2) control points, right and down, as shares of the picture's height."""
    return _UNIT * np.array(
        [[pair.split(",") for pair in row.split()] for row in rows], dtype=float
    )


def write_points(points: Array) -> tuple[str, ...]:
    """Write control points as `read_points` reads them: a text for each row."""
    whole = np.rint(points / _UNIT).astype(int)
    return tuple(" ".join(f"{x},{y}" for x, y in row) for row in whole)


def spline_basis(at: Array, length: float, count: int) -> Array:
    """Return (len(at), count): weights of control points at places along a side, px; its ends go on."""
    s = 1.0 + np.clip((at + 0.5) / length, 0.0, 1.0) * (count - 3)
    away = np.abs(s[:, None] - np.arange(count))
    near, far = 2.0 / 3.0 - away**2 + 0.5 * away**3, np.maximum(2.0 - away, 0.0) ** 3 / 6.0
    return np.where(away < 1.0, near, far)


def displace(points: Array, height: int, width: int) -> Array:
    """Return (height, width, 2): how far to the right and down of each pixel its picture is found, px."""
    down = spline_basis(np.arange(height, dtype=float), height, ROWS)
    across = spline_basis(np.arange(width, dtype=float), width, COLUMNS)
    return np.asarray(height * np.einsum("ri,ijd,cj->rcd", down, points, across, optimize=True))


def bend_mask(mask: Mask, points: Array) -> Mask:
    """Give the mask as bent: each pixel holds what the mask has if the field says; outside it is nothing."""
    from knotfab.geometry.kernels import look_up  # only where a picture is bent: loops load numba

    bent = np.empty(mask.shape, dtype=np.bool_)
    look_up(np.ascontiguousarray(mask), displace(points, *mask.shape), bent)
    return bent


def stretch_of(points: Array, aspect: float) -> tuple[float, float]:
    """Give the longest and the shortest that a step of one becomes under the field; negative where it folds.

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
    """Measure how far the field moves the silhouette that is bent by it."""
    away = displace(points, *bent.shape)
    moved = np.hypot(away[..., 0], away[..., 1])[bent] / bent.shape[0]
    if not len(moved):
        return Bending(0.0, 0.0, 1.0)
    longest, shortest = stretch_of(points, bent.shape[1] / bent.shape[0])
    stretch = max(longest, 1.0 / shortest) if shortest > 0 else np.inf
    return Bending(float(np.sqrt((moved**2).mean())), float(moved.max()), float(stretch))


def keeps_shape(mask: Mask, bent: Mask) -> bool:
    """Tell whether both have as many pieces and holes, crumbs aside."""
    least = _CRUMB * mask.size

    def count(one: Mask) -> list[int]:
        return [int((found(one)[1] >= least).sum()) for found in (pieces_of, holes_of)]

    return count(mask) == count(bent)
