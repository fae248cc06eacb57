"""Tie a knot of chosen type into a filling template, before or behind it as seen from the light.

The type rests on three facts, all tested on the polygons themselves. As the light sees it, no other strand
meets the hull of the short arc that is cut. Two legs rise from the arc along light rays. And the tight knot
on top of them is nearer to the light (or further from it) than every strand whose shadow meets its hull. So a
ball contains the knot alone, and without it the legs shrink back onto the arc. The result is the connected
sum of curve and knot. Where the picture is wide, the knot's shadow lies within the silhouette.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from shapely import MultiPoint, MultiPolygon

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.geometry.polylines import arc_lengths, points_at
from knotfab.start.profiles import lower
from knotfab_formats.errors import InputError
from knotfab_formats.knots import BRAIDS, NO_SUCH_KNOT, Factor

# lengths in units of half the strands' least distance, or of the bend radius if that is larger
_SPARE = 1.03  # size of the knot over a tight one
_CUT = 2.2  # length cut from strand and knot, to each side of their joint
_HANDLE = 1.1  # distance from there to the corner of the leg
_HOVER = 2.2  # distance of the knot from the strands below
_PLACES = 60  # places to try, where the silhouette is widest
_WAYS = 48  # orientations of the knot to try
_ALOFT = 0.3  # price of each valley's height over the bed
_STRAIGHT = 0.6  # most turning of the strand where it is cut, radians
_GRID = 0.5  # cell of the grid of distances to the outline, in tube radii


@dataclass(frozen=True)
class KnotRoom:
    """The room for a knot, in mm.

    `polygon` is the silhouette in the plane z = 0, `light` the light's z, `radius` the tube's. `unit` is half
    the strands' least distance, or the bend radius if that is larger. `outside` measures how far a tube about
    points leaves its region. Strands that stand on the bed want a knot whose valleys do, too.
    """

    polygon: MultiPolygon
    light: float
    radius: float
    unit: float
    outside: Callable[[Array], float]
    stands: bool = False


@dataclass(frozen=True)
class Tied:
    """Curves [(n, 3) mm] with a knot tied into number `component`, at `place`.

    `spill` is how far the knot's shadow extends beyond the silhouette, mm in the plane z = 0.
    """

    curves: tuple[Array, ...]
    component: int
    place: Array
    spill: float


@dataclass(frozen=True)
class _Poses:
    """A knot in many orientations, each opened at its lowest point.

    `points` (p, m, 3) run from the first leg to the second, with coordinates along the strand, across it and
    away from it. `reach` (p,) is the largest distance of each from the upward axis.
    """

    points: Array
    reach: Array


@dataclass(frozen=True)
class _Site:
    """A knot (m, 3) placed at a vertex of the strand; `side` is 1 before the strands, -1 behind them."""

    vertex: int
    side: int
    points: Array
    spill: float
    cost: float


def tie(curves: tuple[Array, ...], factors: tuple[Factor, ...], room: KnotRoom) -> Tied:
    """Tie knots into the longest curve, one after the other.

    Args:
        curves: closed polylines (n, 3) mm, simple and disjoint as the light at (0, 0, light) sees them.
        factors: knots of the table.
        room: where the knots may go.

    Raises:
        SceneError: there is no place for the knot.
    """
    lengths = [float(np.linalg.norm(np.roll(c, -1, axis=0) - c, axis=1).sum()) for c in curves]
    component = int(np.argmax(lengths))
    plain: Mask = np.ones(len(curves[component]), dtype=bool)  # vertices that are the template's
    tied = Tied(curves, component, np.zeros(3), 0.0)
    for factor in factors:
        knot = load_knot(factor.name, factor.mirrored) * (room.unit * _SPARE)
        tied, plain = _tie_one(tied, plain, _poses(knot, room.unit), factor.name, room)
    return tied


def _tie_one(
    tied: Tied, plain: Mask, poses: _Poses, name: str, room: KnotRoom
) -> tuple[Tied, Mask]:
    """Tie one knot in at the best site at which the construction is proved."""
    curve = tied.curves[tied.component]
    rest = [c for k, c in enumerate(tied.curves) if k != tied.component]
    for site in sorted(_sites(curve, rest, plain, poses, room), key=lambda s: s.cost):
        if room.outside(site.points) > 0:
            continue
        made = _splice(curve, rest, plain, site, room)
        if made is None:
            continue
        fresh, kept = made
        curves = list(tied.curves)
        curves[tied.component] = fresh
        spill = max(tied.spill, site.spill)
        return Tied(tuple(curves), tied.component, curve[site.vertex], spill), kept
    raise SceneError(
        f"the knot {name}",
        "the piece has no place for it: neither before nor behind the strands is there room",
        "Use a thinner tube (--tube-radius), a bolder picture, or a simpler knot.",
    )


def _poses(knot: Array, unit: float) -> _Poses:
    """Turn the knot to many orientations, and open each at its lowest point."""
    n = len(knot)
    k = np.arange(_WAYS) + 0.5
    z = 1.0 - 2.0 * k / _WAYS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k  # an even spread of directions over the sphere
    flat = np.sqrt(1.0 - z * z)
    step = float(np.linalg.norm(np.roll(knot, -1, axis=0) - knot, axis=1).mean())
    cut = max(2, round(_CUT * unit / step))
    found = []
    for up in np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z]):
        lowest = int(np.argmin(knot @ up))
        tangent = knot[(lowest + 1) % n] - knot[lowest - 1]
        tangent -= (tangent @ up) * up
        length = float(np.linalg.norm(tangent))
        if length < 0.5 * step:
            continue
        along = -tangent / length  # the knot runs against the strand where both are cut
        frame = np.column_stack([along, np.cross(up, along), up])
        turned = (np.roll(knot, -lowest, axis=0) - knot[lowest]) @ frame
        points = turned[cut : n - cut + 1]
        # skip orientations whose rest sags into the gap between the legs
        if points[0, 0] > -0.2 * unit or points[-1, 0] < 0.2 * unit:
            continue
        found.append(points)
    points = np.array(found).reshape(len(found), n - 2 * cut + 1, 3)
    return _Poses(points, np.hypot(points[..., 0], points[..., 1]).max(axis=1, initial=0.0))


def _sites(
    curve: Array, rest: list[Array], plain: Mask, poses: _Poses, room: KnotRoom
) -> Iterator[_Site]:
    """Yield every orientation at every promising place, with its cost, mostly spill, then depth."""
    unit, light = room.unit, room.light
    step = float(np.linalg.norm(_next(curve) - curve, axis=1).mean())
    cut = max(2, round(_CUT * unit / step))
    inside = _Inside(room.polygon, _GRID * room.radius)
    shadows = [lower(c, light) for c in (curve, *rest)]
    every = np.concatenate(shadows)
    heights = np.concatenate([curve, *rest])[:, 2]
    low, high = float(heights.min()), float(heights.max())
    for vertex in _vertices_to_cut(curve, shadows, plain, inside, cut):
        at, ray = curve[vertex], np.array([0.0, 0.0, light]) - curve[vertex]
        ray /= np.linalg.norm(ray)
        along = curve[(vertex + 1) % len(curve)] - curve[vertex - 1]
        away = np.linalg.norm(every - shadows[0][vertex], axis=1)
        order = np.argsort(away, kind="stable")
        grown = 1.0 / (1.0 - at[2] / light)
        under = np.searchsorted(away[order], (poses.reach + 2 * unit) * grown) - 1
        for side in (1, -1):
            # the lowest point hovers over every strand near the axis
            base = side * np.maximum.accumulate(side * heights[order])[under] + side * _HOVER * unit
            if room.stands and side < 0:
                base = np.minimum(base, low + poses.points[..., 2].max(axis=1))
            up = side * ray
            x = along - (along @ up) * up
            x /= np.linalg.norm(x)
            origin = at + ray * ((base - at[2]) / ray[2])[:, None]
            points = origin[:, None] + poses.points @ np.stack([x, np.cross(up, x), up])
            z = points[..., 2]
            near = z.max(axis=1) < 0.9 * light
            points, z, base = points[near], z[near], base[near]
            deeper = np.maximum(np.maximum(z.max(axis=1) - high, low - z.min(axis=1)), 0.0)
            # a tube nearer to the light has a wider shadow
            out = room.radius / (1.0 - z / light) - inside(lower(points, light))
            over = np.maximum(out, 0.0) / room.radius
            cost = (over * over).sum(axis=1) + 0.05 * deeper / unit
            cost += 0.01 * np.abs(base - at[2]) / unit
            if room.stands:
                valley = (z[:, 1:-1] < z[:, :-2]) & (z[:, 1:-1] <= z[:, 2:])
                cost += _ALOFT * (valley * np.abs(z[:, 1:-1] - low)).sum(axis=1) / unit
            for k in range(len(points)):
                yield _Site(vertex, side, points[k], max(0.0, float(out[k].max())), float(cost[k]))


class _Inside:
    """The distance of points of the plane z = 0 from the silhouette's outline, mm, negative outside."""

    def __init__(self, polygon: MultiPolygon, step: float) -> None:
        self.step = step
        low_x, low_y, high_x, high_y = polygon.bounds
        self.corner = np.array([low_x, low_y]) - 4 * self.step
        count = np.ceil((np.array([high_x, high_y]) - self.corner) / self.step).astype(int) + 5
        x = self.corner[0] + self.step * np.arange(count[0])
        y = self.corner[1] + self.step * np.arange(count[1])
        shapely.prepare(polygon)
        within = shapely.contains_xy(polygon, *np.meshgrid(x, y, indexing="ij"))
        depth = distance_transform_edt(within) - distance_transform_edt(~within)
        self.depth = self.step * np.asarray(depth, dtype=np.float64)

    def __call__(self, points: Array) -> Array:
        cell = np.rint((points - self.corner) / self.step).astype(np.int64)
        nearest = np.clip(cell, 0, np.array(self.depth.shape) - 1)
        beyond = self.step * np.hypot(*np.moveaxis(cell - nearest, -1, 0))
        return np.asarray(self.depth[nearest[..., 0], nearest[..., 1]] - beyond)


