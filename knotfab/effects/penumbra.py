"""Penumbra: the blur of a lamp that has a size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from shapely import MultiPolygon

from knotfab.arrays import Array
from knotfab.effects.base import Decision, Effect, EffectContext
from knotfab.scene.camera import camera_of
from knotfab.scene.model import ResolvedView

__all__ = ["PENUMBRA", "Sharpening", "blurs_mm"]

VERIFIED_PX = 1024  # on the longer side of the frame: the pixels in which blurs are told

_LOWERED = 0.5  # share of the way to the wall that strands of the outline are lowered by, at most
_FULL_PX = 32.0  # of blur above the threshold, from which on it is that
# tube radii from the outline: a strand there draws none of it; over which that fades
_DRAWS = (2.0, 0.7)
_SMOOTH = 8.0  # along the curve, in tube radii: strands cannot change depth at once
# what a disc's blur b adds along an edge: b times the mean |x| in it
_ABS_BLUR = 4 / (3 * np.pi) / 2
_WEIGHT = 1.0  # of the brightness error, against legibility


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


@dataclass(frozen=True)
class Sharpening:
    """What a wide lamp asks of depth: that strands which draw the outline stand near the wall.

    The error of a soft shadow in brightness is 0.212 times the blur along the outline, whatever strands do
    sideways; only depth lowers it. `outline`: the silhouette in the plane through the origin, mm.
    """

    decision: Decision
    view: ResolvedView
    outline: MultiPolygon
    radius: float

    @property
    def strength(self) -> float:
        """From 0 at the threshold to 1: how far outline strands are lowered, and what sharpness weighs."""
        if not self.decision.simulated:
            return 0.0
        over = self.decision.magnitude - self.decision.threshold
        return float(np.clip(over / _FULL_PX, 0.0, 1.0))

    def drawing(self, curves: tuple[Array, ...]) -> list[Array]:
        """From 0 to 1, how much points (n, 2), mm, of each evenly sampled closed curve draw the outline."""
        boundary = self.outline.boundary
        shapely.prepare(boundary)
        reach, fade = (share * self.radius for share in _DRAWS)
        found = []
        for curve in curves:
            away = shapely.distance(boundary, shapely.points(curve))
            step = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).mean())
            share = np.clip((reach - away) / fade, 0.0, 1.0)
            found.append(gaussian_filter1d(share, _SMOOTH * self.radius / step, mode="wrap"))
        return found

    def lower(self, heights: list[Array], drawing: list[Array]) -> list[Array]:
        """Heights of each curve, mm, those of its outline strands nearer to the lowest of all."""
        low = min(float(h.min()) for h in heights)
        share = _LOWERED * self.strength
        return [h + share * d * (low - h) for h, d in zip(heights, drawing, strict=True)]

    def cost(self, parts: list[Array], drawing: list[Array]) -> float:
        """The weighted brightness error to be expected of lifted points (n, 3), evenly spaced on each curve.

        0.212 times the mean blur of what draws the outline, times its length, over the silhouette's area.
        """
        with self.decision.called("depth"):
            view, weight = self.view, np.concatenate(drawing)
            z = np.concatenate(parts)[:, 2]
            below = view.light_distance_mm - z
            blur = view.light_size_mm * (view.wall_distance_mm + z) / below / view.magnification
            mean = float((weight * blur).sum() / max(weight.sum(), 1e-9))
            error = _ABS_BLUR * mean * float(self.outline.length / self.outline.area)
            return _WEIGHT * self.strength * error
