"""Horizontal sections of a part, layer by layer: runs of material along rows, and connected pieces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.surface import bound_work

ROW_MM = 0.15
MOST_BUCKETS = 50_000_000  # rows of all layers together
MOST_CROSSINGS = 50_000_000


@dataclass(frozen=True)
class Slices:
    """The sections of a part in the middle of each layer, cut along rows of one y.

    Layer k lies at `bottom` + (k + 1/2) `layer`, row j at y = `south` + j `row`, mm. The runs of row j in
    layer k are those from `first`[k * rows + j] to the next entry; `left` and `right` (n,) are their ends,
    `piece` (n,) numbers the connected pieces of all layers upwards, which `floor` (p,) puts in their layers.
    """

    bottom: float
    layer: float
    south: float
    row: float
    rows: int
    first: Ints
    left: Array
    right: Array
    piece: Ints
    floor: Ints

    @property
    def layers(self) -> int:
        return (len(self.first) - 1) // self.rows

    def height(self, floor: Ints) -> Array:
        """Return z (k,), mm, of the sections in layers (k,)."""
        return np.asarray(self.bottom + (floor + 0.5) * self.layer)


def slice_layers(
    mesh: Mesh, layer_mm: float, row_mm: float = ROW_MM, heights: Sequence[float] | None = None
) -> Slices:
    """Cut a closed mesh in the middle of every layer, counted from its lowest corner as a slicer does.

    The point where a section meets an edge is computed once for both its faces, and every interval of
    heights and rows has one end: whatever falls on a corner, a closed surface gives closed sections. Material
    is where the winding number is positive: what bodies share counts once, and a hollow does not count.

    Args:
        heights: z, mm; layers that hold none of them are left empty. None: all are cut.

    Raises:
        TooMuchWork: there are too many rows or crossings.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    # slightly off the round numbers that designers use
    south = float(low[1]) - 1.2763 * row_mm
    rows = int((high[1] - south) / row_mm) + 3
    layers = max(int(np.ceil((high[2] - low[2]) / layer_mm - 1e-6)), 1)
    bound_work(float(rows) * layers, MOST_BUCKETS, "rows of layers")
    wanted = np.ones(layers, dtype=np.bool_)
    if heights is not None:
        at = [layer_of(z, float(low[2]), layer_mm) for z in heights]
        wanted[:] = np.isin(np.arange(layers), at)
    shape = float(low[2]), layer_mm, wanted, south, row_mm, rows
    none = np.empty(0)
    count = np.zeros(layers * rows + 1, dtype=np.int64)
    _cross(mesh.vertices, mesh.faces, *shape, count, none, np.empty(0, dtype=np.int8), False)
    bound_work(int(count.sum()), MOST_CROSSINGS, "crossings of rows and faces")
    first = np.cumsum(count)
    x, sign = np.empty(first[-1]), np.empty(first[-1], dtype=np.int8)
    _cross(mesh.vertices, mesh.faces, *shape, first[:-1].copy(), x, sign, True)
    begin, left, right = _join_runs(first, x, sign)
    piece, floor = _number_pieces(begin, left, right, rows, row_mm)
    return Slices(float(low[2]), layer_mm, south, row_mm, rows, begin, left, right, piece, floor)


def layer_of(z: float, bottom: float, layer_mm: float) -> int:
    """Return the layer at a height, 0 for the lowest, which begins at `bottom`."""
    return int(np.floor((z - bottom) / layer_mm))


@compiled
def _cross(
    vertices: Array,
    faces: Ints,
    bottom: float,
    layer: float,
    wanted: Mask,
    south: float,
    row: float,
    rows: int,
    at: Ints,
    x: Array,
    sign: Array,
    write: bool,
) -> None:
    """Count in `at[1:]` where rows enter (+1) and leave (-1) the part, or write these places from `at` on."""
    ends = np.empty((2, 2))
    for face in range(len(faces)):
        z0, z1, z2 = (
            vertices[faces[face, 0], 2],
            vertices[faces[face, 1], 2],
            vertices[faces[face, 2], 2],
        )
        lowest, highest = min(z0, z1, z2), max(z0, z1, z2)
        begin = max(int(np.floor((lowest - bottom) / layer - 0.5)), 0)
        until = min(int(np.ceil((highest - bottom) / layer - 0.5)) + 1, len(wanted))
        for k in range(begin, until):
            z = bottom + (k + 0.5) * layer
            if not (wanted[k] and lowest <= z < highest):
                continue
            for corner in range(3):
                i, j = faces[face, corner], faces[face, (corner + 1) % 3]
                up = vertices[i, 2] <= z
                if up == (vertices[j, 2] <= z):
                    continue
                a, b = min(i, j), max(i, j)
                share = (z - vertices[a, 2]) / (vertices[b, 2] - vertices[a, 2])
                which = 1 if up else 0
                ends[which, 0] = vertices[a, 0] + share * (vertices[b, 0] - vertices[a, 0])
                ends[which, 1] = vertices[a, 1] + share * (vertices[b, 1] - vertices[a, 1])
            # faces wound outwards have material on the left of the path from `up` to `down`
            south_end, north_end = min(ends[0, 1], ends[1, 1]), max(ends[0, 1], ends[1, 1])
            j0 = max(int(np.floor((south_end - south) / row)), 0)
            j1 = min(int(np.ceil((north_end - south) / row)) + 1, rows)
            for j in range(j0, j1):
                y = south + j * row
                if not (south_end <= y < north_end):
                    continue
                bucket = k * rows + j
                if not write:
                    at[bucket + 1] += 1
                    continue
                share = (y - ends[0, 1]) / (ends[1, 1] - ends[0, 1])
                slot = at[bucket]
                x[slot] = ends[0, 0] + share * (ends[1, 0] - ends[0, 0])
                sign[slot] = 1 if ends[1, 1] < ends[0, 1] else -1
                at[bucket] += 1