def _vertices_to_cut(
    curve: Array, shadows: list[Array], plain: Mask, inside: _Inside, cut: int
) -> Iterator[int]:
    """Yield vertices at which the strand may be cut, those deepest in the silhouette first.

    The arc around each is nearly straight and belongs to the template, and its shadow's hull meets no other
    strand. `shadows` begin with that of `curve`.
    """
    n = len(curve)
    edge = _next(curve) - curve
    edge /= np.linalg.norm(edge, axis=1)[:, None]
    around = np.arange(-cut - 1, cut + 2)
    rows = (np.arange(n)[:, None] + around) % n
    turned = np.einsum("nmj,nj->nm", edge[rows[:, :-1]], edge).min(axis=1)
    fit = np.flatnonzero(plain[rows].all(axis=1) & (turned > np.cos(_STRAIGHT)))
    fit = fit[np.argsort(-inside(shadows[0][fit]), kind="stable")]
    tree = shapely.STRtree(np.concatenate([_edges(s) for s in shadows]))
    chosen: list[int] = []
    for k in fit.tolist():
        if any(min(abs(k - c), n - abs(k - c)) <= cut for c in chosen):
            continue
        hull = MultiPoint(shadows[0][rows[k, 1:-1]]).convex_hull
        if np.isin(tree.query(hull, predicate="intersects"), rows[k, :-1]).all():
            chosen.append(k)
            yield k
        if len(chosen) == _PLACES:
            return


