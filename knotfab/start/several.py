"""Where the search for several views starts: a curve of known type that nearly draws every picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon

from knotfab.errors import SceneError
from knotfab.geometry.polylines import rings_of_sizes
from knotfab.render.picture import picture_at
from knotfab.render.threads import one_thread
from knotfab.scene.settings import SearchSettings
from knotfab.search.objective import iou_of
from knotfab.search.several import Shot, view_axes
from knotfab.start.deep import deep_curves
from knotfab.start.filling import even_samples, fill, simple_curves, smooth_closed
from knotfab.start.sheet import laid_on, sheet_of

__all__ = ["Start", "start_of"]

Array = NDArray[np.float64]

_ROUNDS = 5  # of following the rays of both lights to one point
_SEEN_PX = 160
_SPREADS = (0.0, 0.5, 1.0, 2.0, 4.0)  # of the sheet's jumps, in tube radii of height
_REACH = 1.2  # how deep strands may go, against how far from the axes silhouettes reach
_BETWEEN = "simple and disjoint seen from between two views: an unlink of unknots, by inspection"
_WAVES, _OUTLINE, _FITS = 4, 300, 30  # of a circle bent in depth


@dataclass(frozen=True)
class Start:
    """Closed polylines (n, 3), mm, evenly sampled; why their type is known; their IoU view by view."""

    curves: tuple[Array, ...]
    why: str
    ious: tuple[float, ...]


@one_thread()
def start_of(
    shots: Sequence[Shot],
    polygons: Sequence[MultiPolygon],
    radius: float,
    settings: SearchSettings,
    drawable: Sequence[MultiPolygon] | None = None,
) -> Start:
    """The start that draws the picture it draws worst best.

    Tried are the sheets between views nearest to a right angle, filled, with both diagonals; and each
    view's own filling with depths that draw the others.

    Args:
        shots: two views or more.
        polygons: their silhouettes in the plane through the origin, along their own axes, mm.
        radius: tube radius, mm.
        drawable: what the others leave of each (the visual hull's shadows); None: all of it.

    Raises:
        SceneError: the silhouettes have no height in common, or every such curve crosses itself.
    """
    if settings.network_start == "circle":
        return _circle(shots, polygons, radius, settings)
    axes = [view_axes(s.view) for s in shots]
    apart = {
        p: round(abs(float(axes[p[0]][2] @ axes[p[1]][2])), 6)
        for p in combinations(range(len(shots)), 2)
    }
    pairs = [p for p, along in apart.items() if along < min(apart.values()) + 0.1]
    step = settings.edge_radii * radius
    found: list[Start] = []
    shared = len(shots) > 2
    for (one, other), mirrored in product(pairs, (False, True)):
        laid = _laid(shots, polygons, axes, one, other, radius, mirrored)
        if laid is None:
            continue
        shared = True
        curves = [even_samples(c, step) for c in laid[0]]
        if simple_curves([_seen(c, laid[1]) for c in curves]):
            found.append(Start(tuple(curves), _BETWEEN, _ious(shots, curves, radius)))
    if not shared:
        raise _nothing(radius)
    reach = _REACH * max(float(np.abs(p.bounds).max()) for p in polygons)
    for facing in range(len(shots)):
        deep = deep_curves(shots, drawable or polygons, facing, radius, step, reach)
        if deep is not None:
            why = f"simple and disjoint as view {shots[facing].view.name} sees it: an unlink of unknots"
            found.append(Start(tuple(deep), why, _ious(shots, deep, radius)))
    if not found:
        raise _nothing(radius)
    return max(found, key=lambda s: min(s.ious))


def _nothing(radius: float) -> SceneError:
    return SceneError(
        "the pictures",
        f"no curve about {radius:g} mm thick runs through the heights that their silhouettes share",
        "Use bolder pictures of equal height, or give a smaller radius (--tube-radius)",
    )


def _circle(
    shots: Sequence[Shot], polygons: Sequence[MultiPolygon], radius: float, settings: SearchSettings
) -> Start:
    """One circle that faces a view's light, stretched to its silhouette and bent towards the others."""
    axes = [view_axes(s.view) for s in shots]
    # the silhouette with the most ink needs the most curve: the others may see strands in a row
    facing = int(np.argmax([p.area for p in polygons]))
    points = _facing(facing, polygons, axes, radius, settings)
    why = (
        f"a circle bent in depth alone, simple as view {shots[facing].view.name} sees it: an unknot"
    )
    return Start((points,), why, _ious(shots, [points], radius))


def _facing(
    facing: int,
    polygons: Sequence[MultiPolygon],
    axes: list[Array],
    radius: float,
    settings: SearchSettings,
) -> Array:
    """The circle that faces one view, stretched to it, and bent in depth towards the others."""
    boxes = np.array([p.bounds for p in polygons])
    wide, high = np.maximum(0.4 * (boxes[facing, 2:] - boxes[facing, :2]), 2.0 * radius)
    # the middle nearest to that of every silhouette, in the least-squares sense
    rows = np.concatenate([a[:2] for a in axes])
    middles = 0.5 * (boxes[:, :2] + boxes[:, 2:]).ravel()
    centre = np.linalg.lstsq(rows, middles, rcond=None)[0]
    right, up, towards = axes[facing]
    count = max(24, round(np.pi * (wide + high) / (settings.edge_radii * radius)))
    t = 2 * np.pi * np.arange(count) / count
    points = centre + wide * np.cos(t)[:, None] * right + high * np.sin(t)[:, None] * up
    others = [n for n in range(len(axes)) if n != facing]
    depth = _bent(points, t, towards, [axes[n] for n in others], [polygons[n] for n in others])
    return even_samples(points + depth[:, None] * towards, settings.edge_radii * radius)


def _outline(polygon: MultiPolygon) -> Array:
    """Even samples (n, 2) of a silhouette's outline, mm."""
    edge = polygon.boundary
    at = shapely.line_interpolate_point(edge, np.linspace(0, edge.length, _OUTLINE))
    return np.asarray(shapely.get_coordinates(at))


def _bent(
    points: Array, t: Array, towards: Array, axes: list[Array], polygons: list[MultiPolygon]
) -> Array:
    """Depths (n,), waves of a few orders, that bring the curve nearest to the other views' outlines.

    Nearest points both ways, and a linear fit of the waves to them, in turn; parallel light.
    """
    waves = [np.ones_like(t)]
    for k in range(1, _WAVES + 1):
        waves += [np.cos(k * t), np.sin(k * t)]
    basis = np.stack(waves, axis=1)
    samples = [_outline(polygon) for polygon in polygons]
    weights = np.zeros(basis.shape[1])
    for _ in range(_FITS):
        now = points + (basis @ weights)[:, None] * towards
        rows, wanted = [], []
        for frame, sample in zip(axes, samples, strict=True):
            seen, along = now @ frame[:2].T, frame[:2] @ towards
            _, to = cKDTree(sample).query(seen)
            _, of = cKDTree(seen).query(sample)
            flat = points @ frame[:2].T
            every = np.concatenate([np.arange(len(points)), of])
            goal = np.concatenate([sample[to], sample])
            for axis in (0, 1):
                rows.append(basis[every] * along[axis])
                wanted.append(goal[:, axis] - flat[every, axis])
        weights = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=1e-6)[0]
    return np.asarray(basis @ weights)


