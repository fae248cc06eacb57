"""Hard cases of the renderers: capsules, a view and a sharpness, each with why it is hard."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
import torch
from numpy.typing import NDArray

from knotfab.base.arrays import Array
from knotfab.render.silhouette import Frame

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
            "behind the light", "must not be seen at all", *_pairs((0.5, 0, -500), (3, 1, -400))
        ),
        RenderCase("thin", "a radius of 1e-12 mm: nothing to hit", *chain, radius=1e-12),
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
            "grazing", "40 strands anywhere at all depths", *_tangle(40, 8), radius=1.0, real=True
        ),
    )


def large_case(count: int, side: int) -> RenderCase:
    """Return an image of so many capsules that is too large to compare every pixel with every capsule."""
    ring_of, step = _close(ring(count, waves=3 if count < 1000 else 40)), 2.0**-4 / side
    why = "no pass over every pixel and every capsule"
    return RenderCase("large", why, *ring_of, 0.1, 1.0, side, side, step, real=True)
