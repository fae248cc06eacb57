"""Numbers that tell knots apart, from a projection of the polygons: determinant, linking number.

They can refute a knot type and never prove one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["DETERMINANTS", "determinant", "expected_determinant", "linking_number"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_CROSSINGS = 1500
LARGEST = 1e12  # determinants up to here are whole numbers in double precision, with room to spare

# |Δ(-1)| of the prime knots up to 8 crossings, in the numbering of Alexander, Briggs and Rolfsen.
DETERMINANTS = {
    name: value
    for crossings, values in {
        0: (1,),
        3: (3,),
        4: (5,),
        5: (5, 7),
        6: (9, 11, 13),
        7: (7, 11, 13, 15, 17, 19, 21),
        8: (13, 17, 17, 19, 21, 23, 23, 25, 25, 27, 27, 29, 29, 31, 33, 35, 37, 45, 3, 9, 15),
    }.items()
    for name, value in ((f"{crossings}_{i}", v) for i, v in enumerate(values, start=1))
}
NAMES = {"unknot": "0_1", "trefoil": "3_1", "figure-eight": "4_1", "cinquefoil": "5_1"}


@dataclass(frozen=True)
class _Crossings:
    """Crossings of a projection: the strands above and below, as edge and place on it (0 to 1)."""

    over: Ints
    over_at: Array
    under: Ints
    under_at: Array
    sign: Ints


def expected_determinant(kind: str) -> int | None:
    """Determinant of a knot type such as "unknot", "3_1" or "3_1#4_1"; None if it is not known."""
    product = 1
    for part in kind.split("#"):
        name = part.strip().lower().removeprefix("m")
        value = DETERMINANTS.get(NAMES.get(name, name))
        if value is None:
            return None
        product *= value
    return product


def determinant(polygon: Array) -> int | None:
    """|Δ(-1)|, Δ the Alexander polynomial of a closed polygon (n, 3): 1 for every unknot.

    From the colouring matrix, a row for each crossing: twice the strand above less the two below
    (Livingston, "Knot theory", 1993, ch. 3). None where it cannot be had reliably: too many
    crossings, too large a number, or two projections that disagree.
    """
    found = {_determinant_seen_from(polygon, seed) for seed in (1, 2)}
    return found.pop() if len(found) == 1 else None


def linking_number(one: Array, other: Array) -> int:
    """How often one closed polygon winds round the other, with sign (Gauss)."""
    crossings = _crossings([one, other], seed=1)
    first = len(one)
    over_one = (crossings.over < first) & (crossings.under >= first)
    return int(crossings.sign[over_one].sum())


def _determinant_seen_from(polygon: Array, seed: int) -> int | None:
    crossings = _crossings([polygon], seed)
    count = len(crossings.under)
    if count > MOST_CROSSINGS:
        return None
    if count < 3:
        return 1
    # Strands run from one passage below to the next; number k ends at the k-th along the polygon.
    below = crossings.under + crossings.under_at
    order = np.argsort(below)
    ends = below[order]
    above = np.searchsorted(ends, (crossings.over + crossings.over_at)[order]) % count
    row = np.arange(count)
    matrix = np.zeros((count, count))
    np.add.at(matrix, (row, above), 2.0)
    np.add.at(matrix, (row, row), -1.0)
    np.add.at(matrix, (row, (row + 1) % count), -1.0)
    _, log_size = np.linalg.slogdet(matrix[1:, 1:])
    if not log_size < np.log(LARGEST):
        return None
    size = float(np.exp(log_size))
    whole = round(size)
    # A knot's determinant is odd.
    return whole if whole % 2 and abs(size - whole) < 1e-3 * max(1.0, size) ** 0.5 else None


def _crossings(polygons: Sequence[Array], seed: int) -> _Crossings:
    """All crossings seen from a random direction; edges are numbered through all polygons."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    start = np.concatenate(polygons) @ turn
    end = np.concatenate([np.roll(p, -1, axis=0) for p in polygons]) @ turn
    low, high = np.minimum(start, end), np.maximum(start, end)
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    i, j = shapely.STRtree(boxes).query(boxes)
    i, j = i[i < j], j[i < j]
    u, v, w = end[i] - start[i], end[j] - start[j], start[j] - start[i]
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / cross
        t = (w[:, 0] * u[:, 1] - w[:, 1] * u[:, 0]) / cross
    meet = (s > 0) & (s < 1) & (t > 0) & (t < 1) & ~_adjacent(polygons, i, j)
    i, j, s, t, cross = i[meet], j[meet], s[meet], t[meet], cross[meet]
    height_i = start[i, 2] + s * (end[i, 2] - start[i, 2])
    height_j = start[j, 2] + t * (end[j, 2] - start[j, 2])
    i_over = height_i > height_j
    # Right-handed when the strand above turns counter-clockwise into the one below.
    sign = np.where(i_over, np.sign(cross), -np.sign(cross)).astype(np.int64)
    return _Crossings(
        over=np.where(i_over, i, j),
        over_at=np.where(i_over, s, t),
        under=np.where(i_over, j, i),
        under_at=np.where(i_over, t, s),
        sign=sign * round(float(np.linalg.det(turn))),
    )


def _adjacent(polygons: Sequence[Array], i: Ints, j: Ints) -> NDArray[np.bool_]:
    """Whether edges i < j share a vertex: rounding may let them cross there."""
    sizes = np.array([len(p) for p in polygons])
    first = np.repeat(np.cumsum(sizes) - sizes, sizes)
    last = np.repeat(np.cumsum(sizes) - 1, sizes)
    result: NDArray[np.bool_] = (first[i] == first[j]) & (
        (j == i + 1) | ((i == first[i]) & (j == last[i]))
    )
    return result
