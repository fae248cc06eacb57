"""Find what a layer prints over air: bridges (held on two sides), ledges (held on one) and islands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.curves import number_runs
from knotfab_validators.geometry.mesh import Mesh, bound_triangles, connect

STEP = 1e-4  # mm, resolution of heights when ranked
LEVEL_MM = 1e-3  # a height this little above a layer's top still belongs to the layer
OPPOSITE = -0.5  # cosine: 60 degrees to either side of straight across


@dataclass(frozen=True)
class Stretches:
    """The connected places that one layer prints over air, one entry for each.

    `length` (n,) mm: for a bridge (`bridged`) the way from side to side past the point that is
    farthest from what holds it; for a ledge, held on one side, how far it reaches out; NaN for an
    island, which nothing holds. `place` (n, 3) is that point, for an island the lowest one, and
    `face` (n,) the mesh's face there. `cell_place` (k, 3) and `cell_of` (k,): the lower ends of all
    columns over air, and which stretch they belong to.
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
    # an island is represented by its lowest place
    lowest = np.lexsort((places[:, 2], label))
    lowest = lowest[np.flatnonzero(np.diff(label[lowest], prepend=-1))]
    deciding = np.where(np.isnan(length), lowest, farthest)
    face = grid.face[air[deciding]]
    return Stretches(length * grid.cell, bridged, places[deciding], face, places, label)