def _seen(points: Array, seen: Array) -> Array:
    """(n, 2) parallel projection onto the rows of `seen` (2, 3)."""
    return np.asarray(points @ seen.T)


def _laid(
    shots: Sequence[Shot],
    polygons: Sequence[MultiPolygon],
    axes: Sequence[Array],
    one: int,
    other: int,
    radius: float,
    mirrored: bool,
) -> tuple[list[Array], Array] | None:
    """The filled sheet in the scene, and the (2, 3) projection in which it is to be simple."""
    common = np.cross(axes[one][2], axes[other][2])
    if np.linalg.norm(common) < 0.2:
        raise SceneError(
            "the views",
            "all of them look along nearly the same line",
            "Spread their azimuths or elevations",
        )
    common /= np.linalg.norm(common)
    if common[1] < -1e-9:
        common = -common
    across, flat = [], []
    for n, sign in ((one, 1.0), (other, -1.0 if mirrored else 1.0)):
        right, up, towards = axes[n]
        side = sign * np.cross(common, towards)
        across.append(side)
        turn = np.array([[side @ right, side @ up], [common @ right, common @ up]])
        flat.append(shapely.transform(polygons[n], lambda p, t=turn: p @ t.T))
    sheet = sheet_of(flat[0], flat[1], radius)
    if sheet.shape.is_empty:
        return None
    filled = fill(sheet.shape, radius, 1)
    solve = np.linalg.inv(np.stack([*across, common]))
    lights = [(axes[n][2], shots[n].view.light_distance_mm) for n in (one, other)]
    seen = np.stack([across[0] + across[1], common])
    first: tuple[list[Array], Array] | None = None
    for spread in _SPREADS:
        curves = []
        for curve in filled.curves:
            plane = laid_on(sheet, even_samples(curve, 0.1 * radius), radius, spread * radius)
            points = plane @ solve.T
            for _ in range(_ROUNDS):
                # what a light throws to the plane through the origin stands nearer to its axis before it
                near = [1.0 - points @ d / light for d, light in lights]
                scaled = plane * np.column_stack([near[0], near[1], 0.5 * (near[0] + near[1])])
                points = scaled @ solve.T
            curves.append(even_samples(points, 0.25 * radius))
        for sigma in (2.0, 1.0):
            rounded = [smooth_closed(c, sigma) for c in curves]
            if simple_curves([_seen(c, seen) for c in rounded]):
                return rounded, seen
        first = first or (curves, seen)
    return first


def _ious(shots: Sequence[Shot], curves: Sequence[Array], radius: float) -> tuple[float, ...]:
    points = np.concatenate(list(curves))
    rings = rings_of_sizes(tuple(len(c) for c in curves))
    found = []
    for shot in shots:
        frame, target, _ = picture_at(shot.view, shot.mask, _SEEN_PX, True, "cpu")
        found.append(iou_of(points, rings, frame, target, radius))
    return tuple(found)
