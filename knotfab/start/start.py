"""Make a search's start: curves of known knot type that nearly draw every picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.polylines import sample_evenly
from knotfab.knots import Knots
from knotfab.limits.region import tube_outside
from knotfab.problem import Problem, Start, TargetView
from knotfab.start.filling import Template, fill
from knotfab.start.lift import lift_template, start_by_lamp
from knotfab.start.strokes import follow_strokes
from knotfab.start.tie import KnotRoom, tie
from knotfab.start.views import start_between_views, start_ious
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.search import SearchSettings


def make_start(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    knots: int | None = None,
    spacing: float = 1.0,
    template: Template | None = None,
    parted: bool = False,
) -> Start:
    """Make the start for a tube of this radius, mm: a filling with depth, or circles if the settings say so.

    Args:
        knots: None for one curve a piece of the picture, or the number of curves to bridge the pieces to.
        spacing: distance of the strands over that which fills the picture.
        template: of a single view, if it is known already.
        parted: as for `lift_template`.

    Raises:
        SceneError: there is no such curve that is clear of itself, or the knot has no place in it.
    """
    one = len(problem.views) == 1
    if one and template is None:
        template = make_template(problem.views[0], spacing * radius, knots)
    if settings.network_start == "circle":
        start = start_at_circles(problem, radius, settings, template)
    elif problem.apart_mm is not None:
        start = start_by_lamp(problem, radius, settings, knots, spacing, tie_knot)
    elif template is not None:
        start = tie_knot(
            problem, lift_template(problem, template, radius, settings, parted), radius
        )
    else:
        start = start_between_views(problem, radius, settings, knots, spacing)
    if one or start.ious:
        return start
    return replace(start, ious=start_ious(problem, start, radius))


def make_template(target: TargetView, radius: float, knots: int | None = None) -> Template:
    """Make closed planar curves that fill one view's picture or follow its lines; `knots`: `make_start`'s."""
    if target.lines:
        return follow_strokes(list(target.lines), target.polygon, radius, knots)
    return fill(target.polygon, radius, knots)


def start_from_knots(problem: Problem, knots: Knots, radius: float) -> Start:
    """Start from the knots that an earlier search found, in scene coordinates; `radius` is in mm."""
    start = Start(
        tuple(knot.points for knot in knots.knots),
        "knots that an earlier search had come to by certified steps, as their file states their types",
        tuple(knot.type for knot in knots.knots),
    )
    if len(problem.views) == 1:
        return start
    return replace(start, ious=start_ious(problem, start, radius))


def tie_knot(problem: Problem, start: Start, radius: float) -> Start:
    """Tie the problem's knot into the longest of the start's curves, as seen from the view they face."""
    wanted = parse_knot_name(problem.knot)
    if not wanted.factors:
        return start
    if start.facing is None:
        raise ValueError("a knot is tied in where a view sees the curve simple")
    facing, limits = problem.views[start.facing], problem.limits(radius)
    axes = facing.axes

    def outside(points: Array) -> float:
        here = points @ axes
        ahead = np.roll(here, -1, axis=0)
        return float(tube_outside(here, ahead, limits)[1].max())

    room = KnotRoom(
        facing.polygon,
        facing.view.light_distance_mm,
        limits.radius,
        max(0.5 * limits.separation, limits.bend_radius),
        outside,
        problem.arched,
    )
    tied = tie(tuple(c @ axes.T for c in start.curves), wanted.factors, room)
    types = list(start.types)
    types[tied.component] = wanted.promise
    why = (
        f"{start.why}; and a {wanted.promise} tied into knot {tied.component}, before or behind all "
        "strands that it hides: their connected sum"
    )
    curves = tuple(c @ axes for c in tied.curves)
    return replace(start, curves=curves, types=tuple(types), why=why, ious=())


# Circles as a start, as in the paper: unknots that are far from the pictures.

# waves, outline samples and rounds of fitting a circle's depth
_WAVES, _OUTLINE, _FITS = 4, 300, 30


def start_at_circles(
    problem: Problem, radius: float, settings: SearchSettings, template: Template | None = None
) -> Start:
    """Make a circle for each curve of the template, or for several views one circle bent towards all.

    Raises:
        SceneError: the scene asks for another knot than the unknot.
    """
    if problem.knot != "unknot":
        raise SceneError(
            "scene key [search] network_start",
            f"a circle is an unknot, and a {problem.knot} is asked for",
            'Use network_start = "filling", which has the knot tied in',
        )
    if template is not None:
        parts = _circles(template.curves, radius, 2.0 * problem.limits(radius).separation)
        why = "one circle a knot, in parallel planes: an unlink of unknots, by inspection"
        return Start(tuple(parts), why, far=True)
    # the silhouette with the most ink needs the longest curve
    facing = int(np.argmax([p.area for p in problem.polygons]))
    axes = [v.axes for v in problem.views]
    points = _bent_circle(facing, problem.polygons, axes, radius, settings)
    name = problem.views[facing].view.name
    why = f"a circle bent in depth alone, simple as view {name} sees it: an unknot"
    return Start((points,), why, far=True, facing=facing)


def _circles(curves: Sequence[Array], radius: float, separation: float) -> list[Array]:
    """Return a circle for each planar curve [(n, 2) mm], each in its own plane, [(m, 3) mm].

    Convex polygons in parallel planes are an unlink of unknots (paper, sec. 3.2; its template
    (cos s, sin s, 0) needs s from 0 to 2 pi instead of 1).

    Args:
        radius: of the tube, mm; no circle is smaller than four radii.
        separation: distance of neighbouring planes, mm.
    """
    found = []
    for k, curve in enumerate(curves):
        low, high = curve.min(0), curve.max(0)
        around = max(0.35 * float((high - low).min()), 4.0 * radius)
        count = max(48, round(2 * np.pi * around / (0.5 * radius)))
        angle = 2 * np.pi * np.arange(count) / count
        middle = 0.5 * (low + high)
        found.append(
            np.column_stack(
                [
                    middle[0] + around * np.cos(angle),
                    middle[1] + around * np.sin(angle),
                    np.full(count, (k - 0.5 * (len(curves) - 1)) * separation),
                ]
            )
        )
    return found


def _bent_circle(
    facing: int,
    polygons: Sequence[MultiPolygon],
    axes: Sequence[Array],
    radius: float,
    settings: SearchSettings,
) -> Array:
    """Return an ellipse that faces one view, bent in depth towards the others, (n, 3) mm."""
    boxes = np.array([p.bounds for p in polygons])
    wide, high = np.maximum(0.4 * (boxes[facing, 2:] - boxes[facing, :2]), 2.0 * radius)
    # its centre is the least-squares fit to the centres of all silhouettes
    rows = np.concatenate([a[:2] for a in axes])
    middles = 0.5 * (boxes[:, :2] + boxes[:, 2:]).ravel()
    centre = np.linalg.lstsq(rows, middles, rcond=None)[0]
    right, up, towards = axes[facing]
    count = max(24, round(np.pi * (wide + high) / (settings.edge_radii * radius)))
    t = 2 * np.pi * np.arange(count) / count
    points = centre + wide * np.cos(t)[:, None] * right + high * np.sin(t)[:, None] * up
    others = [n for n in range(len(axes)) if n != facing]
    depth = _fit_depth(points, t, towards, [axes[n] for n in others], [polygons[n] for n in others])
    return sample_evenly(points + depth[:, None] * towards, settings.edge_radii * radius)


def _outline(polygon: MultiPolygon) -> Array:
    """Sample a silhouette's outline evenly, (n, 2) mm."""
    edge = polygon.boundary
    at = shapely.line_interpolate_point(edge, np.linspace(0, edge.length, _OUTLINE))
    return np.asarray(shapely.get_coordinates(at))


def _fit_depth(
    points: Array, t: Array, towards: Array, axes: list[Array], polygons: list[MultiPolygon]
) -> Array:
    """Fit depths (n,), a short Fourier series, that bring a curve near to the other views' outlines.

    It alternates between nearest points, both ways, and a linear fit to them; the light is taken as parallel.
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
