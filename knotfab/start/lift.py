"""Make the start of one view, or of one view per lamp: move the template along the light's rays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.effects.base import Decision, EffectContext, decide
from knotfab.effects.misplacement import MISPLACEMENT, Steadying
from knotfab.effects.penumbra import PENUMBRA, Sharpening
from knotfab.geometry.polylines import arc_lengths, sample_evenly
from knotfab.problem import Problem, Start, TargetView
from knotfab.scene.camera import light_of
from knotfab.start.depth import choose_depth
from knotfab.start.filling import Template, fill, simple_curves
from knotfab.start.lanes import assign_lanes, part_passes
from knotfab.start.legibility import stretch_mask
from knotfab.start.profiles import lift, lower
from knotfab_formats.search import SearchSettings

# depth of a flat piece, in radii: just enough for strands to pass over each other
_FLAT_RADII = 3.0


def refuse_doubled() -> SceneError:
    """Return the error of a template that passes itself all along a stroke, and is to stand in arches."""
    return SceneError(
        "a piece without supports (--supports none)",
        "its strokes are as thin as the tube: strands lie behind each other all along, and only one of "
        "two can stand on the bed",
        "Use --supports slicer",
    )


def lift_template(
    problem: Problem,
    template: Template,
    radius: float,
    settings: SearchSettings,
    parted: bool = False,
) -> Start:
    """Move the template's curves to their depths and sample them evenly; they are unknots by inspection.

    With `parted`, sides of a stroke that hide each other keep the same order in depth along all of it.
    """
    problem = replace(problem, world=problem.world.holding(len(template.curves)))
    target = problem.views[0]
    light = target.view.light_distance_mm
    flat = problem.depth_mm is None
    extent = _FLAT_RADII * radius if problem.depth_mm is None else problem.depth_mm
    wide, moved = _judge_effects(problem, template, extent, radius, settings)
    sharpening = steadying = None
    if wide.excess > 0 and not flat and not problem.arched:
        sharpening = Sharpening(wide, target.view, target.polygon, radius)
    if moved.excess > 0 and not flat and problem.depth_open and not problem.arched:
        steadying = Steadying(moved, target.view, target.axes, target.polygon, problem.world)
    separation = problem.limits(radius).separation
    if template.passes and problem.arched:
        raise refuse_doubled()
    lanes = assign_lanes(template.curves, separation) if template.passes else None
    depth = choose_depth(
        template.curves,
        radius,
        light,
        extent,
        stretch_mask(target.mask),
        1 if flat else settings.depth_candidates,
        settings.seed,
        problem.overhang_deg,
        sharpening,
        None if lanes is None else tuple(0.5 * separation * lane for lane in lanes),
        steadying,
        _FLAT_RADII * radius,
        separation if parted and lanes is None else None,
        problem.world.leg_modulus_mpa(radius) if problem.arched else None,
        target.hides,
    )
    if flat:
        depth = replace(depth, extent_mm=None)
    elif depth.extent_mm is not None and depth.extent_mm < extent:
        # start again with the smaller depth, on which all costs depend
        less = replace(problem, depth_mm=depth.extent_mm, depth_open=False)
        start = lift_template(less, template, radius, settings, parted)
        for decision in (wide, moved):
            start.effects[decision.effect.name].add(decision)
        return start
    if lanes is not None:
        depth = replace(
            depth, depths=part_passes(template.curves, depth.depths, lanes, separation, light)
        )
    step = settings.edge_radii * radius
    parts = [
        sample_evenly(lift(c, d, light), step)
        for c, d in zip(template.curves, depth.depths, strict=True)
    ]
    shadows = [lower(p, light) for p in parts]
    if not simple_curves(shadows):
        # even samples cut corners, while the template's own vertices are simple
        parts = [lift(c, d, light) for c, d in zip(template.curves, depth.depths, strict=True)]
        shadows = list(template.curves)
    if not simple_curves(shadows):
        raise SceneError(
            "the filling template",
            "its curves cross each other",
            "This is a fault of knotfab: please report the picture",
        )
    why = "simple and disjoint seen from the light: an unlink of unknots, by inspection"
    curves = tuple(p @ target.axes for p in parts)
    return Start(curves, why, depth=depth, effects={d.effect.name: d for d in (wide, moved)})


def _judge_effects(
    problem: Problem, template: Template, extent: float, radius: float, settings: SearchSettings
) -> tuple[Decision, Decision]:
    """Judge penumbra and misplacement before the depths are known.

    The penumbra is judged with all strands as near to the lamp as allowed, misplacement with strands at both
    ends of the depth.
    """
    target = problem.views[0]
    view, light = target.view, target.view.light_distance_mm
    far, near = (
        np.concatenate([lift(c, np.full(len(c), z), light) for c in template.curves]) @ target.axes
        for z in (-extent / 2, extent / 2)
    )
    context = EffectContext((view,), near, radius, settings.tolerance_px, problem.world)
    both = replace(context, points=np.concatenate([far, near]))
    return (
        decide(PENUMBRA, context, problem.switches),
        decide(MISPLACEMENT, both, problem.switches),
    )


# The start before several lamps, whose pieces stand apart.

_WHY = "; each lamp's pieces stand in its own light, where no others are"


def start_by_lamp(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    knots: int | None = None,
    spacing: float = 1.0,
    tie: Callable[[Problem, Start, float], Start] | None = None,
) -> Start:
    """Fill each lamp's mask as a single picture, and shear the curves so that the lamp sees them as its mask.

    Args:
        radius: of the tube, mm.
        knots: None for one curve a piece of each mask, or the number of curves to bridge the pieces to.
        spacing: as for `make_start`.
        tie: ties the problem's knot into the longest curve of a start.

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
            problem, views=(target,), depth_mm=problem.apart_mm, apart_mm=None, goals=None
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
    """Return the number of curves for each mask whose pieces must be bridged to have `knots` in all."""
    counts = [len(template.curves) for template in templates]
    asked = dict[int, int]()
    while knots is not None and sum(counts) > knots and max(counts) > 1:
        most = counts.index(max(counts))
        counts[most] -= 1
        asked[most] = counts[most]
    return asked
