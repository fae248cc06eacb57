"""Follow how the layers of a part grow out of each other: what stands on what, and what reaches over air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.mesh import connect
from knotfab_validators.printing.slices import Slices, bound_pieces, link_pieces, measure_pieces

SPECK_MM2 = 0.05  # what begins in mid-air and stays this small until it is held is no island
LINE_MM = 0.3  # what reaches over air no farther is ignored: most of a line's width is held
CAP_MM = 6.0  # distances over air are measured up to this, which exceeds half of any bridge
SPAN_MM = 40.0  # the longest bridge that is looked for
DIRECTIONS = 36  # directions over half a turn in which a bridge is looked for
BESIDE_MM = 0.6  # from a bridge's line: matter so near it hangs on it; half of what may reach out
TRIED = 24  # places tested in one stretch


@dataclass(frozen=True)
class Growth:
    """The connected pieces of all layers, and what they stand on.

    `area` (p,), mm², and `middle` (p, 3), mm, are those of the section; `round_mm2` (p,) is its
    area at right angles to the leg. `body` (p,) numbers what is connected once all is printed.
    `held` (p,) tells whether a path leads down to the bed; `island` (k,) are the pieces that begin
    in mid-air. `free` (p,), mm, is the length of a leg since its foot, or since another one last
    joined it. `limp` (p,), 1/mm, is the deflection of its end under a transverse force, times the
    modulus; `top` (p,) tells whether it ends there.
    """

    area: Array
    middle: Array
    round_mm2: Array
    body: Ints
    held: Mask
    island: Ints
    free: Array
    limp: Array
    top: Mask


def follow_growth(cut: Slices, wall_mm: float = np.inf) -> Growth:
    """Follow each piece of each layer down to what it stands on.

    A leg is a cantilever from the bed with the sections that it has. Its end moves by the sum of (L
    - s)² ds / E I(s), with I = A² / 4 pi of a round section of the same area: L³ / 3 E I if it is
    even. What loops leave empty is taken off, about the weaker axis: their wall, `wall_mm` thick in every
    layer, is thinner across a leg that leans, on the sides to which it leans. Where two pieces that
    reach the bed grow together, as at the peak of an arch or at a bar, they brace each other, and what goes
    on from there starts afresh.
    """
    area, flat = measure_pieces(cut)
    pieces = len(area)
    pairs = link_pieces(cut.first, cut.left, cut.right, cut.piece, cut.rows)
    once = np.unique(pairs[:, 0] * pieces + pairs[:, 1])
    pairs = np.column_stack([once // pieces, once % pieces])
    begin = np.searchsorted(pairs[:, 0], np.arange(pieces + 1))
    below = np.ascontiguousarray(pairs[:, 1])
    split = np.bincount(below, minlength=pieces)
    held, start, free, limp, top, square = _grow(
        cut.floor, area, flat, bound_pieces(cut), begin, below, split, cut.layer, cut.row, wall_mm
    )
    largest = np.zeros(pieces)
    np.maximum.at(largest, start[~held], area[~held])
    body, _ = connect(pairs[:, 0], below, pieces)
    middle = np.column_stack([flat, cut.height(cut.floor)])
    lone = np.flatnonzero(largest >= SPECK_MM2)
    return Growth(area, middle, square, body, held, lone, free, limp, top)


@compiled
def _grow(
    floor: Ints,
    area: Array,
    middle: Array,
    box: Array,
    begin: Ints,
    below: Ints,
    split: Ints,
    layer: float,
    row: float,
    wall: float,
) -> tuple[Mask, Ints, Array, Array, Mask, Array]:
    pieces = len(area)
    held, top = np.zeros(pieces, dtype=np.bool_), np.ones(pieces, dtype=np.bool_)
    start = np.arange(pieces)
    free, limp, square = np.zeros(pieces), np.zeros(pieces), area.copy()
    sums = np.zeros((pieces, 3))
    for n in range(pieces):
        legs, leg = 0, n
        for at in range(begin[n], begin[n + 1]):
            if held[below[at]]:
                legs += 1
                leg = below[at]
            else:
                start[n] = start[below[at]]
        held[n] = floor[n] == 0 or legs > 0
        if legs != 1:
            continue
        # where a piece splits in two, the direction of each from their common centre is unknown
        step = layer
        if split[leg] == 1:
            for axis in range(2):
                step = np.hypot(step, _moved(middle, box, n, leg, axis, row))
        square[n] = area[n] * layer / step
        around = np.sqrt(square[n] / np.pi)  # the radius of a round leg
        beside, above = max(around - wall, 0.0), max(around - wall * layer / step, 0.0)
        s, soft = free[leg] + step / 2, 4 * step / np.pi / max(around**4 - beside * above**3, 1e-12)
        sums[n, 0] = sums[leg, 0] + soft
        sums[n, 1] = sums[leg, 1] + soft * s
        sums[n, 2] = sums[leg, 2] + soft * s * s
        end = free[leg] + step
        free[n] = end
        limp[n] = end * end * sums[n, 0] - 2 * end * sums[n, 1] + sums[n, 2]
        # a speck at the tip of a peak is no line that a nozzle would drag at: the leg ends below it
        if area[n] < SPECK_MM2:
            top[n] = False
        else:
            top[leg] = False
    return held, start, free, limp, top, square


@compiled
def _moved(middle: Array, box: Array, n: int, leg: int, axis: int, row: float) -> float:
    """Measure how far a leg shifts along an axis, by its middle, but not if only part of a foot ends.

    The middle moves then, too, but one side of its box stays, whereas both sides move if the whole leg does.
    """
    low = box[n, 2 * axis] - box[leg, 2 * axis]
    high = box[n, 2 * axis + 1] - box[leg, 2 * axis + 1]
    both = min(abs(low), abs(high)) if low * high > 0 else 0.0
    return float(min(abs(middle[n, axis] - middle[leg, axis]), both + row))


@dataclass(frozen=True)
class OverAir:
    """Stretches that a layer lays over air by more than `LINE_MM`, one entry for each.

    `reach` (n,), mm: how far its farthest `place` (n, 3) is from what the layer below holds. `span` (n,),
    mm:
    the shortest straight line through the layer and that place, from side to side; infinite for a ledge.
    """

    reach: Array
    span: Array
    place: Array


def find_over_air(cut: Slices, held: Mask) -> OverAir:
    """Find what reaches over air, except the pieces that nothing holds, which are islands.

    A bridge passes within `BESIDE_MM` of the farthest place: a narrow bar's sides are farther out than its
    middle, and a line along one side may miss what the bar lies on.
    """
    asked = cut.first, cut.left, cut.right, cut.piece, held, cut.rows, cut.row
    count, most = 65_536, 0  # places; where there are more, all are sought again
    while count > most:
        most = count
        bucket, x, away = np.empty(most, np.int64), np.empty(most), np.empty(most)
        count = _reach(*asked, bucket, x, away)
    bucket, x, away = bucket[:count], x[:count], away[:count]
    if not count:
        return OverAir(np.empty(0), np.empty(0), np.empty((0, 3)))
    label, count = _group(bucket, x / cut.row, cut.rows)
    order = np.lexsort((-away, label))
    ends = np.append(np.flatnonzero(np.diff(label[order], prepend=-1)), len(order))
    reach, span, chosen = np.empty(count), np.full(count, np.inf), np.empty(count, dtype=np.int64)
    for k in range(count):
        own = order[ends[k] : ends[k + 1]]
        reach[k], chosen[k] = away[own[0]], own[0]
        aside = np.hypot(x[own] - x[own[0]], cut.row * (bucket[own] - bucket[own[0]]))
        near = own[aside <= BESIDE_MM]
        for i in near[:: max(len(near) // TRIED, 1)]:
            found = _span(cut.first, cut.left, cut.right, cut.rows, cut.row, int(bucket[i]), x[i])
            span[k] = min(span[k], found)
    y = cut.south + cut.row * (bucket[chosen] % cut.rows)
    z = cut.height(bucket[chosen] // cut.rows)
    return OverAir(reach, span, np.column_stack([x[chosen], y, z]))


def _group(bucket: Ints, x: Array, rows: int) -> tuple[Ints, int]:
    """Label the adjacent places of each layer, in rows and in steps of one row's width."""
    from scipy.spatial import cKDTree

    points = np.column_stack([x, bucket % rows, 4.0 * (bucket // rows)])
    pairs = cKDTree(points).query_pairs(1.6, output_type="ndarray")
    return connect(pairs[:, 0], pairs[:, 1], len(x))


@compiled
def _away(
    first: Ints, left: Array, right: Array, rows: int, row: float, k: int, j: int, x: float
) -> float:
    """Measure how far a place in row j of layer k is from material in the layer below, up to `CAP_MM`.

    Below `LINE_MM` any distance that some material has will do.
    """
    best = CAP_MM
    for step in range(int(CAP_MM / row) + 1):
        if step * row >= best:
            break
        for side in range(2 if step else 1):
            other = j + step if side else j - step
            if other < 0 or other >= rows:
                continue
            bucket = (k - 1) * rows + other
            for b in range(first[bucket], first[bucket + 1]):
                if left[b] > x + best:
                    break
                off = max(left[b] - x, x - right[b], 0.0)
                best = min(best, np.hypot(off, step * row))
            if best <= LINE_MM:
                return best
    return best


@compiled
def _reach(
    first: Ints,
    left: Array,
    right: Array,
    piece: Ints,
    held: Mask,
    rows: int,
    row: float,
    bucket_of: Ints,
    x_of: Array,
    far: Array,
) -> int:
    """Count the places farther than `LINE_MM` from the layer below.

    The row, x and distance of as many as there is room for are written to the last three.
    """
    count = 0
    for bucket in range(rows, len(first) - 1):
        k, j = bucket // rows, bucket % rows
        for a in range(first[bucket], first[bucket + 1]):
            if not held[piece[a]]:
                continue
            begin, b, last = left[a], first[bucket - rows], first[bucket - rows + 1]
            while begin < right[a]:
                while b < last and right[b] <= begin:
                    b += 1
                if b < last and left[b] <= begin:
                    begin = right[b]
                    continue
                end = min(right[a], left[b]) if b < last else right[a]
                steps = max(int(np.ceil((end - begin) / row)), 1)
                for i in range(steps + 1):
                    x = begin + (end - begin) * i / steps
                    away = _away(first, left, right, rows, row, k, j, x)
                    if away <= LINE_MM:
                        continue
                    if count < len(x_of):
                        bucket_of[count], x_of[count], far[count] = bucket, x, away
                    count += 1
                begin = end
    return count


@compiled
def _is_inside(first: Ints, left: Array, right: Array, bucket: int, x: float) -> bool:
    found = False
    for b in range(first[bucket], first[bucket + 1]):
        found = found or left[b] <= x <= right[b]
    return found


@compiled
def _span(
    first: Ints, left: Array, right: Array, rows: int, row: float, bucket: int, x: float
) -> float:
    """Find the shortest straight line through a layer and a place, with both ends on the layer below."""
    k, j, best = bucket // rows, bucket % rows, np.inf
    stride = row / 2
    for d in range(DIRECTIONS):
        turn = np.pi * d / DIRECTIONS
        total = 0.0
        for side in (-1.0, 1.0):
            found = False
            for n in range(1, int(SPAN_MM / stride)):
                at = x + side * n * stride * np.cos(turn)
                other = j + int(np.rint(side * n * stride * np.sin(turn) / row))
                if other < 0 or other >= rows or total + n * stride >= best:
                    break
                if not _is_inside(first, left, right, k * rows + other, at):
                    break
                if _is_inside(first, left, right, (k - 1) * rows + other, at):
                    total += n * stride
                    found = True
                    break
            if not found:
                total = np.inf
                break
        best = min(best, total)
    return best
