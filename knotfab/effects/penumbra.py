"""Penumbra: the blur of a lamp that has a diameter."""

from __future__ import annotations

from knotfab.effects.base import Effect, EffectContext
from knotfab.scene.camera import view_axes
from knotfab.scene.model import ResolvedView

__all__ = ["PENUMBRA"]

VERIFIED_PX = 1024
_OF_TOLERANCE = 4.0  # a blur moves the half-light line by a small share of its width


def magnitude(situation: EffectContext) -> float:
    """Widest blur on a wall, in pixels: lamp diameter x (strand to wall) / (lamp to strand).

    Pixels of the verification: 1024 on the frame's longer side. The view where the blur is widest counts.
    """
    return max(_blur_px(view, situation) for view in situation.views)


def _blur_px(view: ResolvedView, situation: EffectContext) -> float:
    towards = view_axes(view)[2]
    high = float((situation.points @ towards).max()) + situation.limits.radius
    light = max(view.light_distance_mm - high, 1e-6)
    blur_mm = view.light_diameter_mm * (view.wall_distance_mm + high) / light
    return blur_mm / (view.longer_mm / VERIFIED_PX)


PENUMBRA = Effect(
    "penumbra",
    "px",
    magnitude,
    lambda s: _OF_TOLERANCE * s.tolerance_px,
    "the lamp is wide enough to blur the outline: the verification averages over it",
)
