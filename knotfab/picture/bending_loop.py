"""The compiled loop that bends a mask."""

from __future__ import annotations

from knotfab.base.arrays import Array, Mask
from knotfab.base.compiled import compiled

__all__ = ["look_up"]


@compiled
def look_up(mask: Mask, away: Array, bent: Mask) -> None:
    """Set `bent` (H, W) where the mask, bilinear, is half or more that far `away` (H, W, 2)."""
    rows, columns = mask.shape
    for i in range(rows):
        for j in range(columns):
            x, y = j + away[i, j, 0], i + away[i, j, 1]
            if not (0 <= x <= columns - 1 and 0 <= y <= rows - 1):
                bent[i, j] = False
                continue
            left, top = min(int(x), columns - 2), min(int(y), rows - 2)
            p, q = x - left, y - top
            share = 0.0
            if mask[top, left]:
                share += (1 - q) * (1 - p)
            if mask[top, left + 1]:
                share += (1 - q) * p
            if mask[top + 1, left]:
                share += q * (1 - p)
            if mask[top + 1, left + 1]:
                share += q * p
            bent[i, j] = share >= 0.5
