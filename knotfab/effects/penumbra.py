"""Penumbra: the blur of a lamp that has a size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from shapely import MultiPolygon

from knotfab.base.arrays import Array, Indices
from knotfab.effects.base import Decision, Effect, EffectContext, Shadows
from knotfab.scene.camera import light_of, view_axes
from knotfab_formats.scene import ResolvedView

_LOWERED = 0.5  # share of the way to the wall by which outline strands are lowered at most
_LOWERED_PX = 32.0  # px of blur above the threshold, from which on it has its full share
# tube radii from the outline, beyond which a strand draws none of it; and over which that fades
_DRAWS = (2.0, 0.7)
_OUTLINE_STEP = 0.05  # tube radii, between points of the outline that distances are taken to
_SMOOTH = 4.0  # along the curve, in tube radii: strands cannot change depth at once
# a disc's blur b adds b times the mean |x| in it along an edge
_ABS_BLUR = 4 / (3 * np.pi) / 2
_MOST = 400  # points whose surroundings are looked at
_STEP = 1e-6  # a share of the distance to the lamp, over which slopes are taken
_WEIGHT = 4.0  # the most that the brightness error weighs, against legibility
_WEIGHT_PX = 16.0  # px of blur above the threshold, from which on it has its full weight


def magnitude(context: EffectContext) -> float:
    """Return the widest blur of any strand's edge on a wall, in any view, px."""
    return max(
        float(blurs_mm(seen, context.radius).max(initial=0.0)) / seen.view.pixel_mm
        for seen in context.shadows
    )


def blurs_mm(shadows: Shadows, radius: float) -> Array:
    """Bound the blur of every edge within `radius` of places (N, 3), mm, (N,).

    An edge at distance D from the middle of a lamp, at height h over the wall's plane where the lamp is at H,
    is blurred over the section of a cone: the rays through it that touch the ball of radius R about
    the lamp, sin a = R / D. The plane cuts it at an angle t from its axis, cos t = (H - h) / D,
    in an ellipse with the longer axis

        h (tan(t + a) - tan(t - a)) = 2 R cos(a) h D / ((H - h)² - R²),

    which is d h / (H - h) / cos t / (1 - x² - (R / D)²), x = R tan(t) / D, with cos a taken as 1. A disc
    lies within its ball. A rectangle, or an array of LEDs, is the hull of its corners: the longest line in
    its image leads from one of these to another, and at both ends the longer part of a ball's ellipse,
    1 + tan(t) tan(a) of its half, is added. Each is largest in the direction of its slope, which is steepest
    where it is large: for all points but the largest few, only the middle's bound is computed. What that
    leaves out is of second order in radius / (H - h), and added.
    """
    view, places = shadows.view, shadows.places
    if view.kind == "eye" or view.light_size_mm == 0 or len(places) == 0:
        return np.zeros(len(places))
    lamps, size = _lamps_of(view)
    balls, pairs = shadows.wall.place(lamps), np.column_stack(np.tril_indices(len(lamps), -1))
    if len(lamps) == 1:
        pairs = np.zeros_like(pairs, shape=(1, 2))  # a lamp of one ball is paired with itself
    found = _blurs(places[:, None], balls, pairs, size).max(axis=1)
    most = min(_MOST, len(places))
    few = np.argpartition(found, -most)[-most:]
    found[few] = _blurs_about(places[few, None], balls, pairs, size, radius).max(axis=1)
    below = shadows.wall.lamp[2] - places[:, 2]
    return np.asarray(found * (1.0 + (radius / np.maximum(below, radius)) ** 2))


def _lamps_of(view: ResolvedView) -> tuple[Array, float]:
    """Return balls, by centres (n, 3) and diameter, whose hull holds the lamp: one, or one per corner."""
    right, up, _ = view_axes(view)
    middle = light_of(view)
    if not view.light_has_sides:
        return middle[None], view.light_diameter_mm
    size = view.light_diameter_mm if view.light_shape == "leds" else 0.0
    wide, high = 0.5 * view.light_width_mm * right, 0.5 * view.light_height_mm * up
    return middle + np.array([x * wide + y * high for x in (-1, 1) for y in (-1, 1)]), size


def _throw(places: Array, balls: Array, size: float) -> tuple[Array, Array, Array]:
    """Project balls (..., 3) through places (..., 3) onto the wall, z = 0, as ellipses.

    Returns the places hit by the central rays (..., 3), the half longer axes (...), and the reach from these
    places (...).
    """
    way = places - balls
    # no strand reaches into the lamp's own ball
    height, below = (
        np.maximum(places[..., 2], 0.0),
        np.maximum(-way[..., 2], max(0.5005 * size, 1e-9)),
    )
    square, quarter = np.maximum((way**2).sum(axis=-1), below * below), 0.25 * size * size
    half = 0.5 * size * height * np.sqrt(square) / (below * below - quarter)
    lean = (square / (below * below) - 1) / (square - quarter)
    return places + way * (height / below)[..., None], half, half * (1 + 0.5 * size * np.sqrt(lean))


