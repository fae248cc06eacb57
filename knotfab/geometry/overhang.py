"""Fast estimates for a print pose: its supports, its stability, and its spans in mid-air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from knotfab.base.arrays import Array, Indices
from knotfab.base.compiled import compiled
from knotfab.geometry.polylines import arc_lengths, points_at
from knotfab_formats.slicer_ini import ROOF_GAP_MM, ROOF_LAYERS, SPACING_MM

FINEST_RADII = 0.8  # tube radii between two samples of a centre line
STRIPS = (-0.8, -0.4, 0.0, 0.4, 0.8)  # across the underside, in halves of its width
CELL_RADII = 1.0  # cells of grid cells, by which the strand below another is found

# Supports weigh what their lines do: both edges of a strand's underside, lines between, a roof below it.
# Lines along a strand: neighbours share some (PrusaSlicer 2.5, tube radii 1.8 to 3.7 mm).
EDGES = 1.7


@dataclass(frozen=True)
class Rules:
    """The printer's limits on overhangs ([printer] of the scene).

    `margin_mm`: the room that supports take at the sides of a piece, where they stick out of it.
    `support_line_mm`: width of their lines. `powder`: it carries the piece, so that no pose needs
    supports and only the room it takes counts.
    """

    max_overhang_deg: float = 45.0
    layer_mm: float = 0.2
    supports: bool = True
    max_support_cm3: float | None = None
    max_bridge_mm: float = 10.0
    margin_mm: float = 0.0
    support_line_mm: float = 0.36
    powder: bool = False


@dataclass(frozen=True)
class Strands:
    """Centre lines as short rods: middles (n, 3), unit directions (n, 3), lengths (n,), mm.

    `sizes` are the numbers of rods of each knot, in order; `radius` is the tube's.
    """

    middle: Array
    along: Array
    length: Array
    sizes: tuple[int, ...]
    radius: float


@dataclass(frozen=True)
class Estimate:
    """A pose in numbers.

    `support_cm3`: solid columns under undersides steeper than the limit. `height_mm`. `contact_mm2`:
    of the first layer, without supports. `tip_deg`: how far the piece may lean before it falls off
    the hull of what stands on the bed, supports included (0: it falls at once). `starts`: places that
    begin in mid-air. `bridge_mm`: the longest stretch that stays within one layer over air.
    `filament_cm3`: what the slicer makes of the columns (`_weigh_supports`).
    """

    support_cm3: float
    height_mm: float
    contact_mm2: float
    tip_deg: float
    starts: int
    bridge_mm: float
    filament_cm3: float = 0.0


def strands_along(
    curves: Sequence[Array], radius: float, closed: Sequence[bool] | None = None, most: int = 6000
) -> Strands:
    """Cut every curve (n, 3), mm, into rods of even length, about `FINEST_RADII` radii, `most` in all.

    Args:
        closed: which of the curves are; None: all.
    """
    closed = [True] * len(curves) if closed is None else closed
    whole = [np.vstack([c, c[:1]]) if shut else c for c, shut in zip(curves, closed, strict=True)]
    arcs = [arc_lengths(curve, closed=False) for curve in whole]
    pitch = max(FINEST_RADII * radius, sum(float(arc[-1]) for arc in arcs) / most)
    ends, counts = [], []
    for curve, arc in zip(whole, arcs, strict=True):
        count = max(8, int(np.ceil(arc[-1] / pitch)))
        at = np.linspace(0.0, arc[-1], count + 1)
        ends.append(points_at(curve, arc, at))
        counts.append(count)
    middle = np.concatenate([(p[1:] + p[:-1]) / 2 for p in ends])
    step = np.concatenate([np.diff(p, axis=0) for p in ends])
    length = np.linalg.norm(step, axis=1)
    along = step / np.maximum(length, 1e-12)[:, None]
    return Strands(middle, along, length, tuple(counts), radius)


def estimate(strands: Strands, turn: Array, rules: Rules) -> Estimate:
    """Estimate a pose; `turn` (3, 3) takes the strands to the bed, its third row points up.

    `starts` and `bridge_mm` matter, and are worked out, only where nothing may be supported.

    A rod at angle t from the vertical hangs over where its normal is within a of straight down,
    cos a = sin(limit) / sin t: an underside 2 r sin a wide. It is cut into strips; a strip's column
    reaches down to what fills the grid's cell below it. About 2 ms for 6000 rods.
    """
    r = strands.radius
    pose = _PosedStrands.turned(strands, turn, rules)
    z, level = pose.at[:, 2], pose.level
    columns = pose.columns(rules)
    tall, area = columns.tall, columns.area
    curtain = float((tall * np.tile(strands.length * level, len(STRIPS)) / len(STRIPS)).sum())
    volume = columns.volume_cm3
    filament = _weigh_supports(1000 * volume, curtain, float(area[tall > 0].sum()), rules) / 1000
    bottom = z - r * level
    low = bottom <= rules.layer_mm
    # width of a tube's section one layer above where it touches the bed
    deep = np.clip(rules.layer_mm - bottom, 0.0, r)
    contact = float((strands.length * level * 2 * np.sqrt(deep * (2 * r - deep)))[low].sum())
    middle = columns.floor.reshape(len(STRIPS), -1)[len(STRIPS) // 2]
    on_bed = low | ((pose.wide > 0) & (middle <= 0))
    tip = _tip(pose.at[:, :2], z, strands.length, on_bed, r)
    starts, bridge = 0, 0.0
    if not rules.supports:
        starts, bridge = _over_air(strands, pose.at, bottom, rules.layer_mm)
    height = float((z + r * level).max())
    return Estimate(volume, height, contact, tip, starts, bridge, filament)


def support_cm3(strands: Strands, turn: Array, rules: Rules) -> float:
    """Return only the `support_cm3` of `estimate`, which is quick enough for thousands of curves."""
    return _PosedStrands.turned(strands, turn, rules).columns(rules).volume_cm3


@dataclass(frozen=True)
class _Columns:
    """The column under each strip, strip after strip: its height, area and base, mm."""

    tall: Array
    floor: Array
    area: Array

    @property
    def volume_cm3(self) -> float:
        return float((self.tall * self.area).sum()) / 1000


@dataclass(frozen=True)
class _PosedStrands:
    """Rods on the bed: middles (n, 3), the lowest surface at 0; directions; sine of the angle from the
    vertical; half the width of the underside that hangs over."""

    strands: Strands
    at: Array
    along: Array
    level: Array
    wide: Array

    @classmethod
    def turned(cls, strands: Strands, turn: Array, rules: Rules) -> _PosedStrands:
        r, at, along = strands.radius, strands.middle @ turn.T, strands.along @ turn.T
        level = np.hypot(along[:, 0], along[:, 1])
        at[:, 2] -= float((at[:, 2] - r * level).min())
        cosine = np.sin(np.radians(rules.max_overhang_deg)) / np.maximum(level, 1e-9)
        return cls(strands, at, along, level, r * np.sqrt(np.clip(1.0 - cosine**2, 0.0, 1.0)))

    def columns(self, rules: Rules) -> _Columns:
        flat, z = self.at[:, :2], self.at[:, 2]
        under, floor, area = _columns(self.strands, flat, self.along, self.level, z, self.wide)
        off_bed = under > rules.layer_mm
        return _Columns(
            np.where(off_bed & (area > 0), under - floor, 0.0).clip(min=0.0), floor, area
        )


def _weigh_supports(volume: float, curtain: float, roof: float, rules: Rules) -> float:
    """Return the filament, mm³, in supports of a `volume`, mm³, below undersides of area `roof`, mm².

    A strand's support is a wall as narrow as its underside: a line along either edge, and lines across
    it. `curtain`, mm², is its length times its height.
    """
    line = rules.support_line_mm
    lines = line * (EDGES * curtain + volume / (SPACING_MM + line))
    return lines + ROOF_LAYERS * rules.layer_mm * roof * line / (line + ROOF_GAP_MM)


def _columns(
    strands: Strands, flat: Array, along: Array, level: Array, z: Array, wide: Array
) -> tuple[Array, Array, Array]:
    """Return each strip's lower end, the height of what lies below it, and its area."""
    some = len(STRIPS) * len(z)
    cell = max(CELL_RADII * strands.radius, float(strands.length.max()))
    cells, low, high, area = _strips(
        flat, along, level, strands.length, z, wide, strands.radius, cell
    )
    return low[:some], _floors(cells, low, high)[:some], area[:some]


