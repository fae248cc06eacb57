"""Vertical columns through a part: where each enters and leaves the material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints
from knotfab_validators.geometry.mesh import Mesh, bound_triangles
from knotfab_validators.geometry.sampling import number_runs

__all__ = ["CELL_MM", "Columns", "columns"]


CELL_MM = 0.5
MOST_TESTS = 20_000_000  # pairs of face and row, and of face and column
HAIR = 1e-3  # cells by which a row's axes are looked for beyond the face, and edges count as level
# the place of a column's axis in its cell: CAD parts have edges at round numbers
OFFSET = 0.50137, 0.50079


@dataclass(frozen=True)
class Columns:
    """Stretches of material along the vertical axes of a square grid, column by column, upwards.

    `column` (n,) is ix + across * iy, `low` and `high` (n,) the ends of the stretch, mm, and
    `face` (n,) the face in which it begins. The axis of a column is at `origin` + (ix, iy) `cell`.
    """

    cell: float
    across: int
    origin: tuple[float, float]
    column: Ints
    low: Array
    high: Array
    face: Ints

    def places(self, which: Ints) -> Array:
        """Return (k, 3) mm, the lower ends of the stretches `which` (k,)."""
        x = self.origin[0] + self.cell * (self.column[which] % self.across)
        y = self.origin[1] + self.cell * (self.column[which] // self.across)
        return np.column_stack([x, y, self.low[which]])


def columns(mesh: Mesh, cell: float = CELL_MM) -> Columns:
    """Return the columns of a closed mesh on a grid of `cell` mm from the corner of its bounding box.

    Each face is tested against the axes of the rows that cross it; an axis through an edge belongs
    to one of the edge's faces (the rule of rasterisation: an edge owns what it meets when it goes
    up, or left when level), so that nothing is counted twice. Going up, a face that looks down
    adds one to how often the axis is inside, one that looks up takes one away; material is where
    that is positive. Axes at which the sum does not come back to zero are left out.

    The cell grows where the part is wider than 1000 of them, or its faces would need more than
    20 million tests.
    """
    flat = mesh.vertices[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    cell = max(cell, float((high - low).max()) / 1000)  # columns along the longer side
    corner = flat[mesh.faces]  # (m, 3, 2)
    while True:
        start = low + np.array(OFFSET) * cell
        if np.ptp(corner[:, :, 1], axis=1).sum() <= MOST_TESTS * cell:
            face, iy, first, count = _rows(corner, start, cell)
            if int(count.sum()) <= MOST_TESTS:
                break
        cell *= 1.5
    across = int(np.floor((high - start)[0] / cell)) + 1
    row, number = number_runs(count)
    face, ix, iy = face[row], first[row] + number, iy[row]
    x, y = start[0] + cell * ix, start[1] + cell * iy
    z, facing = _heights(mesh, face, x, y)
    hit = np.flatnonzero(facing)
    column, z, facing, face = ix[hit] + across * iy[hit], z[hit], facing[hit], face[hit]
    order = np.lexsort((-facing, z, column))
    column, z, facing, face = column[order], z[order], facing[order], face[order]
    return Columns(
        cell,
        max(across, 1),
        (float(start[0]), float(start[1])),
        *_stretches(column, z, facing, face),
    )


def _rows(corner: Array, start: Array, cell: float) -> tuple[Ints, Ints, Ints, Ints]:
    """Find where rows of axes may meet faces (m, 3, 2): face, number of the row, first axis in it, and how
    many.

    A row's axes are those between the places where it enters and leaves the face, and a hair more.
    """
    place = (corner - start) / cell
    low, high = bound_triangles(*place.swapaxes(0, 1))
    first = np.ceil(low[:, 1]).astype(np.int64)
    face, number = number_runs(np.maximum(np.floor(high[:, 1]).astype(np.int64) - first + 1, 0))
    iy = first[face] + number
    left, right = np.full(len(face), np.inf), np.full(len(face), -np.inf)
    for k in range(3):
        a, b = place[face, k], place[face, (k + 1) % 3]
        rise = b[:, 1] - a[:, 1]
        meets = (np.minimum(a[:, 1], b[:, 1]) <= iy) & (np.maximum(a[:, 1], b[:, 1]) >= iy)
        level = np.abs(rise) < HAIR
        share = np.clip((iy - a[:, 1]) / np.where(level, 1.0, rise), 0.0, 1.0)
        x = a[:, 0] + share * (b[:, 0] - a[:, 0])
        for end in (np.where(level, a[:, 0], x), np.where(level, b[:, 0], x)):
            left = np.where(meets, np.minimum(left, end), left)
            right = np.where(meets, np.maximum(right, end), right)
    begin, end = np.ceil(left - HAIR), np.floor(right + HAIR)
    begin = np.maximum(begin, np.ceil(low[face, 0]))
    end = np.minimum(end, np.floor(high[face, 0]))
    good = np.flatnonzero(end >= begin)
    begin, end = begin[good].astype(np.int64), end[good].astype(np.int64)
    return face[good], iy[good], begin, end - begin + 1


def _heights(mesh: Mesh, face: Ints, x: Array, y: Array) -> tuple[Array, Ints]:
    """Return z (k,) of the points of `face` (k,) at (x, y), and +1 where it looks down, -1 up, 0 missed."""
    area = np.zeros(len(face))
    inside = [np.ones(len(face), dtype=np.bool_) for _ in range(2)]
    weight = np.empty((3, len(face)))
    for k in range(3):
        i, j = mesh.faces[face, k], mesh.faces[face, (k + 1) % 3]
        # the same sum for both faces of an edge, whichever way they run through it
        swap = i > j
        a, b = mesh.vertices[np.where(swap, j, i)], mesh.vertices[np.where(swap, i, j)]
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        value = dx * (y - a[:, 1]) - dy * (x - a[:, 0])
        owns = (dy > 0) | ((dy == 0) & (dx < 0))
        sign = np.where(swap, -1.0, 1.0)
        weight[(k + 2) % 3] = value * sign
        area += value * sign
        left = (value > 0) | ((value == 0) & owns)  # the value of the edge as it is stored
        left ^= swap
        inside[0] &= left
        inside[1] &= ~left
    hit = (inside[0] | inside[1]) & (area != 0)
    weight /= np.where(hit, area, 1.0)
    corner = mesh.vertices[mesh.faces[face], 2]
    # steep faces amplify rounding, but no point of a face leaves the range of its corners
    z = np.einsum("ki,ik->i", weight, corner).clip(corner.min(axis=1), corner.max(axis=1))
    facing = np.where(hit, np.where(inside[0], -1, 1), 0)
    return z, facing.astype(np.int64)


def _stretches(column: Ints, z: Array, facing: Ints, face: Ints) -> tuple[Ints, Array, Array, Ints]:
    """Return column, low, high and lower face of each stretch, of sorted crossings."""
    if not len(column):
        return column, z, z.copy(), face
    new = np.flatnonzero(np.diff(column, prepend=column[0] - 1))
    run = np.cumsum(facing)
    before = np.repeat(run[new] - facing[new], np.diff(new, append=len(column)))
    depth = run - before
    last = np.append(new[1:], len(column)) - 1
    good = np.repeat(depth[last] == 0, np.diff(new, append=len(column)))
    enters = np.flatnonzero(good & (depth == 1) & (facing > 0))
    leaves = np.flatnonzero(good & (depth == 0) & (facing < 0))
    if len(enters) != len(leaves):  # an axis that is inside less than no times: wound inwards
        bad = np.unique(column[good & (depth < 0)])
        enters = enters[~np.isin(column[enters], bad)]
        leaves = leaves[~np.isin(column[leaves], bad)]
    thick = z[leaves] > z[enters]
    enters, leaves = enters[thick], leaves[thick]
    return column[enters], z[enters], z[leaves], face[enters]
