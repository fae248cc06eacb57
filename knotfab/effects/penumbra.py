"""Penumbra: the blur of a lamp that has a diameter."""

from __future__ import annotations

import numpy as np

from knotfab.effects.base import Effect, Situation

__all__ = ["PENUMBRA"]


def magnitude(situation: Situation) -> float:
    """Widest blur on the wall, in pixels: lamp diameter x (strand to wall) / (lamp to strand)."""
    view = situation.view
    high = float(situation.points[:, 2].max())
    light = max(view.light_distance_mm - high, 1e-6)
    return float(
        view.light_diameter_mm * (view.wall_distance_mm + high) / light / situation.pixel_mm
        if np.isfinite(high)
        else np.inf
    )


PENUMBRA = Effect(
    "penumbra",
    "px",
    magnitude,
    lambda s: 4 * s.tolerance_px,
    "the lamp is wide enough to blur the outline: the verification averages over it",
)