@compiled
def _strips(
    flat: Array,
    along: Array,
    level: Array,
    length: Array,
    z: Array,
    wide: Array,
    radius: float,
    cell: float,
) -> tuple[Indices, Array, Array, Array]:
    """Cut rods into strips; return each one's grid cell, lowest and highest point, and area of underside.

    Two more strips at the tube's sides need no support, but the support of others may stand on them.
    """
    n, inner = len(flat), len(STRIPS)
    count = (inner + 2) * n
    x, y = np.empty(count), np.empty(count)
    low, high, area = np.empty(count), np.empty(count), np.zeros(count)
    for k in range(inner + 2):
        for i in range(n):
            if k < inner:
                offset = STRIPS[k] * wide[i]
            else:
                offset = 0.5 * (wide[i] + radius) * (-1 if k == inner else 1)
            aside = offset / max(level[i], 1e-9)
            at = k * n + i
            x[at], y[at] = flat[i, 0] - aside * along[i, 1], flat[i, 1] + aside * along[i, 0]
            # a vertical line through a leaning tube is inside for longer; a steep one is all there is
            half = np.sqrt(max(radius**2 - offset**2, 0.0)) / max(level[i], 0.2)
            half = max(half, 0.6 * length[i] * abs(along[i, 2]))
            low[at], high[at] = z[i] - half, z[i] + half
            if k < inner:
                area[at] = 2 * wide[i] / inner * length[i] * level[i]
    left, right, front = np.inf, -np.inf, np.inf
    for at in range(count):
        left, right, front = min(left, x[at]), max(right, x[at]), min(front, y[at])
    across = int((right - left) / cell) + 1
    cells = np.empty(count, np.int64)
    for at in range(count):
        cells[at] = int((x[at] - left) / cell) + int((y[at] - front) / cell) * across
    return cells, low, high, area


