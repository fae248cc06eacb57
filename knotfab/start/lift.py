"""The start of one view: the template's curves moved along the light's rays to their depths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.base.errors import SceneError
from knotfab.effects.base import Decision, EffectContext, decide
from knotfab.effects.misplacement import MISPLACEMENT, Steadying
from knotfab.effects.penumbra import PENUMBRA, Sharpening
from knotfab.geometry.sampling import sample_evenly
from knotfab.problem import Problem, Start
from knotfab.start.depth import choose_depth, lift, lower
from knotfab.start.filling import Template, simple_curves
from knotfab.start.lanes import assign_lanes, part_passes
from knotfab.start.legibility import stretch_mask
from knotfab_formats.search import SearchSettings

__all__ = ["lift_template"]


_FLAT_RADII = 3.0  # depth of a flat piece: strands pass over each other, no more


def lift_template(
    problem: Problem,
    template: Template,
    radius: float,
    settings: SearchSettings,
    parted: bool = False,
) -> Start:
    """Return the template's curves at their depths, evenly sampled, in the scene: unknots by inspection.

    With `parted` the sides of a stroke that hide each other keep their order in depth all along.
    """
    problem = replace(problem, world=problem.world.holding(len(template.curves)))
    target = problem.views[0]
    light = target.view.light_distance_mm
    flat = problem.depth_mm is None
    extent = _FLAT_RADII * radius if problem.depth_mm is None else problem.depth_mm
    wide, moved = _judge_effects(problem, template, extent, radius, settings)
    sharpening = steadying = None
    if wide.excess > 0 and not flat:
        sharpening = Sharpening(wide, target.view, target.polygon, radius)
    if moved.excess > 0 and not flat and problem.depth_open:
        steadying = Steadying(moved, target.view, target.axes, target.polygon, problem.world)
    separation = problem.limits(radius).separation
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
    )
    if flat:
        depth = replace(depth, extent_mm=None)
    elif depth.extent_mm is not None and depth.extent_mm < extent:
        # all that is judged by the extent is judged anew
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
        # even samples cut corners; the template's own vertices are simple as they stand
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
    """Tell whether the lamp is wide, and whether placing counts, before depths are known.

    The one by strands as near to the lamp as any may come; the other by these and some as far from it.
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
