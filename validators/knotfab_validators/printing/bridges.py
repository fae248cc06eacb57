"""Find what a layer prints over air: bridges between two sides, ledges held at one, and islands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.mesh import connect
from knotfab_validators.printing.columns import Columns

__all__ = ["Stretches", "find_unsupported"]


STEP = 1e-4  # mm, to which heights are ranked
LEVEL_MM = 1e-3  # a height this little above a layer's top still belongs to the layer
OPPOSITE = -0.5  # cosine: 60 degrees to either side of straight across


@dataclass(frozen=True)
class Stretches:
    """Connected places that one layer prints over air, one entry each.

    `length` (n,) mm: of a bridge (`bridged`) the way from side to side past the point that is
    farthest from what holds it; of a ledge, held on one side, how far it reaches out; NaN of an
    island, which nothing holds. `place` (n, 3) is that point, of an island the lowest one, and
    `face` (n,) the mesh's face there.
    `cell_place` (k, 3) and `cell_of` (k,): the lower ends of all columns over air, and which
    stretch they belong to.
    """

    length: Array
    bridged: Mask
    place: Array
    face: Ints
    cell_place: Array
    cell_of: Ints

    @property
    def island(self) -> Mask:
        lone: Mask = np.isnan(self.length)
        return lone


def find_unsupported(grid: Columns, layer_mm: float) -> Stretches:
    """Find the stretches of each layer over air, as a slicer sees them.

    Layer k is the material between k and k + 1 layer heights. A column is over air in the layer
    in which its material begins, where that is not the first. Neighbouring columns (of eight) over
    air in one layer are one stretch. It is held wherever a neighbouring column has material in the
    layer below. The farthest column from all of those, straight across, decides: if something
    holds it within 60° of the opposite direction too, the stretch is a bridge, as long as the two
    ways together; otherwise it is a ledge. Lengths are those of the plan, to about one cell.
    """
    column, low = grid.column, grid.low
    layer = np.ceil((low - LEVEL_MM) / layer_mm).astype(np.int64) - 1
    index = _Index(grid)
    own = index.is_filled(column, layer - 1, layer_mm)
    air = np.flatnonzero((layer >= 1) & ~own)
    if not len(air):
        none, nowhere, number = np.empty(0), np.empty((0, 3)), np.empty(0, dtype=np.int64)
        return Stretches(none, none.astype(np.bool_), nowhere, number, nowhere, number)
    ix, iy, k = column[air] % grid.across, column[air] // grid.across, layer[air]
    key = _key(k, ix, iy, grid.across)
    order = np.argsort(key, kind="stable")
    pairs, held, anchors = [], [], []
    for dx, dy in ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)):
        x, y = ix + dx, iy + dy
        if dy > 0 or (dy == 0 and dx > 0):
            wanted = _key(k, x, y, grid.across)
            at = np.searchsorted(key[order], wanted).clip(max=len(key) - 1)
            same = np.flatnonzero(key[order[at]] == wanted)
            pairs.append(np.column_stack([same, order[at[same]]]))
        inside = (x >= 0) & (x < grid.across) & (y >= 0)
        solid = index.is_filled(np.where(inside, x + grid.across * y, -1), k - 1, layer_mm) & inside
        held.append(np.flatnonzero(solid))
        anchors.append(np.column_stack([x[solid], y[solid]]))
    joined = np.concatenate(pairs)
    label, count = connect(joined[:, 0], joined[:, 1], len(air))
    cells = np.column_stack([ix, iy]).astype(np.float64)
    anchor = np.concatenate(anchors).astype(np.float64)
    anchor_of = label[np.concatenate(held)]
    length, bridged, farthest = _measure_spans(cells, label, count, anchor, anchor_of)
    places = grid.places(air)
    # the lowest place of each island stands for it
    lowest = np.lexsort((places[:, 2], label))
    lowest = lowest[np.flatnonzero(np.diff(label[lowest], prepend=-1))]
    deciding = np.where(np.isnan(length), lowest, farthest)
    face = grid.face[air[deciding]]
    return Stretches(length * grid.cell, bridged, places[deciding], face, places, label)


def _measure_spans(
    cells: Array, label: Ints, count: int, anchor: Array, anchor_of: Ints
) -> tuple[Array, Mask, Ints]:
    """Measure the length in cells, whether it is a bridge, and the deciding cell, of each stretch."""
    apart = 4.0 * (1.0 + max(np.ptp(cells), 1.0))  # stretches on levels that cannot be confused
    length, bridged = np.full(count, np.nan), np.zeros(count, dtype=np.bool_)
    farthest = np.zeros(count, dtype=np.int64)
    if not len(anchor):
        return length, bridged, farthest
    some = np.flatnonzero(np.isin(label, anchor_of))
    tree = cKDTree(np.column_stack([anchor, anchor_of * apart]))
    distance, nearest = tree.query(np.column_stack([cells[some], label[some] * apart]))
    order = np.lexsort((-distance, label[some]))
    order = order[np.flatnonzero(np.diff(label[some[order]], prepend=-1))]
    which = label[some[order]]
    length[which], farthest[which] = distance[order], some[order]
    toward = np.zeros((count, 2))
    toward[which] = anchor[nearest[order]] - cells[some[order]]
    away = anchor - cells[farthest[anchor_of]]
    far = np.sqrt((away * away).sum(axis=1))
    cosine = (away * toward[anchor_of]).sum(axis=1) / (far * length[anchor_of])
    across = cosine < OPPOSITE
    other = np.full(count, np.inf)
    np.minimum.at(other, anchor_of[across], far[across])
    bridged = np.isfinite(other)
    # a support begins in the middle of a cell, half a cell behind the edge on each side
    length[bridged] += other[bridged] - 1.0
    return length, bridged, farthest


class _Index:
    """Answers whether a column has material in a layer."""

    def __init__(self, grid: Columns) -> None:
        self.grid = grid
        self.lowest = float(grid.low.min(initial=0.0))
        self.height = int((float(grid.high.max(initial=0.0)) - self.lowest) / STEP) + 2
        self.key = grid.column * self.height + self._rank(grid.low)

    def _rank(self, z: Array) -> Ints:
        rank = np.rint((z - self.lowest) / STEP).astype(np.int64)
        return rank.clip(min=-1, max=self.height - 1)

    def is_filled(self, column: Ints, layer: Ints, layer_mm: float) -> Mask:
        """Tell (k,) whether `column` (k,), -1 for none, has material between layer and layer + 1.

        A stretch of material that begins at the layer's very top is not counted.
        """
        top = np.asarray((layer + 1) * layer_mm, dtype=np.float64)
        wanted: Ints = column * self.height + self._rank(top - LEVEL_MM)
        at = np.searchsorted(self.key, wanted, side="right") - 1
        found = at.clip(min=0)
        mask: Mask = (
            (at >= 0)
            & (column >= 0)
            & (self.grid.column[found] == column)
            & (self.grid.high[found] > layer * layer_mm + LEVEL_MM)
        )
        return mask


def _key(layer: Ints, ix: Ints, iy: Ints, across: int) -> Ints:
    """Return one number for a column of a layer; those outside the grid get one that no column has."""
    wide = np.int64(across + 2)
    tall = np.int64(1_000_000)
    return (layer * tall + iy + 1) * wide + ix + 1