def _splice(
    curve: Array, rest: list[Array], plain: Mask, site: _Site, room: KnotRoom
) -> tuple[Array, Mask] | None:
    """Splice the knot into the curve; return it and a mask of the template's vertices, None if not proved."""
    unit, light, side = room.unit, room.light, site.side
    step = float(np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1).mean())
    cut = max(2, round(_CUT * unit / step))
    handle = max(1, cut - max(1, round(_HANDLE * unit / step)))
    # the strand runs from the far end of the cut around to its near end
    turned = np.roll(curve, -site.vertex, axis=0)
    strand = turned[cut : len(curve) - cut + 1]
    feet = turned[[-handle, handle]]
    knot = site.points
    before, after = knot[0] - knot[1], knot[-1] - knot[-2]
    corners = np.stack(
        [
            knot[0] + before * (_HANDLE * unit / np.linalg.norm(before)),
            knot[-1] + after * (_HANDLE * unit / np.linalg.norm(after)),
        ]
    )
    # the legs must pass all strands below before they reach the knot's level
    level = float((side * np.concatenate([knot, corners])[:, 2]).min())
    hull = MultiPoint(lower(np.concatenate([knot, corners, feet]), light)).convex_hull
    shapely.prepare(hull)
    below = -np.inf
    for other in (turned, *rest):
        meets = shapely.intersects(hull, _edges(lower(other, light)))
        height = np.maximum(side * other[:, 2], side * _next(other)[:, 2])
        below = max(below, float(np.where(meets, height, -np.inf).max()))
    if not below < level:
        return None
    eye = np.array([0.0, 0.0, light])
    low, top = (
        eye + (feet - eye) * ((light - side * z) / (light - feet[:, 2]))[:, None]
        for z in (below, level)
    )
    first = _round_corners(
        np.stack([strand[-1], feet[0], low[0], top[0], corners[0], knot[0]]), step
    )
    second = _round_corners(
        np.stack([knot[-1], corners[1], top[1], low[1], feet[1], strand[0]]), step
    )
    fresh = np.concatenate([strand, first[1:-1], knot, second[1:-1]])
    kept = np.zeros(len(fresh), dtype=bool)
    kept[: len(strand)] = np.roll(plain, -site.vertex)[cut : len(curve) - cut + 1]
    return fresh, kept


