"""The start before several lamps whose pieces stand apart: each mask filled as the one picture of its lamp.

A lamp beside the axis sees what a lamp on the axis sees of the same piece sheared along the wall: a point h
before the wall moves by the lamp's own shift times h / H, the lamp being H before it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.effects.base import Decision
from knotfab.geometry.sampling import arc_lengths
from knotfab.problem import Problem, Start, TargetView
from knotfab.scene.camera import light_of
from knotfab.start.filling import Template, fill
from knotfab.start.lift import lift_template
from knotfab_formats.search import SearchSettings

__all__ = ["on_axis", "start_by_lamp"]

_WHY = "; each lamp's pieces stand in its own light, where no others are"


def start_by_lamp(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    knots: int | None = None,
    spacing: float = 1.0,
    tie: Callable[[Problem, Start, float], Start] | None = None,
) -> Start:
    """Return each lamp's own filling at its depths, sheared to where that lamp sees it as its mask.

    Args:
        radius: radius of the tube, mm.
        knots: None for one curve a piece of each mask; a number to bridge pieces until so many are left.
        spacing: as for `make_start`.
        tie: ties the problem's knot into the longest curve of a start of one view.

    Raises:
        SceneError: a filling's curves cross each other.
    """
    straight = [on_axis(target) for target in problem.views]
    templates = [fill(target.polygon, spacing * radius) for target in straight]
    for n, count in _bridged(templates, knots).items():
        templates[n] = fill(straight[n].polygon, spacing * radius, count)
    longest = [max(arc_lengths(c)[-1] for c in template.curves) for template in templates]
    tied = longest.index(max(longest))
    curves, types, effects, why = list[Array](), list[str](), dict[str, Decision](), ""
    for n, (target, template) in enumerate(zip(straight, templates, strict=True)):
        alone = replace(
            problem,
            views=(target,),
            depth_mm=problem.apart_mm,
            apart_mm=None,
            goals=None,
        )
        start = lift_template(alone, template, radius, settings)
        if tie is not None and n == tied:
            start = tie(alone, start, radius)
        view, out = target.view, target.axes[2]
        shift = light_of(problem.views[n].view) - light_of(view)
        whole = view.wall_distance_mm + view.light_distance_mm
        for curve in start.curves:
            before = (curve @ out + view.wall_distance_mm) / whole
            curves.append(curve + before[:, None] * shift)
        types += start.types
        why = start.why
        for name, decision in start.effects.items():
            if name in effects:
                effects[name].add(decision)
            else:
                effects[name] = decision
    return Start(tuple(curves), why + _WHY, tuple(types), facing=None, effects=effects)


def on_axis(target: TargetView) -> TargetView:
    """Return the same view with its lamp on the axis."""
    view = target.view.but(light_right_mm=0.0, light_up_mm=0.0)
    at = view.wall_distance_mm / (view.wall_distance_mm + view.light_distance_mm)
    aside = -at * np.array([target.view.light_right_mm, target.view.light_up_mm])
    moved = shapely.transform(target.polygon, lambda points: points + aside)
    assert isinstance(moved, MultiPolygon)
    return replace(target, view=view, polygon=moved)


def _bridged(templates: list[Template], knots: int | None) -> dict[int, int]:
    """Count how many curves the masks are to become that are bridged, the one with the most first."""
    counts = [len(template.curves) for template in templates]
    asked = dict[int, int]()
    while knots is not None and sum(counts) > knots and max(counts) > 1:
        most = counts.index(max(counts))
        counts[most] -= 1
        asked[most] = counts[most]
    return asked
