"""Perspective: rays that spread from a lamp near by, against parallel light."""

from __future__ import annotations

import numpy as np

from knotfab.effects.base import Effect, Situation

__all__ = ["PERSPECTIVE"]


def magnitude(situation: Situation) -> float:
    """How far parallel light would misplace a shadow, in pixels.

    A point at height z above the middle of the piece is magnified by 1 / (1 - z / light distance).
    """
    view = situation.view
    if view.wall_tilt_deg != 0:
        return np.inf  # a tilted wall needs its projective map
    across = float(np.abs(situation.points[:, :2]).max())
    depth = float(np.abs(situation.points[:, 2]).max()) + situation.limits.radius
    light = view.light_distance_mm
    return across * view.magnification * depth / max(light - depth, 1e-6) / situation.pixel_mm


PERSPECTIVE = Effect(
    "perspective",
    "px",
    magnitude,
    lambda s: s.tolerance_px,
    "the lamp is near: its rays spread through the depth of the piece",
)
