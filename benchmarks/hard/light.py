"""Hard cases of lamps that have a size, against their geometry in 50 digits."""

from __future__ import annotations

from dataclasses import dataclass

import mpmath
import numpy as np

from knotfab.effects.base import Shadows
from knotfab.effects.penumbra import blurs_mm
from knotfab_formats.scene import ResolvedView

__all__ = ["LampCase", "lamp_cases"]

_WALL_MM = 100.0  # from the middle of the piece to the wall
_THIN_MM = 1e-9  # the tube: its own width adds nothing to the blur


@dataclass(frozen=True)
class LampCase:
    """A ball of `lamp_mm` that shines from `far_mm` on a strand through `at`. In mm."""

    name: str
    why: str
    at: tuple[float, float, float]
    lamp_mm: float
    far_mm: float = 500.0

    @property
    def view(self) -> ResolvedView:
        """Wall, lamp and frame."""
        return ResolvedView(
            frame_width_mm=200.0,
            frame_height_mm=200.0,
            wall_distance_mm=_WALL_MM,
            light_distance_mm=self.far_mm,
            light_shape="ball",
            light_diameter_mm=self.lamp_mm,
        )

    def claimed(self) -> float:
        """Return the bound that the effect uses, mm."""
        return float(blurs_mm(Shadows.from_points(self.view, np.array([self.at])), _THIN_MM)[0])

    def true(self) -> float:
        """Return the longer axis of the ellipse in which the wall cuts the cone of rays about the ball."""
        with mpmath.workdps(50):
            x, y, z = (mpmath.mpf(c) for c in self.at)
            radius, far = mpmath.mpf(self.lamp_mm) / 2, mpmath.mpf(self.far_mm)
            side, below, height = mpmath.hypot(x, y), far - z, z + _WALL_MM
            away = mpmath.hypot(side, below)
            tilt, half = mpmath.atan2(side, below), mpmath.asin(radius / away)
            return float(height * (mpmath.tan(tilt + half) - mpmath.tan(tilt - half)))


def lamp_cases() -> tuple[LampCase, ...]:
    """Return all of them, in one order."""
    return (
        LampCase("lamp", "none: what the others are held against", (20.0, 30.0, 0.0), 20.0),
        LampCase("lamp of a nanometre", "the tangents cancel", (20.0, 30.0, 0.0), 1e-6),
        LampCase("lamp as wide as far", "rays leave at 45 degrees", (0.0, 0.0, 20.0), 660.0),
        LampCase("lamp about a strand", "they all but touch", (0.0, 0.0, 480.0), 39.9),
        LampCase("on the wall", "no height, no blur", (20.0, 30.0, 1e-9 - _WALL_MM), 20.0),
        LampCase("far aside", "light at 80 degrees", (2800.0, 0.0, 0.0), 20.0),
        LampCase("a sun nearly", "a lamp a kilometre away", (20.0, 30.0, 0.0), 1e4, 1e6),
    )
