"""Hard cases of round walls and of lamps that have a size, against their geometry in 50 digits."""

from __future__ import annotations

from dataclasses import dataclass

import mpmath
import numpy as np

from knotfab.effects.base import Shadows
from knotfab.effects.penumbra import blurs_mm
from knotfab.scene.camera import CurvedWall
from knotfab_formats.scene import ResolvedView

from .measure import EPSILONS

__all__ = ["LampCase", "WallCase", "lamp_cases", "wall_cases", "wall_shares"]

_PLACES = 9  # across a wall
_WALL_MM = 100.0  # from the middle of the piece to the wall
_THIN_MM = 1e-9  # the tube: its own width adds nothing to the blur


@dataclass(frozen=True)
class WallCase:
    """A cylinder of `radius` before which the light is at `high` and `up`; arcs to `reach` aside. In mm."""

    name: str
    why: str
    radius: float
    high: float
    up: float
    reach: float

    @property
    def wall(self) -> CurvedWall:
        """With the wall's own axes."""
        light = np.array([0.0, self.up, self.high])
        size = (2 * self.reach, 2 * self.reach, 0.0)
        return CurvedWall(self.radius, np.eye(3), np.zeros(3), light, size)


def wall_cases() -> tuple[WallCase, ...]:
    """Return all of them, in one order."""
    return (
        WallCase(
            "hollow wall", "none: what the others are held against", 2000.0, 900.0, 50.0, 400.0
        ),
        WallCase("column", "light from outside", -300.0, 900.0, 50.0, 200.0),
        WallCase("nearly flat", "the roots of the ray's equation cancel", 1e9, 900.0, 0.0, 200.0),
        WallCase("nearly flat, away", "the same, bent the other way", -1e9, 900.0, 0.0, 200.0),
        WallCase("grazing a column", "light falls at 88 degrees", -100.0, 900.0, 0.0, 142.0),
        WallCase("light on the axis", "every ray is as long", 900.0, 900.0, 0.0, 1000.0),
        WallCase("light at the far side", "one root is nothing", 450.0005, 900.0, 0.0, 300.0),
        WallCase("a millimetre of a large wall", "arcs of micrometres", 2000.0, 900.0, 1e4, 1e-3),
    )


def wall_shares(case: WallCase) -> tuple[float, float]:
    """Give (error mm, share of 16 epsilons times condition) of `flatten` and `unroll`, the worst of nine."""
    arcs = case.reach * np.linspace(-1, 1, _PLACES)
    places = np.column_stack([arcs, 0.7 * case.reach * np.cos(3 * arcs / case.reach)])
    flat = case.wall.flatten(places)
    error = share = 0.0
    for exact, given, found in ((_flatten, places, flat), (_unroll, flat, case.wall.unroll(flat))):
        for place, other in zip(given, found, strict=True):
            inputs = [*place.tolist(), case.radius, case.high, case.up]
            for axis in (0, 1):
                off, bound = _off(exact, axis, inputs, float(other[axis]))
                error, share = max(error, off), max(share, off / bound)
    return error, share


def _off(exact, axis, inputs, found):  # type: ignore[no-untyped-def]
    """Measure how far a number is off, and 16 epsilons times the sum over all inputs of |df/dx| |x|."""
    with mpmath.workdps(50):
        at = [mpmath.mpf(x) for x in inputs]
        true = exact(*at)[axis]
        size = abs(true)
        for k, x in enumerate(at):
            h = mpmath.mpf("1e-20") * max(abs(x), 1)
            moved = [y + h * (k == m) for m, y in enumerate(at)]
            size += abs((exact(*moved)[axis] - true) / h * x)
        off = mpmath.inf if not np.isfinite(found) else abs(mpmath.mpf(found) - true)
        return float(off), max(EPSILONS * np.finfo(float).eps * float(size), 1e-300)


def _flatten(arc, y, radius, high, up):  # type: ignore[no-untyped-def]
    """Find where the ray through a place of the wall meets the flat wall."""
    turn = arc / radius
    x, before = radius * mpmath.sin(turn), 2 * radius * mpmath.sin(turn / 2) ** 2
    share = high / (high - before)
    return x * share, up + (y - up) * share


def _unroll(x, y, radius, high, up):  # type: ignore[no-untyped-def]
    """Find where the ray to a place of the flat wall meets the round one: by its equation's roots."""
    a, b, c = x * x + high**2, -2 * high * (high - radius), high * (high - 2 * radius)
    root = mpmath.sqrt(b * b - 4 * a * c)
    t = min(((-b + s * root) / (2 * a) for s in (-1, 1)), key=lambda t: abs(t - 1))
    across, before = x * t, high * (1 - t)
    sign = mpmath.sign(radius)
    arc = abs(radius) * mpmath.atan2(across, sign * (radius - before))
    return arc, up + (y - up) * t


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