@compiled
def _join_runs(first: Ints, x: Array, sign: Array) -> tuple[Ints, Array, Array]:
    """Join each row's crossings into runs of material; at one place, entries sort before exits."""
    begin = np.zeros(len(first), dtype=np.int64)
    left, right = np.empty(len(x)), np.empty(len(x))
    count = 0
    for bucket in range(len(first) - 1):
        begin[bucket] = count
        low, high = first[bucket], first[bucket + 1]
        for i in range(low + 1, high):
            value, step = x[i], sign[i]
            j = i - 1
            while j >= low and (x[j] > value or (x[j] == value and sign[j] < step)):
                x[j + 1], sign[j + 1] = x[j], sign[j]
                j -= 1
            x[j + 1], sign[j + 1] = value, step
        depth = 0
        for i in range(low, high):
            if depth == 0 and sign[i] > 0:
                left[count] = x[i]
            depth += sign[i]
            if depth == 0 and sign[i] < 0 and x[i] > left[count]:
                right[count] = x[i]
                count += 1
    begin[-1] = count
    return begin, left[:count], right[:count]


@compiled
def _number_pieces(
    first: Ints, left: Array, right: Array, rows: int, slack: float
) -> tuple[Ints, Ints]:
    """Number the connected runs (n,), layer by layer; return each number's layer too.

    Runs of neighbouring rows belong to one piece if they overlap, or come as near as the rows are.
    """
    root = np.arange(len(left))
    for bucket in range(len(first) - 2):
        if (bucket + 1) % rows == 0:
            continue
        a, b = first[bucket], first[bucket + 1]
        while a < first[bucket + 1] and b < first[bucket + 2]:
            if left[a] <= right[b] + slack and left[b] <= right[a] + slack:
                i, j = a, b
                while root[i] != i:
                    root[i] = root[root[i]]
                    i = root[i]
                while root[j] != j:
                    root[j] = root[root[j]]
                    j = root[j]
                root[max(i, j)] = min(i, j)
            if right[a] < right[b]:
                a += 1
            else:
                b += 1
    piece, floor = np.empty(len(left), dtype=np.int64), np.empty(len(left), dtype=np.int64)
    count = 0
    for bucket in range(len(first) - 1):
        for a in range(first[bucket], first[bucket + 1]):
            i = a
            while root[i] != i:
                i = root[i]
            if i == a:
                piece[a] = count
                floor[count] = bucket // rows
                count += 1
            else:
                piece[a] = piece[i]
    return piece, floor[:count]


@compiled
def link_pieces(first: Ints, left: Array, right: Array, piece: Ints, rows: int) -> Ints:
    """List pairs (k, 2) of a piece and one that it lies on; pairs may repeat."""
    found = np.empty((2 * len(left), 2), dtype=np.int64)
    count = 0
    for bucket in range(rows, len(first) - 1):
        a, b = first[bucket], first[bucket - rows]
        while a < first[bucket + 1] and b < first[bucket - rows + 1]:
            if left[a] < right[b] and left[b] < right[a]:
                same = count and found[count - 1, 0] == piece[a] and found[count - 1, 1] == piece[b]
                if not same:
                    found[count, 0], found[count, 1] = piece[a], piece[b]
                    count += 1
            if right[a] < right[b]:
                a += 1
            else:
                b += 1
    return found[:count]


def measure_pieces(cut: Slices) -> tuple[Array, Array]:
    """Return the area (p,), mm², and the centroid (p, 2), mm, of each piece."""
    count = np.diff(cut.first)
    bucket = np.repeat(np.arange(len(count)), count)
    width = cut.right - cut.left
    y = cut.south + cut.row * (bucket % cut.rows)
    pieces = len(cut.floor)
    length = np.bincount(cut.piece, width, pieces)
    moment = [np.bincount(cut.piece, width * at, pieces) for at in ((cut.left + cut.right) / 2, y)]
    middle: Array = np.column_stack(moment) / length[:, None]
    return np.asarray(length * cut.row, dtype=np.float64), middle


def bound_pieces(cut: Slices) -> Array:
    """Return the box (p, 4) of each piece: least and most x, least and most y, mm."""
    count = np.diff(cut.first)
    y = cut.south + cut.row * (np.repeat(np.arange(len(count)), count) % cut.rows)
    box = np.empty((len(cut.floor), 4))
    for side, (at, extreme) in enumerate(
        [(cut.left, np.minimum), (cut.right, np.maximum), (y, np.minimum), (y, np.maximum)]
    ):
        box[:, side] = np.inf if extreme is np.minimum else -np.inf
        extreme.at(box[:, side], cut.piece, at)
    return box


@compiled
def find_pieces(
    first: Ints,
    left: Array,
    right: Array,
    piece: Ints,
    reach: float,
    x: Array,
    row: Array,
    beside: int = 1,
) -> Ints:
    """Return the piece (n,) nearest to x in a row of all layers, whose number may be fractional.

    It is -1 if none is within `reach` there or in the `beside` rows to either side.
    """
    found = np.full(len(x), -1)
    for i in range(len(x)):
        best, middle = reach, int(np.rint(row[i]))
        for j in range(middle - beside, middle + beside + 1):
            for a in range(first[j], first[j + 1]):
                off = max(left[a] - x[i], x[i] - right[a], 0.0)
                if off < best:
                    best, found[i] = off, piece[a]
    return found
