"""Penumbra: the blur of a lamp that has a size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from shapely import MultiPolygon

from knotfab.arrays import Array
from knotfab.compiled import compiled
from knotfab.effects.base import VERIFIED_PX, Decision, Effect, EffectContext
from knotfab.scene.camera import camera_of, view_axes
from knotfab.scene.curved_wall import CurvedWall
from knotfab.scene.model import ResolvedView

__all__ = ["PENUMBRA", "Sharpening", "blurs_mm"]

_LOWERED = 0.5  # share of the way to the wall that strands of the outline are lowered by, at most
_FULL_PX = 32.0  # of blur above the threshold, from which on it is that
# tube radii from the outline: a strand there draws none of it; over which that fades
_DRAWS = (2.0, 0.7)
_SMOOTH = 4.0  # along the curve, in tube radii: strands cannot change depth at once
# what a disc's blur b adds along an edge: b times the mean |x| in it
_ABS_BLUR = 4 / (3 * np.pi) / 2
_MOST = 400  # points whose surroundings are looked at
_WEIGHT = 8.0  # of the brightness error, against legibility


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

    which is d h / (H - h) / cos t / (1 - x² - (R / D)²), x = R tan(t) / D, with cos a taken as 1. A disc
    lies within its ball. A rectangle, or an array of LEDs, is the hull of its corners: the longest line in
    its image leads from one of these to another, and at both ends the longer part of a ball's ellipse,
    1 + tan(t) tan(a) of its half, is added. Each is largest in the direction of its slope, which is steepest
    where it is large: of all points but the largest few the bound is that of the middle alone. What that
    leaves out is of second order in radius / (H - h), and added. A round wall is taken for the plane that
    touches it where a point's shadow falls.
    """
    if view.kind == "eye" or view.light_size_mm == 0 or len(points) == 0:
        return np.zeros(len(points))
    camera = camera_of(view, 1, 1)  # where light and wall are: its pixels do not matter
    wall, (lamps, size) = CurvedWall.of(view), _lamps_of(view, camera.eye)
    planes = np.tile(camera.receiver, (len(points), 1))
    if wall is not None:
        round_ones = wall.touching(points)  # beside a column there is none
        planes = np.where(np.isfinite(round_ones), round_ones, planes)

    def blur(points: Array, planes: Array) -> Array:
        return _blurs(points, planes, lamps, size)

    below = ((camera.eye - points) * planes[:, :3]).sum(axis=1)
    here, step = blur(points, planes), 1e-6 * view.light_distance_mm
    found, most = here.max(axis=0), min(_MOST, len(points))
    few = np.argpartition(found, -most)[-most:]
    near, touched, here = points[few], planes[few], here[:, few]
    slope = np.stack([blur(near + step * way, touched) - here for way in np.eye(3)], axis=-1)
    slope /= np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-300)
    found[few] = np.max(
        [blur(near + radius * way, touched)[n] for n, way in enumerate(slope)], axis=0
    )
    return np.asarray(found * (1.0 + (radius / np.maximum(below, radius)) ** 2))


def _lamps_of(view: ResolvedView, middle: Array) -> tuple[Array, float]:
    """Places (n, 3) and diameter of balls in whose hull the lamp lies: one, or the corners of a rectangle."""
    if view.light_shape in ("disc", "ball"):
        return middle[None], view.light_diameter_mm
    right, up, _ = view_axes(view)
    size = view.light_diameter_mm if view.light_shape == "leds" else 0.0
    wide, high = 0.5 * view.light_width_mm * right, 0.5 * view.light_height_mm * up
    return middle + np.array([x * wide + y * high for x in (-1, 1) for y in (-1, 1)]), size


@compiled
def _blurs(points: Array, planes: Array, lamps: Array, size: float) -> Array:
    """(pairs of lamps, N) what balls at (n, 3) blur points (N, 3) to, at most, on planes (N, 4).

    Of one ball the ellipse's axis; of a pair the line between both middles, and half of each ellipse.
    """
    balls = len(lamps)
    found = np.empty((max(1, balls * (balls - 1) // 2), len(points)))
    spots, ends = np.empty((balls, 3)), np.empty(balls)
    for n in range(len(points)):
        x, y, z = points[n]
        a, b, c, d = planes[n]
        height = max(x * a + y * b + z * c + d, 0.0)
        for k in range(balls):
            u, v, w = x - lamps[k, 0], y - lamps[k, 1], z - lamps[k, 2]
            # the lamp's own ball reaches no strand
            below = max(-(u * a + v * b + w * c), max(0.5005 * size, 1e-9))
            far = max(np.sqrt(u * u + v * v + w * w), below)
            half = 0.5 * size * height * far / (below * below - 0.25 * size * size)
            if balls == 1:
                found[0, n] = 2 * half
                continue
            on = height / below
            spots[k, 0], spots[k, 1], spots[k, 2] = x + u * on, y + v * on, z + w * on
            lean = np.sqrt((far / below) ** 2 - 1) / np.sqrt(far * far - 0.25 * size * size)
            ends[k] = half * (1 + 0.5 * size * lean)
        pair = 0
        for k in range(balls):
            for m in range(k):
                u, v = spots[k, 0] - spots[m, 0], spots[k, 1] - spots[m, 1]
                w = spots[k, 2] - spots[m, 2]
                found[pair, n] = np.sqrt(u * u + v * v + w * w) + ends[k] + ends[m]
                pair += 1
    return found


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
