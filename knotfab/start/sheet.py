"""The start for two pictures: a simple curve on a sheet that both silhouettes see whole.

At each height both silhouettes are intervals; the path that runs through both from their first point
to their last, always forwards in each, draws both rows whole. These paths make a sheet in the visual
hull. Spread in the plane, each row as wide as the wider of the two, it is filled as one picture is;
the curve laid back on the sheet covers both. It goes forwards in both views, so it is simple as
seen from between them: an unknot, by inspection.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d, map_coordinates
from shapely import MultiPolygon

from knotfab.arrays import Array
from knotfab.target.silhouette import trace_polygon

__all__ = ["Row", "Rows", "laid_on", "rows_of", "sheet_of"]


_SNAP = 0.22  # gaps of both silhouettes at fractions this close are one gap
_SMALLEST = 6.0  # area in squared radii of a piece that is drawn
_PITCH = 0.25  # of the sheet's grid, in tube radii
_OUTSIDE = 0.05  # how fast the sheet goes on beyond a row's ends, against the plane


@dataclass(frozen=True)
class Row:
    """The sheet at one height: pieces from `left` to `right` in the plane, and what they are in each view.

    `one` and `other` are (n, 2): the ends of each piece across the two views, mm.
    """

    left: Array
    right: Array
    one: Array
    other: Array


@dataclass(frozen=True)
class Rows:
    """Rows at heights `low`, `low + pitch`, ... mm (None: nothing to draw), and their shape in the plane."""

    rows: tuple[Row | None, ...]
    low: float
    pitch: float
    shape: MultiPolygon


def rows_of(polygon: MultiPolygon, heights: Array) -> list[Array]:
    """The intervals (k, 2) of the polygon at each height, mm, left to right."""
    low_x, _, high_x, _ = polygon.bounds
    shapely.prepare(polygon)
    lines = shapely.linestrings([[(low_x - 1.0, y), (high_x + 1.0, y)] for y in heights.tolist()])
    found = []
    for cut in shapely.intersection(lines, polygon):
        parts = [(p.bounds[0], p.bounds[2]) for p in shapely.get_parts(cut) if p.length > 1e-6]
        found.append(np.array(sorted(parts), dtype=np.float64).reshape(-1, 2))
    return found


def _gaps(intervals: Array) -> Array:
    """Fractions of the total width at which the gaps lie."""
    width = intervals[:, 1] - intervals[:, 0]
    return np.asarray(np.cumsum(width)[:-1] / width.sum())


def _anchors(one: Array, other: Array) -> list[tuple[int, int]]:
    """Pairs of gaps that are taken as one: the nearest first, none crossing another."""
    pairs = sorted(
        (abs(a - b), i, j) for i, a in enumerate(one.tolist()) for j, b in enumerate(other.tolist())
    )
    kept: list[tuple[int, int]] = []
    for apart, i, j in pairs:
        if apart < _SNAP and all((i - k) * (j - m) > 0 for k, m in kept):
            kept.append((i, j))
    return sorted(kept)


def _at(intervals: Array, fraction: float) -> float:
    """The place at a fraction of the total width."""
    width = intervals[:, 1] - intervals[:, 0]
    before = np.concatenate([[0.0], np.cumsum(width)])
    k = int(np.clip(np.searchsorted(before, fraction * before[-1]) - 1, 0, len(width) - 1))
    return float(intervals[k, 0] + fraction * before[-1] - before[k])


def _pieces(one: Array, other: Array) -> tuple[Array, Array]:
    """Both rows cut at the gaps of either: (n, 2) ends in each, piece by piece."""
    gaps_one, gaps_other = _gaps(one), _gaps(other)
    anchors = _anchors(gaps_one, gaps_other)
    fixed_one = [0.0, *(float(gaps_one[i]) for i, _ in anchors), 1.0]
    fixed_other = [0.0, *(float(gaps_other[j]) for _, j in anchors), 1.0]
    # (fraction in one, in the other, gap in one or -1, gap in the other or -1)
    cuts = [(float(gaps_one[i]), float(gaps_other[j]), i, j) for i, j in anchors]
    for i, f in enumerate(gaps_one.tolist()):
        if all(i != k for k, _ in anchors):
            cuts.append((f, float(np.interp(f, fixed_one, fixed_other)), i, -1))
    for j, f in enumerate(gaps_other.tolist()):
        if all(j != k for _, k in anchors):
            cuts.append((float(np.interp(f, fixed_other, fixed_one)), f, -1, j))
    cuts.sort()
    ends_one, ends_other = [float(one[0, 0])], [float(other[0, 0])]
    for f, g, i, j in cuts:
        ends_one += [float(one[i, 1]), float(one[i + 1, 0])] if i >= 0 else [_at(one, f)] * 2
        ends_other += (
            [float(other[j, 1]), float(other[j + 1, 0])] if j >= 0 else [_at(other, g)] * 2
        )
    ends_one.append(float(one[-1, 1]))
    ends_other.append(float(other[-1, 1]))
    return np.array(ends_one).reshape(-1, 2), np.array(ends_other).reshape(-1, 2)


def _row(one: Array, other: Array, pitch: float) -> Row | None:
    if len(one) == 0 or len(other) == 0:
        return None
    first, second = _pieces(one, other)
    width = np.maximum(first[:, 1] - first[:, 0], second[:, 1] - second[:, 0])
    apart = first[1:, 0] - first[:-1, 1] + second[1:, 0] - second[:-1, 1]
    gap = np.maximum(apart, 2.5 * pitch)
    left = np.concatenate([[0.0], np.cumsum(width[:-1] + gap)])
    middle = 0.5 * (first.mean(1) + second.mean(1))
    shift = float((width * (middle - left - 0.5 * width)).sum() / width.sum())
    left = left + shift
    return Row(left, left + width, first, second)


def sheet_of(one: MultiPolygon, other: MultiPolygon, radius: float) -> Rows:
    """The sheet between two silhouettes whose axes lie level, each in mm (across, up).

    Heights that only one of them has are left out: nothing can be drawn there without a spill in the
    other.
    """
    pitch = _PITCH * radius
    low, high = max(one.bounds[1], other.bounds[1]), min(one.bounds[3], other.bounds[3])
    heights = low + pitch * (np.arange(max(1, int((high - low) / pitch))) + 0.5)
    rows = tuple(
        _row(a, b, pitch)
        for a, b in zip(rows_of(one, heights), rows_of(other, heights), strict=True)
    )
    drawn = [row for row in rows if row is not None]
    left = min((float(row.left[0]) for row in drawn), default=0.0) - 3 * pitch
    right = max((float(row.right[-1]) for row in drawn), default=0.0) + 3 * pitch
    at = left + pitch * (np.arange(int((right - left) / pitch) + 1) + 0.5)
    mask = np.zeros((len(rows) + 2, len(at)), dtype=bool)
    for k, row in enumerate(rows):
        if row is not None:
            inside = (at[:, None] >= row.left) & (at[:, None] <= row.right)
            mask[len(rows) - k] = inside.any(1)
    if not mask.any():
        return Rows(rows, low, pitch, MultiPolygon())
    traced = trace_polygon(mask)

    def to_plane(pixels: Array) -> Array:
        x = at[0] + pitch * pixels[:, 0]
        y = heights[0] + pitch * (len(rows) - pixels[:, 1])
        return np.column_stack([x, y])

    # the rows' steps are rounded off: rings about them would touch each other
    shape = shapely.transform(traced, to_plane).buffer(0)
    shape = shape.buffer(-0.5 * radius).buffer(radius).buffer(-0.5 * radius)
    least = _SMALLEST * radius**2
    parts = [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon" and p.area > least]
    return Rows(rows, low, pitch, MultiPolygon(parts))


def laid_on(sheet: Rows, curve: Array, radius: float, spread: float = 0.0) -> Array:
    """A curve (n, 2) of the sheet's plane as (n, 3): across one view, across the other, height.

    Along each row both go forwards, and so does any mean of rows: the plane is bent without a fold.
    `spread`, in mm of height, evens out the jumps between rows, and with them what they pack
    together, at the cost of some spill.
    """
    low = min(float(curve[:, 0].min()), *(float(r.left[0]) for r in sheet.rows if r)) - sheet.pitch
    high = max(float(curve[:, 0].max()), *(float(r.right[-1]) for r in sheet.rows if r))
    at = np.arange(low, high + 2 * sheet.pitch, sheet.pitch)
    known = np.flatnonzero([row is not None for row in sheet.rows])
    across = np.stack([_across(row, at, radius) for row in sheet.rows if row is not None])
    nearest = np.abs(np.arange(len(sheet.rows))[:, None] - known).argmin(1)
    across = across[nearest]
    if spread > 0:
        across = gaussian_filter1d(across, spread / sheet.pitch, axis=0, mode="nearest")
    where = np.stack(
        [(curve[:, 1] - sheet.low) / sheet.pitch - 0.5, (curve[:, 0] - low) / sheet.pitch]
    )
    one, other = (map_coordinates(across[:, :, k], where, order=1, mode="nearest") for k in (0, 1))
    return np.column_stack([one, other, curve[:, 1]])


def _across(row: Row, x: Array, radius: float) -> Array:
    """(n, 2) where the plane's x lie across both views, a radius inside each piece that has that room."""
    knots: list[float] = []
    one: list[float] = []
    other: list[float] = []
    for k in range(len(row.left)):
        wide = row.right[k] - row.left[k]
        inset = min(radius, 0.4 * wide)
        knots += [row.left[k], row.left[k] + inset, row.right[k] - inset, row.right[k]]
        for ends, into in ((row.one[k], one), (row.other[k], other)):
            # never the same place twice, or strands in a thin part would run into each other
            room = min(radius, 0.4 * (ends[1] - ends[0]))
            into += [ends[0] + 0.7 * room, ends[0] + room, ends[1] - room, ends[1] - 0.7 * room]
    far = 1e3 * radius
    knots = [knots[0] - far, *knots, knots[-1] + far]
    laid = [[v[0] - _OUTSIDE * far, *v, v[-1] + _OUTSIDE * far] for v in (one, other)]
    return np.stack([np.interp(x, knots, v) for v in laid], axis=1)
