"""Layers: a printed part is a stack of slices, whose steps show in its outline."""

from __future__ import annotations

import numpy as np

from knotfab.effects.base import Effect, EffectContext
from knotfab.effects.sag import shifts_mm
from knotfab.effects.shadows import Shadows
from knotfab.scene.camera import view_axes

__all__ = ["LAYERS"]


def magnitude(context: EffectContext) -> float:
    """Return the furthest that half a layer shifts any strand's shadow, px; 0 if it is not known how it lies.

    A slice of thickness h is cut in its middle: a point of the stack has one of the part within h / 2 up or
    down, and the other way round; but for a rim of a round tube of radius r, which a middle misses by up to
    r - sqrt(r² - h² / 4), about h² / 8r. So no outline moves by more than moving the strands by h / 2
    along the printer's z does, h / 2 M sin of the angle between that and the ray, and M h² / 8r.
    """
    upwards, height = context.upwards, context.world.printer.layer_height_mm
    radius = context.radius
    if upwards is None or len(context.points) == 0:
        return 0.0

    def shift(seen: Shadows) -> float:
        across = view_axes(seen.view)[1]
        moves = np.array([0.5 * height * upwards, height**2 / (8 * radius) * across])
        each = shifts_mm(seen, moves[:, None], radius)
        return float(each.sum(axis=0).max()) / seen.view.pixel_mm

    return max(shift(seen) for seen in context.shadows)


LAYERS = Effect(
    "layers",
    "px",
    magnitude,
    2.0,  # half a pixel, at standard accuracy
    "the steps of its layers show in the outline",
)
