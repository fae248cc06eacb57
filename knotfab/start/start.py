"""Make a search's start: curves of known type that nearly draw every picture, the knot asked for tied in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.base.arrays import Array
from knotfab.knots import Knots
from knotfab.limits.region import tube_outside
from knotfab.problem import Problem, Start, TargetView
from knotfab.start.circle import start_at_circles
from knotfab.start.filling import Template, fill
from knotfab.start.lamps import start_by_lamp
from knotfab.start.lift import lift_template
from knotfab.start.strokes import follow_strokes
from knotfab.start.tie import KnotRoom, tie
from knotfab.start.views import start_between_views, start_ious
from knotfab_formats.knot_names import parse_knot_name
from knotfab_formats.search import SearchSettings

__all__ = ["go_on", "make_start", "make_template", "tie_knot"]


def make_start(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    knots: int | None = None,
    spacing: float = 1.0,
    template: Template | None = None,
    parted: bool = False,
) -> Start:
    """Make the start for a tube of this radius, mm: a filling at its depths, or circles if settings say so.

    Args:
        knots: None for one curve a piece of the picture; a number to bridge pieces until so many are left.
        spacing: spacing of the strands, over the one that fills the picture.
        template: template of the one view, where it is known already.
        parted: as for `lift_template`.

    Raises:
        SceneError: no such curve keeps clear of itself, or it has no place for the knot.
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


def go_on(problem: Problem, knots: Knots, radius: float) -> Start:
    """Return a start from knots whose types are known, in the scene; `radius` of the tube in mm."""
    start = Start(
        tuple(knot.points for knot in knots.knots),
        "knots that an earlier search had come to by certified steps, as their file states their types",
        tuple(knot.type for knot in knots.knots),
    )
    if len(problem.views) == 1:
        return start
    return replace(start, ious=start_ious(problem, start, radius))


def tie_knot(problem: Problem, start: Start, radius: float) -> Start:
    """Tie the problem's knot into the longest of the start's curves, seen from the view they face."""
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