def _measure_spans(
    cells: Array, label: Ints, count: int, anchor: Array, anchor_of: Ints
) -> tuple[Array, Mask, Ints]:
    """Measure each stretch: its length in cells, whether it is a bridge, and the cell that decides."""
    apart = 4.0 * (1.0 + max(np.ptp(cells), 1.0))  # keeps stretches on different levels apart
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
    """Looks up whether a column has material in a layer."""

    def __init__(self, grid: Columns) -> None:
        self.grid = grid
        self.lowest = float(grid.low.min(initial=0.0))
        self.height = int((float(grid.high.max(initial=0.0)) - self.lowest) / STEP) + 2
        self.key = grid.column * self.height + self._rank(grid.low)

    def _rank(self, z: Array) -> Ints:
        rank = np.rint((z - self.lowest) / STEP).astype(np.int64)
        return rank.clip(min=-1, max=self.height - 1)

    def is_filled(self, column: Ints, layer: Ints, layer_mm: float) -> Mask:
        """Return whether `column` (k,), -1 for none, has material between layer and layer + 1, (k,).

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
    """Return a unique key for each column of a layer; columns outside the grid share a key that none has."""
    wide = np.int64(across + 2)
    tall = np.int64(1_000_000)
    return (layer * tall + iy + 1) * wide + ix + 1


# Vertical columns through a part: where each one enters and leaves the material.

CELL_MM = 0.5
MOST_TESTS = 20_000_000  # pairs of face and row, and of face and column
HAIR = 1e-3  # cells by which a face is widened when rows look for it, and edges count as level
# position of a column's axis within its cell: CAD parts have edges at round numbers
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
        """Return the lower ends (k, 3), mm, of the stretches with indices `which` (k,)."""
        x = self.origin[0] + self.cell * (self.column[which] % self.across)
        y = self.origin[1] + self.cell * (self.column[which] // self.across)
        return np.column_stack([x, y, self.low[which]])


def columns(mesh: Mesh, cell: float = CELL_MM) -> Columns:
    """Cut a closed mesh into columns on a grid of `cell` mm from the corner of its bounding box.

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
    # at most a thousand columns along the longer side
    cell = max(cell, float((high - low).max()) / 1000)
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
    """Find the rows of axes that may meet each face (m, 3, 2).

    Returns the face, the row's number, its first axis in the face and how many there are: those
    between where the row enters and leaves the face, and a little beyond.
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
    """Return z (k,) of `face` (k,) at (x, y), and +1 if it looks down, -1 if up, 0 if it is missed."""
    area = np.zeros(len(face))
    inside = [np.ones(len(face), dtype=np.bool_) for _ in range(2)]
    weight = np.empty((3, len(face)))
    for k in range(3):
        i, j = mesh.faces[face, k], mesh.faces[face, (k + 1) % 3]
        # the same sum for both faces of an edge, in whichever direction they traverse it
        swap = i > j
        a, b = mesh.vertices[np.where(swap, j, i)], mesh.vertices[np.where(swap, i, j)]
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        value = dx * (y - a[:, 1]) - dy * (x - a[:, 0])
        owns = (dy > 0) | ((dy == 0) & (dx < 0))
        sign = np.where(swap, -1.0, 1.0)
        weight[(k + 2) % 3] = value * sign
        area += value * sign
        left = (value > 0) | ((value == 0) & owns)  # the sign for the edge in its stored direction
        left ^= swap
        inside[0] &= left
        inside[1] &= ~left
    hit = (inside[0] | inside[1]) & (area != 0)
    weight /= np.where(hit, area, 1.0)
    corner = mesh.vertices[mesh.faces[face], 2]
    # steep faces amplify rounding, but z stays within the range of the corners
    z = np.einsum("ki,ik->i", weight, corner).clip(corner.min(axis=1), corner.max(axis=1))
    facing = np.where(hit, np.where(inside[0], -1, 1), 0)
    return z, facing.astype(np.int64)


def _stretches(column: Ints, z: Array, facing: Ints, face: Ints) -> tuple[Ints, Array, Array, Ints]:
    """Pair sorted crossings into stretches: column, low, high and lower face of each."""
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
    # the axis is inside fewer than zero times: the mesh is wound inwards
    if len(enters) != len(leaves):
        bad = np.unique(column[good & (depth < 0)])
        enters = enters[~np.isin(column[enters], bad)]
        leaves = leaves[~np.isin(column[leaves], bad)]
    thick = z[leaves] > z[enters]
    enters, leaves = enters[thick], leaves[thick]
    return column[enters], z[enters], z[leaves], face[enters]


# Downward tips that begin in mid-air, where a printer would have nothing to start on.

UPWARD = 0.05  # z of a normal from which a face counts as looking up
ISLAND_LEVEL_MM = 1e-6  # corners joined by an edge this level count as one place


def find_islands(mesh: Mesh, air: Stretches, layer_mm: float) -> Array:
    """Find the tips in mid-air (n, 3), lowest first: local minima of the surface with material above.

    The grid of columns sees a stretch that nothing holds, but not a tip or a leg thinner than its
    cells. So from the face where a column begins, a path descends along the surface, each time to
    the lowest neighbouring corner (level corners count as one). The stretch is an island if the
    path ends above the first layer, in a place where no face looks up.
    """
    start = np.unique(air.face[air.island])
    if not len(start):
        return np.empty((0, 3))
    z, faces = mesh.vertices[:, 2], mesh.faces
    place = _level_places(mesh)
    high = np.concatenate([faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)])
    low = np.concatenate([np.roll(faces, -1, axis=1).reshape(-1), faces.reshape(-1)])
    down = np.flatnonzero((z[low] < z[high]) & (place[low] != place[high]))
    down = down[np.argsort(-z[low[down]], kind="stable")]
    way = np.arange(len(z))
    way[place[high[down]]] = place[low[down]]  # the last one written, the lowest, wins
    for _ in range(64):  # pointers double their reach each time
        further = way[way]
        if np.array_equal(further, way):
            break
        way = further
    lowest_corner = faces[start][np.arange(len(start)), z[faces[start]].argmin(axis=1)]
    ends = np.unique(way[place[lowest_corner]])
    normals, _ = mesh.normals
    upward = np.full(len(z), -1.0)
    np.maximum.at(upward, place[faces].reshape(-1), np.repeat(normals[:, 2], 3))
    lowest = ends[(z[ends] > layer_mm) & (upward[ends] < UPWARD)]
    found: Array = mesh.vertices[lowest[np.argsort(z[lowest], kind="stable")]]
    return found


def _level_places(mesh: Mesh) -> Ints:
    """Return, for each vertex, a common representative (n,) of all vertices joined to it by level edges."""
    n, z = len(mesh.vertices), mesh.vertices[:, 2]
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    level = np.abs(z[start] - z[end]) <= ISLAND_LEVEL_MM
    label, _ = connect(start[level], end[level], n)
    _, first = np.unique(label, return_index=True)
    place: Ints = first[label]
    return place
