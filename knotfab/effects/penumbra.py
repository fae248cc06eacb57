"""Penumbra: the blur of a lamp that has a diameter."""

from __future__ import annotations

from knotfab.effects.base import Effect, Situation

__all__ = ["PENUMBRA"]

VERIFIED_PX = 1024


def magnitude(situation: Situation) -> float:
    """Widest blur on the wall, in pixels: lamp diameter x (strand to wall) / (lamp to strand).

    Pixels of the verification: 1024 on the frame's longer side.
    """
    view = situation.view
    high = float(situation.points[:, 2].max()) + situation.limits.radius
    light = max(view.light_distance_mm - high, 1e-6)
    width, height = view.frame_width_mm, view.frame_height_mm
    assert width is not None and height is not None
    blur_mm = view.light_diameter_mm * (view.wall_distance_mm + high) / light
    return blur_mm / (max(width, height) / VERIFIED_PX)


PENUMBRA = Effect(
    "penumbra",
    "px",
    magnitude,
    lambda s: 1.0,
    "the lamp is wide enough to blur the outline: the verification averages over it",
)
