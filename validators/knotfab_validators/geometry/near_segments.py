"""Find segments of two blocks that come near each other: dense tests where no hierarchy helps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask

__all__ = ["SegmentBlocks", "near_segments", "segment_blocks"]


ROUNDING = 1e-14  # a share of the extent squared: the error of a squared distance from products


@dataclass(frozen=True)
class SegmentBlocks:
    """Segments in m blocks of up to b, padded; `index` (m, b) is -1 where nothing is."""

    index: Ints
    centre: Array  # (m, b, 3)
    unit: Array  # (m, b, 3), 0 for a segment of no length
    half: Array  # (m, b)
    line: Array  # (m, b, 6): moment and direction, Plücker coordinates
    extent: float


def segment_blocks(start: Array, end: Array, first: Ints) -> SegmentBlocks:
    """Return blocks of consecutive segments (n, 3); `first` (m,) is where each begins, ascending.

    Coordinates should be relative to a point among them.
    """
    count = np.diff(np.append(first, len(start)))
    column = np.arange(int(count.max()))
    index = np.where(column < count[:, None], first[:, None] + column, -1)
    span = end - start
    length = np.sqrt(np.einsum("ij,ij->i", span, span))
    unit = span / np.where(length > 0, length, 1.0)[:, None]
    centre = (start + end) / 2
    line = np.concatenate([np.cross(centre, unit), unit], axis=1)
    extent = float(np.abs(centre).max() + length.max())
    return SegmentBlocks(index, centre[index], unit[index], length[index] / 2, line[index], extent)


def near_segments(blocks: SegmentBlocks, i: Ints, j: Ints, limit: float) -> tuple[Ints, Ints]:
    """Return pairs of segments of blocks i and j (k,) that may be `limit` or less apart.

    Left out are pairs whose lines are farther apart (the products of their Plücker coordinates),
    whose balls are, or one of which leaves the cylinder of the other's line. Each is a few matrix
    products over all pairs of two blocks, some 50 ns a pair. Memory: k b² numbers.
    """
    near = _near(blocks, i, j, limit)
    near &= (blocks.index[i] >= 0)[:, :, None] & (blocks.index[j] >= 0)[:, None, :]
    block, row, column = np.nonzero(near)
    one, other = blocks.index[i[block], row], blocks.index[j[block], column]
    once = (i[block] != j[block]) | (one < other)
    return one[once], other[once]


def _near(blocks: SegmentBlocks, a: Ints, b: Ints, limit: float) -> Mask:
    """Return (k, b, b) of blocks a and b (k,)."""
    slack = ROUNDING * blocks.extent * max(blocks.extent, limit)
    u, v = blocks.unit[a], blocks.unit[b].transpose(0, 2, 1)
    p, q = blocks.centre[a], blocks.centre[b].transpose(0, 2, 1)
    g, h = blocks.half[a][:, :, None], blocks.half[b][:, None, :]
    sine2 = np.clip(1.0 - (u @ v) ** 2 + ROUNDING, 0.0, 1.0)
    swapped = blocks.line[b][:, :, [3, 4, 5, 0, 1, 2]].transpose(0, 2, 1)
    lines = (blocks.line[a] @ swapped) ** 2
    near: Mask = lines <= limit**2 * sine2 + slack
    square = (p * p).sum(axis=2)[:, :, None] + (q * q).sum(axis=1)[:, None, :] - 2 * (p @ q)
    near &= square <= (limit + g + h) ** 2 + slack
    sine = np.sqrt(sine2)
    along = u @ q - (u * p).sum(axis=2)[:, :, None]
    near &= square - along**2 <= (limit + h * sine) ** 2 + slack
    along = p @ v - (v * q).sum(axis=1)[:, None, :]
    near &= square - along**2 <= (limit + g * sine) ** 2 + slack
    return near