@compiled
def _floors(cells: Indices, low: Array, high: Array) -> Array:
    """Return how high each span's support begins, (n,): on the nearest top below it, or on the bed, 0."""
    last = 0
    for n in range(len(cells)):
        last = max(last, cells[n])
    begins = np.zeros(last + 2, np.int64)
    for n in range(len(cells)):
        begins[cells[n] + 1] += 1
    for cell in range(last + 1):
        begins[cell + 1] += begins[cell]
    order, filled = np.empty(len(cells), np.int64), begins.copy()
    for n in range(len(cells)):
        place = filled[cells[n]]
        filled[cells[n]] += 1
        while place > begins[cells[n]] and low[order[place - 1]] > low[n]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = n
    floor = np.zeros(len(cells))
    for cell in range(len(begins) - 1):
        below, top = 0.0, -np.inf
        for place in range(begins[cell], begins[cell + 1]):
            n = order[place]
            if low[n] > top:
                below = max(top, 0.0)
            floor[n], top = below, max(top, high[n])
    return floor


def _tip(flat: Array, z: Array, weight: Array, on_bed: NDArray[np.bool_], radius: float) -> float:
    """Return how far the piece may lean before its centre leaves the hull of its feet, degrees."""
    center = weight @ np.column_stack([flat, z]) / weight.sum()
    points = flat[on_bed]
    if len(points) < 3:
        return 0.0
    try:
        sides = ConvexHull(points).equations
    except QhullError:
        return 0.0
    margin = float(-(sides[:, :2] @ center[:2] + sides[:, 2]).max())
    return float(np.degrees(np.arctan2(max(margin, 0.0), max(center[2], radius))))


def _over_air(strands: Strands, at: Array, bottom: Array, layer: float) -> tuple[int, float]:
    """Count the local minima in mid-air, and measure the longest stretch within one layer over air."""
    starts, longest, begin = 0, 0.0, 0
    for size in strands.sizes:
        own = slice(begin, begin + size)
        begin += size
        low, place = bottom[own], at[own, :2]
        dips = (low < np.roll(low, 1)) & (low <= np.roll(low, -1)) & (low > layer)
        starts += int(dips.sum())
        highest, lowest = low.copy(), low.copy()
        for step in range(1, size):
            ahead = np.roll(low, -step)
            highest, lowest = np.maximum(highest, ahead), np.minimum(lowest, ahead)
            flat = (highest - lowest <= layer) & (lowest > layer)
            if not flat.any():
                break
            way = np.linalg.norm(np.roll(place, -step, axis=0) - place, axis=1)[flat]
            longest = max(longest, float(way.max()))
    return starts, longest


def turn_upwards() -> Array:
    """Return rotations whose upward directions are the axes and the diagonals between two, (18, 3, 3)."""
    ups = np.stack(np.meshgrid(*3 * [[-1.0, 0.0, 1.0]], indexing="ij"), axis=-1).reshape(-1, 3)
    ups = ups[np.isin(np.abs(ups).sum(1), (1, 2))]
    ups /= np.linalg.norm(ups, axis=1)[:, None]
    side = np.cross(ups, np.eye(3)[np.abs(ups).argmin(1)])
    side /= np.linalg.norm(side, axis=1)[:, None]
    return np.stack([side, np.cross(ups, side), ups], axis=1)
