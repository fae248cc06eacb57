"""Hard cases of the renderers: capsules, a view and a sharpness, each with why it is hard."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import mpmath
import numpy as np
import torch
from measure import EPSILONS
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.effects.base import Shadows
from knotfab.effects.penumbra import blurs_mm
from knotfab.render.silhouette import Frame
from knotfab.scene.camera import CurvedWall
from knotfab_formats.scene import ResolvedView

STEP = 2.0**-10  # x/z per pixel: 1024 px of focal length, and pixel centres are exact numbers


@dataclass(frozen=True)
class RenderCase:
    """Segments between `points`, seen by a light at `eye` that looks along z. Lengths in mm.

    `real`: a scene can ask for it. `smooth`: differentiable there. `kinks`: pixels (u, v) where it is not.
    """

    name: str
    why: str
    points: Array  # [m, 3]
    edges: NDArray[np.int64]  # [n, 2]
    radius: float = 2.0
    tau: float = 4.0
    width: int = 48
    height: int = 40
    step: float = STEP
    eye: tuple[float, float, float] = (0.0, 0.0, 0.0)
    real: bool = False
    smooth: bool = True
    kinks: tuple[tuple[int, int], ...] = ()


def frame_at(case: RenderCase, dtype: torch.dtype, pixel: tuple[int, int] | None = None) -> Frame:
    """Return the view of the case, or of one of its pixels alone."""
    u0, v0 = -0.5 * (case.width - 1), -0.5 * (case.height - 1)
    size = (case.width, case.height)
    if pixel is not None:
        u0, v0, size = u0 + pixel[0], v0 + pixel[1], (1, 1)
    axes = torch.eye(3, dtype=dtype)
    return Frame(axes, torch.tensor(case.eye, dtype=dtype), u0, v0, case.step, *size)


def _pairs(*points: tuple[float, float, float]) -> tuple[Array, NDArray[np.int64]]:
    p = np.array(points, dtype=np.float64)
    return p, np.arange(len(p), dtype=np.int64).reshape(-1, 2)


def ring(count: int, size: float = 9.0, depth: float = 500.0, waves: int = 3) -> Array:
    """Return [count, 3] a closed, wavy curve about the axis of the view."""
    s = 2 * pi * np.arange(count) / count
    r = size * (1 + 0.25 * np.cos(waves * s))
    return np.stack([r * np.cos(s), 0.8 * r * np.sin(s), depth + 12 * np.sin(2 * s + 0.3)], 1)


def _close(points: Array) -> tuple[Array, NDArray[np.int64]]:
    rows = np.arange(len(points), dtype=np.int64)
    return points, np.stack([rows, np.roll(rows, -1)], 1)


def _tangle(count: int, seed: int) -> tuple[Array, NDArray[np.int64]]:
    """Return segments anywhere in the view."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(400, 600, (2 * count, 1))
    xy = rng.uniform(-22, 22, (2 * count, 2)) * STEP * z
    return np.concatenate([xy, z], 1), np.arange(2 * count, dtype=np.int64).reshape(-1, 2)