def _blurs(places: Array, balls: Array, pairs: Indices, size: float) -> Array:
    """Bound the blur of edges at places (n, 1 or p, 3) before the wall by each of p pairs of balls, (n, p).

    That is the longest line in the hull of two ellipses, or the axis of one.
    """
    (middle, axis, reach), (other, _, further) = (_throw(places, balls[of], size) for of in pairs.T)
    apart = np.sqrt(((middle - other) ** 2).sum(axis=-1))
    return np.where(pairs[:, 0] == pairs[:, 1], 2 * axis, apart + reach + further)


def _blurs_about(places: Array, balls: Array, pairs: Indices, size: float, radius: float) -> Array:
    """Bound the blur as `_blurs` does, within `radius` of the places, each pair in its steepest direction."""
    here = _blurs(places, balls, pairs, size)
    step = _STEP * np.sqrt(((balls[0] - places) ** 2).sum(axis=-1))[..., None]
    beside = [_blurs(places + step * axis, balls, pairs, size) for axis in np.eye(3)]
    slope = np.stack(beside, axis=-1) - here[..., None]
    steepness = np.maximum(np.sqrt((slope**2).sum(axis=-1, keepdims=True)), 1e-300)
    return _blurs(places + radius * slope / steepness, balls, pairs, size)


PENUMBRA = Effect(
    "penumbra",
    "px",
    magnitude,
    4.0,  # a blur moves the half-light line by a small share of its width
    "the lamp is wide enough to blur the outline",
)


@dataclass(frozen=True)
class Sharpening:
    """The cost of depth under a wide lamp, which asks for outline strands near the wall.

    The error of a soft shadow in brightness is 0.212 times the blur along the outline, whatever strands do
    sideways; only depth lowers it. `outline`: the silhouette in the plane through the origin, mm.
    """

    decision: Decision
    view: ResolvedView
    outline: MultiPolygon
    radius: float

    def strength(self, full_px: float) -> float:
        """Return the strength: 0 at the threshold, 1 from `full_px` of blur above it on."""
        if not self.decision.simulated:
            return 0.0
        over = self.decision.magnitude - self.decision.threshold
        return float(np.clip(over / full_px, 0.0, 1.0))

    def drawing(self, curves: tuple[Array, ...]) -> list[Array]:
        """Return a weight for each point of evenly sampled closed curves, mm: 1 on the outline, 0 off it."""
        from scipy.spatial import cKDTree

        reach, fade = (share * self.radius for share in _DRAWS)
        # points of the outline so near to each other that where the share fades none is off by .001
        outline = shapely.segmentize(self.outline.boundary, _OUTLINE_STEP * self.radius)
        tree = cKDTree(shapely.get_coordinates(outline))
        found = []
        for curve in curves:
            away, _ = tree.query(curve, distance_upper_bound=reach)  # infinite beyond it
            step = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).mean())
            share = np.clip((reach - away) / fade, 0.0, 1.0)
            found.append(gaussian_filter1d(share, _SMOOTH * self.radius / step, mode="wrap"))
        return found

    def lower(self, heights: list[Array], drawing: list[Array]) -> list[Array]:
        """Lower the heights, mm, of each curve's outline strands towards the lowest of all."""
        low = min(float(h.min()) for h in heights)
        share = _LOWERED * self.strength(_LOWERED_PX)
        return [h + share * d * (low - h) for h, d in zip(heights, drawing, strict=True)]

    def cost(self, parts: list[Array], drawing: list[Array]) -> float:
        """Return the weighted brightness error expected of lifted points (n, 3), evenly spaced on each curve.

        0.212 times the mean blur of what draws the outline, times its length, over the silhouette's area.
        """
        with self.decision.called("depth"):
            view, weight = self.view, np.concatenate(drawing)
            z = np.concatenate(parts)[:, 2]
            below = view.light_distance_mm - z
            blur = view.light_size_mm * (view.wall_distance_mm + z) / below / view.magnification
            mean = float((weight * blur).sum() / max(weight.sum(), 1e-9))
            error = _ABS_BLUR * mean * float(self.outline.length / self.outline.area)
            return _WEIGHT * self.strength(_WEIGHT_PX) * error
