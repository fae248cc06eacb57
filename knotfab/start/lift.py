"""The start of one view: the template's curves moved along the light's rays to their depths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.effects.base import Decision, EffectContext, decide
from knotfab.effects.penumbra import PENUMBRA, Sharpening
from knotfab.errors import SceneError
from knotfab.geometry.sampling import sample_evenly
from knotfab.problem import Problem, Start
from knotfab.scene.settings import SearchSettings
from knotfab.start.depth import choose_depth, lift
from knotfab.start.filling import Template, simple_curves
from knotfab.start.lanes import assign_lanes, part_passes
from knotfab.start.legibility import stretch_mask

__all__ = ["lift_template"]


_FLAT_RADII = 3.0  # depth of a flat piece: strands pass over each other, no more


def lift_template(
    problem: Problem, template: Template, radius: float, settings: SearchSettings
) -> Start:
    """The template's curves at their depths, evenly sampled, in the scene: unknots by inspection."""
    target = problem.views[0]
    light = target.view.light_distance_mm
    flat = problem.depth_mm is None
    extent = _FLAT_RADII * radius if problem.depth_mm is None else problem.depth_mm
    decision = _judge_penumbra(problem, template, extent, radius, settings)
    sharpening = None
    if decision.excess > 0 and not flat:
        sharpening = Sharpening(decision, target.view, target.polygon, radius)
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
    )
    if lanes is not None:
        depth = replace(
            depth, depths=part_passes(template.curves, depth.depths, lanes, separation, light)
        )
    step = settings.edge_radii * radius
    parts = [
        sample_evenly(lift(c, d, light), step)
        for c, d in zip(template.curves, depth.depths, strict=True)
    ]
    shadows = [p[:, :2] / (1.0 - p[:, 2:] / light) for p in parts]
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
    return Start(curves, why, depth=depth, effects={PENUMBRA.name: decision})


def _judge_penumbra(
    problem: Problem, template: Template, extent: float, radius: float, settings: SearchSettings
) -> Decision:
    """Whether the lamp is wide, before depths are known: by strands as near to it as any may come."""
    target = problem.views[0]
    view, light = target.view, target.view.light_distance_mm
    highest = [lift(c, np.full(len(c), extent / 2), light) for c in template.curves]
    context = EffectContext(
        (view,), np.concatenate(highest) @ target.axes, radius, settings.tolerance_px
    )
    return decide(PENUMBRA, context, problem.switches)
