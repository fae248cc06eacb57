"""Roots: flat strips, in the shadow of the piece itself, that join its feet and two pads for screws."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.errors import SceneError
from knotfab.picture.silhouette import trace_polygon
from knotfab_validators.shadows.told import tell_flat

if TYPE_CHECKING:
    from shapely import Geometry, Polygon

WIDTH_MM = 7.0  # of strips; 10 mm spare tape, and a piece tells .05 more
# what a screw's height is worth of its distance from the other: tried in turn to spare tape
RISES = 0.3, 2.0
CORE_MM = 1.2  # half the width that a strip keeps where the shadow is thinner
MOST_OUTSIDE = 0.0005  # share of the frame that strips may darken beside the shadow
TELLS = 0.5  # share told from which on a holder shows the picture
FEET_APART_MM = 22.0  # usual feet
_RIM_MM = 1.8  # about a screw's hole
_INSET_MM = 0.15  # of the strips in the shadow, which is known to so much
_CELL_MM = 1.0  # of the grid on which ways are sought
_OUTSIDE = 30.0  # how much longer a way counts beside the shadow
_SLIT_MM = 0.6  # slits of light up to twice as wide are closed, as they are in the picture
_SMOOTH_MM = 0.7  # corners of the grid that a way cuts


class NoWayError(SceneError):
    """No shadow leads roots from one foot to another."""


@dataclass(frozen=True)
class Roots:
    """Strips on the wall: their `sheet`, the screw holes in it (0 or 2, 2), and the lines within.

    `points` (n, 2), mm, are joined by `ends` (m, 2), strips `widths` (m,) wide. The feet are the first of
    the points, and the holes follow them.
    """

    sheet: Polygon
    holes: Array
    points: Array
    ends: Indices
    widths: Array


def lay_roots(
    dark: Geometry,
    feet: Array,
    prints: Geometry,
    hole_mm: float,
    width_mm: float,
    most_mm2: float,
    rise: float = RISES[0],
) -> Roots:
    """Join feet (n, 2) and pads by a tree of strips along the middle of the shadow.

    Args:
        dark: where the wall is dark. prints: what the feet cover of it. most_mm2: how much of the strips
            may lie elsewhere. rise: how much farther apart screws would have to be to lie so much lower.

    Raises:
        NoWayError: too much of them would show.
    """
    import shapely

    dark = dark.buffer(_SLIT_MM).buffer(-_SLIT_MM - _INSET_MM)
    holes = _place_holes(dark, prints, hole_mm, rise)
    ends = np.concatenate([feet, holes])
    lines, points, pairs = _find_ways(dark.union(prints), ends, width_mm)
    ways = shapely.union_all([*lines, *shapely.points(ends)])
    pads = shapely.union_all(shapely.points(holes)).buffer(hole_mm / 2 + _RIM_MM)
    core = shapely.union_all([ways.buffer(CORE_MM), prints, pads])
    wide = shapely.union_all([ways.buffer(width_mm / 2), pads.buffer(_RIM_MM)])
    body = wide.intersection(dark).union(core).buffer(0.4).buffer(-0.7).buffer(0.3).union(core)
    sheet = max(shapely.get_parts(body), key=lambda part: float(part.area))
    openings = [ring for ring in sheet.interiors if shapely.Polygon(ring).area > CORE_MM**2]
    sheet = shapely.Polygon(sheet.exterior, openings).simplify(0.04)
    outside = float(sheet.difference(dark.buffer(_INSET_MM).union(prints)).area)
    if outside > most_mm2 or not sheet.buffer(0.1).contains(ways):
        raise NoWayError(
            "roots, in which the piece stands (--plate roots)",
            f"no shadow leads from one foot to another: {outside:.0f} mm² of them would show",
            "Use --plate rounded",
        )
    beside = shapely.distance(dark.boundary, shapely.points(points[pairs].mean(axis=1)))
    widths = np.clip(np.nan_to_num(2 * beside), 2 * CORE_MM, width_mm)  # no shadow: not a number
    return Roots(sheet, holes, points, pairs, widths)


def suits_roots(target: Mask, mm_per_px: float) -> bool:
    """Guess whether roots join the feet of a piece that draws a silhouette (H, W), and tell little of it."""
    import shapely

    roots = guess_roots(target, mm_per_px)
    if roots is None:
        return False
    x, y = np.meshgrid(*(np.arange(n) * mm_per_px for n in target.shape[::-1]))
    return tell_flat(shapely.contains_xy(roots.sheet, x, y), target) < TELLS


def guess_roots(target: Mask, mm_per_px: float) -> Roots | None:
    """Lay roots between feet all over a silhouette (H, W), mm right of and below its corner; None: no way."""
    import shapely

    dark = shapely.affinity.scale(trace_polygon(target), mm_per_px, mm_per_px, origin=(0, 0))
    if dark.is_empty:  # a pixel or two
        return None
    x0, y0, x1, y1 = dark.bounds
    x, y = np.meshgrid(np.arange(x0, x1, 3 * _CELL_MM), np.arange(y0, y1, 3 * _CELL_MM))
    within = shapely.contains_xy(dark, x, y)
    spots = np.column_stack([x[within], y[within]])
    feet = list[Array]()
    left = spots if len(spots) else np.array(dark.representative_point().coords)
    while len(left):
        feet.append(left[0])
        left = left[np.linalg.norm(left - feet[-1], axis=1) > FEET_APART_MM]
    prints = shapely.union_all(shapely.points(np.array(feet))).buffer(2 * CORE_MM)
    most = MOST_OUTSIDE * mm_per_px**2 * target.size
    try:
        return lay_roots(dark, np.array(feet), prints, 4.0, WIDTH_MM, most)
    except NoWayError:
        return None


def _place_holes(dark: Geometry, prints: Geometry, hole_mm: float, rise: float) -> Array:
    """Place two screw holes in the shadow beside the feet, level and far apart; none where none fit."""
    import shapely

    room = dark.buffer(-hole_mm / 2 - _RIM_MM).difference(prints.buffer(hole_mm / 2 + 0.8))
    if room.is_empty:
        return np.empty((0, 2))
    x0, y0, x1, y1 = room.bounds
    x, y = np.meshgrid(np.arange(x0, x1, 2 * _CELL_MM), np.arange(y0, y1, 2 * _CELL_MM))
    inside = shapely.contains_xy(room, x, y)
    rows = np.flatnonzero(inside.any(axis=1))
    ends = np.array([x[row, inside[row]][[0, -1]] for row in rows]).reshape(-1, 2)
    apart, high = np.ptp(ends, axis=1), y[rows, 0]
    far = apart >= 0.25 * np.hypot(*np.subtract(dark.bounds[2:], dark.bounds[:2]))
    if not far.any():
        return np.empty((0, 2))
    best = int(np.where(far, apart + rise * high, -np.inf).argmax())
    return np.column_stack([ends[best], np.full(2, high[best])])


def _find_ways(
    dark: Geometry, ends: Array, width_mm: float
) -> tuple[list[Geometry], Array, Indices]:
    """Find a short tree of ways that joins all ends (n, 2), along the middle of the shadow.

    Of all pairs of ends whose cells meet on a grid, those of the least tree are joined (Mehlhorn 1988: at
    most twice as long as the shortest tree).

    Returns:
        The ways' lines; their points (m, 2), the ends first; and the pairs of points that follow each other.
    """
    import shapely
    from scipy.ndimage import distance_transform_edt
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

    low = np.array(dark.bounds[:2]) - 2 * _CELL_MM
    size = np.ceil((np.array(dark.bounds[2:]) - low) / _CELL_MM).astype(int) + 3
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    grid = low + _CELL_MM * np.column_stack([columns.ravel(), rows.ravel()])
    inside = shapely.contains_xy(dark, grid[:, 0], grid[:, 1]).reshape(columns.shape)
    deep = _CELL_MM * distance_transform_edt(inside)
    price = np.where(inside, 1.0 + 2.0 * np.clip(1 - 2 * deep / width_mm, 0, 1), _OUTSIDE)
    at = np.rint((ends - low) / _CELL_MM).astype(int)
    starts = at[:, 1] * size[0] + at[:, 0]
    one, other, length = _list_steps(columns.shape)
    cost = _CELL_MM * length * 0.5 * (price.ravel()[one] + price.ravel()[other])
    graph = coo_array((cost, (one, other)), shape=(len(grid), len(grid))).tocsr()
    far, before, source = dijkstra(
        graph, directed=False, indices=np.unique(starts), min_only=True, return_predecessors=True
    )
    meet = np.flatnonzero(source[one] != source[other])
    total = far[one[meet]] + cost[meet] + far[other[meet]]
    order = meet[np.argsort(total, kind="stable")]
    pair = np.sort(np.column_stack([source[one[order]], source[other[order]]]), axis=1)
    pair, first = np.unique(pair, axis=0, return_index=True)
    best = order[first]
    cells, index = np.unique(starts, return_inverse=True)
    place = np.searchsorted(cells, pair)
    least = np.sort(total)[first]
    tree = minimum_spanning_tree(
        coo_array((least, (place[:, 0], place[:, 1])), shape=(len(cells),) * 2).tocsr()
    ).tocoo()
    kept = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    here = {int(cell): int(np.flatnonzero(index == k)[0]) for k, cell in enumerate(cells)}
    lines: list[Geometry] = []
    points, pairs = [*ends], list[tuple[int, int]]()
    for k, (a, b) in enumerate(place.tolist()):
        if (a, b) not in kept:
            continue
        halves = [_trace(before, int(cell)) for cell in (one[best[k]], other[best[k]])]
        way = [*halves[0][::-1], *halves[1]]
        inner = shapely.LineString([ends[here[way[0]]], *grid[way[1:-1]], ends[here[way[-1]]]])
        line = np.array(inner.simplify(_SMOOTH_MM).segmentize(10.0).coords)
        lines.append(shapely.LineString(line))
        numbers = [here[way[0]], *range(len(points), len(points) + len(line) - 2), here[way[-1]]]
        points += list(line[1:-1])
        pairs += pairwise(numbers)
    # ends in one cell
    pairs += [(k, here[int(cell)]) for k, cell in enumerate(starts) if here[int(cell)] != k]
    return lines, np.array(points), np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _trace(before: Indices, cell: int) -> list[int]:
    """List the cells from one back to the end that it is nearest to."""
    way = [cell]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return way


def _list_steps(shape: tuple[int, int]) -> tuple[Indices, Indices, Array]:
    """List the steps between neighbouring cells of a grid, straight and across corners, and their lengths."""
    cell = np.arange(shape[0] * shape[1]).reshape(shape)
    pairs = [
        (cell[:, :-1], cell[:, 1:]),
        (cell[:-1], cell[1:]),
        (cell[:-1, :-1], cell[1:, 1:]),
        (cell[:-1, 1:], cell[1:, :-1]),
    ]
    length = [
        np.full(a.size, step) for (a, _), step in zip(pairs, (1, 1, 2**0.5, 2**0.5), strict=True)
    ]
    one, other = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    return one, other, np.concatenate(length)