def render_cases(samples: int = 50_000) -> tuple[RenderCase, ...]:
    """Render all of them, in one order; `samples` of the curve that has most."""
    q, r = (5.5 * STEP, 3.5 * STEP), 4.5 * STEP
    chain = _close(ring(60))
    return (
        RenderCase("ordinary", "none: what every other row is held against", *chain, real=True),
        RenderCase(
            "towards the light",
            "a ray runs along the segment: its nearest point is 0/0",
            *_pairs((q[0] * 480, q[1] * 480, 480), (q[0] * 500, q[1] * 500, 500)),
            smooth=False,
            kinks=((29, 23),),
            real=True,
        ),
        RenderCase(
            "nearly towards the light",
            "the same, off by a millionth: the nearest point jumps from end to end",
            *_pairs((q[0] * 480, q[1] * 480, 480), (q[0] * 500 + 1e-6, q[1] * 500, 500)),
            smooth=False,
        ),
        RenderCase(
            "one depth",
            "ends equally deep: the vanishing point is at infinity",
            *_pairs((-6.1, -3, 500), (5.7, 4, 500)),
            real=True,
        ),
        RenderCase(
            "sphere in sphere",
            "one end's sphere hides the other's: no common tangent",
            *_pairs((0.03, 0.05, 480), (0.05, 0.03, 500)),
        ),
        RenderCase(
            "zero length",
            "a segment whose ends coincide",
            *_pairs((3.1, 2.2, 500), (3.1, 2.2, 500)),
            real=True,
            smooth=False,
            kinks=((33, 24), (26, 22)),
        ),
        RenderCase(
            "coincident",
            "two capsules in one place: both win every pixel",
            *_pairs((-5, 1, 500), (6, 3, 490), (-5, 1, 500), (6, 3, 490)),
            smooth=False,
            kinks=((24, 23), (20, 22)),
        ),
        RenderCase(
            "at the light",
            "the tube holds the light itself",
            *_pairs((0.5, 0.2, 1.0), (4.0, 3.0, 500)),
            real=False,
        ),
        RenderCase(
            "through the light's plane",
            "lines of rays go on behind the light and meet the segment there too",
            *_pairs((5, 2, -100), (5, 2, 500)),
        ),
        RenderCase(
            "behind the light",
            "must not be seen at all",
            *_pairs((0.5, 0, -500), (3, 1, -400)),
        ),
        RenderCase(
            "thin",
            "a radius of 1e-12 mm: nothing to hit",
            *chain,
            radius=1e-12,
        ),
        RenderCase(
            "no radius", "a radius of 0", *_pairs((-6.1, -3, 500), (5.7, 4, 510)), radius=0.0
        ),
        RenderCase(
            "larger than the frame",
            "the tube fills the picture",
            *_pairs((-9, 4, 900), (12, 3, 950)),
            radius=200.0,
        ),
        RenderCase("soft", "tau = 1: every pixel sees every strand", *chain, tau=1.0, real=True),
        RenderCase("sharp", "tau = 1e6: the sigmoid is a step, its slope 250,000", *chain, tau=1e6),
        RenderCase(
            "on the line",
            "pixel centres exactly on the centre line: distance 0 has no gradient",
            *_pairs((-8.5 * STEP * 512, 0.5 * STEP * 512, 512), (r * 512, 0.5 * STEP * 512, 512)),
            smooth=False,
            kinks=((20, 20), (25, 20)),
            tau=0.5,
            real=True,
        ),
        RenderCase(
            "equidistant",
            "pixels as far from one strand as from the other: two winners",
            *_pairs((-3, -8, 500), (-3, 8, 500), (3, -8, 500), (3, 8, 500)),
            width=49,
            smooth=False,
            kinks=((24, 20), (24, 3)),
            real=True,
        ),
        RenderCase("triangle", "N = 3", *_close(ring(3)), real=True),
        RenderCase(
            f"{samples:,} samples",
            "edges of a micrometre: every sum of squares is tiny",
            *_close(ring(samples)),
            width=12,
            height=3,
            step=2.0**-8,
            real=True,
        ),
        RenderCase("one row", "a picture of 1 x 4096", *chain, width=4096, height=1, step=2.0**-16),
        RenderCase("one column", "a picture of one column", *chain, width=1, height=64, real=True),
        RenderCase(
            "millionth",
            "everything scaled by 1e-6: squares near 1e-12",
            chain[0] * 1e-6,
            chain[1],
            radius=2e-6,
        ),
        RenderCase("million", "everything scaled by 1e6", chain[0] * 1e6, chain[1], radius=2e6),
        RenderCase(
            "shifted",
            "everything shifted by 1e6 mm: single precision has steps of 0.06 mm there",
            chain[0] + 1e6,
            chain[1],
            eye=(1e6, 1e6, 1e6),
        ),
        RenderCase(
            "denormal",
            "coordinates of 1e-310 (1e-40 in single precision)",
            *_pairs((1e-310, 1e-40, 500), (-1e-40, 8, 510), (1e-40, 1e-310, 480), (7, 0, 490)),
        ),
        RenderCase(
            "far out",
            "one end far outside the picture: its middle is thousands of pixels away",
            *_pairs((-5, 2, 500), (3000, 900, 200), (2, -4, 520), (-9000, -200, 30)),
        ),
        RenderCase(
            "grazing",
            "40 strands anywhere at all depths",
            *_tangle(40, 8),
            radius=1.0,
            real=True,
        ),
    )


def large_case(count: int, side: int) -> RenderCase:
    """Return an image of so many capsules that is too large to compare every pixel with every capsule."""
    ring_of, step = _close(ring(count, waves=3 if count < 1000 else 40)), 2.0**-4 / side
    why = "no pass over every pixel and every capsule"
    return RenderCase("large", why, *ring_of, 0.1, 1.0, side, side, step, real=True)


# Hard cases of round walls and of lamps that have a size, against their geometry in 50 digits.


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
    for exact, given, found in (
        (_flatten, places, flat),
        (_unroll, flat, case.wall.unroll(flat)),
    ):
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
        return float(blurs_mm(Shadows.of(self.view, np.array([self.at])), _THIN_MM)[0])

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