def _next(points: Array) -> Array:
    return np.roll(points, -1, axis=0)


def _edges(shadow: Array) -> NDArray[np.object_]:
    """Return the edges of a closed polyline as an array of lines, (n,)."""
    return np.asarray(shapely.linestrings(np.stack([shadow, _next(shadow)], axis=1)))


def _round_corners(corners: Array, step: float) -> Array:
    """Cut a polyline's corners three times (Chaikin 1974) and sample it evenly; both ends are kept.

    Each corner stays within the triangle that it forms with the midpoints of its edges.
    """
    line = corners
    for _ in range(3):
        q = 0.75 * line[:-1] + 0.25 * line[1:]
        r = 0.25 * line[:-1] + 0.75 * line[1:]
        inner = np.stack([q, r], axis=1).reshape(-1, 3)
        line = np.concatenate([line[:1], inner[1:-1], line[-1:]])
    arc = arc_lengths(line, closed=False)
    count = max(4, round(arc[-1] / step))
    at = np.linspace(0.0, arc[-1], count + 1)
    return points_at(line, arc, at)


@cache
def _table() -> dict[str, Any]:
    text = (
        resources.files("knotfab.scene").joinpath("data", "knots.toml").read_text(encoding="utf-8")
    )
    return tomllib.loads(text)["knots"]  # type: ignore[no-any-return]


def load_knot(name: str, mirrored: bool = False, step: float = 0.4) -> Array:
    """Load the tight centre line of a knot of the table, centred, (n, 3) in tube radii.

    Vertices are about `step` apart, strands at least 2, and bend radii are at least 1.

    Raises:
        InputError: the table has no such knot.
    """
    if name not in BRAIDS:
        raise InputError(f"the knot {name!r}", "there is no such name in the table", NO_SUCH_KNOT)
    from scipy.interpolate import CubicSpline

    points = np.asarray(_table()[name], dtype=np.float64)
    arc = arc_lengths(points)
    spline = CubicSpline(arc, np.concatenate([points, points[:1]]), bc_type="periodic")
    fine = spline(np.linspace(0.0, arc[-1], 8 * len(points) + 1))
    run = arc_lengths(fine[:-1])
    count = max(12, round(run[-1] / step))
    at = np.interp(np.arange(count) * run[-1] / count, run, np.linspace(0.0, arc[-1], len(fine)))
    result = np.asarray(spline(at), dtype=np.float64)
    result -= result.mean(axis=0)
    return result * [1.0, 1.0, -1.0] if mirrored else result
