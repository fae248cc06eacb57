"""Where the search for several views starts: a curve of known type that nearly draws every picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import shapely

from knotfab.arrays import Array
from knotfab.errors import SceneError
from knotfab.geometry.polylines import polylines_of
from knotfab.geometry.sampling import sample_evenly
from knotfab.problem import Problem, Start, TargetView
from knotfab.scene.settings import SearchSettings
from knotfab.start.deep import deep_curves
from knotfab.start.filling import fill, simple_curves, smooth_closed
from knotfab.start.sheet import laid_on, sheet_of

__all__ = ["start_between_views", "start_ious"]


_ROUNDS = 5  # of following the rays of both lights to one point
_SEEN_PX = 160
_SPREADS = (0.0, 0.5, 1.0, 2.0, 4.0)  # of the sheet's jumps, in tube radii of height
_REACH = 1.2  # how deep strands may go, against how far from the axes silhouettes reach
_BETWEEN = "simple and disjoint seen from between two views: an unlink of unknots, by inspection"


def start_between_views(
    problem: Problem, radius: float, settings: SearchSettings, facing_only: bool = False
) -> Start:
    """The start that draws best the picture that it draws worst, of two views or more.

    Tried are the sheets between views nearest to a right angle, filled, with both diagonals; and each
    view's own filling with depths that draw the others.

    Args:
        radius: of the tube, mm.
        facing_only: only curves that are simple as one of the views sees them.

    Raises:
        SceneError: the silhouettes have no height in common, or every such curve crosses itself.
    """
    views, polygons = problem.views, problem.polygons
    axes = [v.axes for v in views]
    apart = {
        p: round(abs(float(axes[p[0]][2] @ axes[p[1]][2])), 6)
        for p in combinations(range(len(views)), 2)
    }
    pairs = [p for p, along in apart.items() if along < min(apart.values()) + 0.1]
    step = settings.edge_radii * radius
    found: list[Start] = []
    shared = len(views) > 2
    for (one, other), mirrored in product(pairs, (False, True)):
        laid = _lay_sheet(views, one, other, radius, mirrored)
        if laid is None:
            continue
        shared = True
        curves = [sample_evenly(c, step) for c in laid[0]]
        if not facing_only and simple_curves([_project(c, laid[1]) for c in curves]):
            found.append(Start(tuple(curves), _BETWEEN, facing=None))
    if not shared:
        raise _nothing(radius)
    reach = _REACH * max(float(np.abs(p.bounds).max()) for p in polygons)
    for facing in range(len(views)):
        deep = deep_curves(views, facing, radius, step, reach)
        if deep is not None:
            why = f"simple and disjoint as view {views[facing].view.name} sees it: an unlink of unknots"
            found.append(Start(tuple(deep), why, facing=facing))
    if not found:
        raise _nothing(radius)
    measured = [replace(start, ious=start_ious(problem, start, radius)) for start in found]
    return max(measured, key=lambda start: min(start.ious))


def start_ious(problem: Problem, start: Start, radius: float) -> tuple[float, ...]:
    """IoU of the tube about the start's curves with each view's picture, on a coarse image."""
    points = np.concatenate(start.curves)
    rings = polylines_of(start.curves)
    images = [v.image_at(radius, _SEEN_PX) for v in problem.views]
    return tuple(image.iou(points, rings, radius) for image in images)


def _nothing(radius: float) -> SceneError:
    return SceneError(
        "the pictures",
        f"no curve about {radius:g} mm thick runs through the heights that their silhouettes share",
        "Use bolder pictures of equal height, or give a smaller radius (--tube-radius)",
    )


def _project(points: Array, seen: Array) -> Array:
    """(n, 2) parallel projection onto the rows of `seen` (2, 3)."""
    return np.asarray(points @ seen.T)


def _lay_sheet(
    views: Sequence[TargetView], one: int, other: int, radius: float, mirrored: bool
) -> tuple[list[Array], Array] | None:
    """The filled sheet in the scene, and the (2, 3) projection in which it is to be simple."""
    axes = [v.axes for v in views]
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
        flat.append(shapely.transform(views[n].polygon, lambda p, t=turn: p @ t.T))
    sheet = sheet_of(flat[0], flat[1], radius)
    if sheet.shape.is_empty:
        return None
    filled = fill(sheet.shape, radius, 1)
    solve = np.linalg.inv(np.stack([*across, common]))
    lights = [(axes[n][2], views[n].view.light_distance_mm) for n in (one, other)]
    seen = np.stack([across[0] + across[1], common])
    first: tuple[list[Array], Array] | None = None
    for spread in _SPREADS:
        curves = []
        for curve in filled.curves:
            plane = laid_on(sheet, sample_evenly(curve, 0.1 * radius), radius, spread * radius)
            points = plane @ solve.T
            for _ in range(_ROUNDS):
                # what a light throws to the plane through the origin stands nearer to its axis before it
                near = [1.0 - points @ d / light for d, light in lights]
                scaled = plane * np.column_stack([near[0], near[1], 0.5 * (near[0] + near[1])])
                points = scaled @ solve.T
            curves.append(sample_evenly(points, 0.25 * radius))
        for sigma in (2.0, 1.0):
            rounded = [smooth_closed(c, sigma) for c in curves]
            if simple_curves([_project(c, seen) for c in rounded]):
                return rounded, seen
        first = first or (curves, seen)
    return first
