"""Penumbra: the blur of a lamp that has a size."""

from __future__ import annotations

import numpy as np

from knotfab.arrays import Array
from knotfab.effects.base import Effect, EffectContext
from knotfab.scene.camera import camera_of
from knotfab.scene.model import ResolvedView

__all__ = ["PENUMBRA", "blurs_mm"]

VERIFIED_PX = 1024  # on the longer side of the frame: the pixels in which blurs are told


def magnitude(context: EffectContext) -> float:
    """The widest blur that any strand's surface has on a wall, px; the view counts where it is widest."""
    return max(
        float(blurs_mm(view, context.points, context.radius).max(initial=0.0))
        / (view.longer_mm / VERIFIED_PX)
        for view in context.views
    )


def blurs_mm(view: ResolvedView, points: Array, radius: float) -> Array:
    """(N,) an upper bound of the blur, mm, of every edge within `radius` of points (N, 3).

    An edge at distance D from the middle of a lamp, at height h over the wall's plane where the lamp is at H,
    is blurred over the section of a cone: the rays through it that touch the ball of radius R about
    the lamp, sin a = R / D. The plane cuts it at an angle t from its axis, cos t = (H - h) / D,
    in an ellipse with the longer axis

        h (tan(t + a) - tan(t - a)) = 2 R cos(a) h D / ((H - h)² - R²),

    which is d h / (H - h) / cos t / (1 - x² - (R / D)²), x = R tan(t) / D, with cos a taken as 1. A disc,
    a rectangle or a row of lamps lies within its ball. f(h, D) is largest in the direction of its
    slope; what that leaves out is of second order in radius / (H - h), and added.
    """
    size = view.light_size_mm
    if view.kind == "eye" or size == 0 or len(points) == 0:
        return np.zeros(len(points))
    camera = camera_of(view, 1, 1)  # where light and wall are: its pixels do not matter
    normal, offset = camera.receiver[:3], camera.receiver[3]
    lamp = float(normal @ camera.eye + offset)
    height = points @ normal + offset
    off = np.linalg.norm(points - camera.eye - np.outer(height - lamp, normal), axis=1)
    half = 0.5 * size

    def blur(height: Array, off: Array) -> Array:
        below = np.maximum(lamp - height, 1.001 * half)  # the lamp's own ball reaches no strand
        found = size * height * np.hypot(below, off) / (below**2 - half**2)
        return np.maximum(np.asarray(found), 0.0)

    step = 1e-6 * lamp
    here = blur(height, off)
    up, out = blur(height + step, off) - here, blur(height, off + step) - here
    steep = np.maximum(np.hypot(up, out), 1e-300)
    worst = blur(height + radius * up / steep, off + radius * out / steep)
    return np.asarray(worst * (1.0 + (radius / np.maximum(lamp - height, radius)) ** 2))


PENUMBRA = Effect(
    "penumbra",
    "px",
    magnitude,
    4.0,  # a blur moves the half-light line by a small share of its width
    "the lamp is wide enough to blur the outline",
)
