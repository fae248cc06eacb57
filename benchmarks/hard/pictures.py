"""The hardest pictures: noise, fractals, slivers, hundreds of pieces, shapes that split when inset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin
from pathlib import Path

import matplotlib
import mpmath
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotfab.base.arrays import Array, Mask
from knotfab.render.silhouette import NEAREST_RADII

FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"


@dataclass(frozen=True)
class HardPicture:
    """One picture: `draw()` gives its mask (H, W), True where the shape is; `why` it is hard."""

    name: str
    why: str
    draw: Callable[[], Mask]

    def image(self) -> Image.Image:
        """Return black on white, mode "L"."""
        return Image.fromarray(np.where(self.draw(), 0, 255).astype(np.uint8))


def hard_pictures() -> tuple[HardPicture, ...]:
    """Return all of them, in one order."""
    return (
        HardPicture("checkerboard", "squares of one pixel: all outline, no area to fill", _checks),
        HardPicture("noise", "every pixel by the toss of a coin: thousands of specks", _noise),
        HardPicture("cantor", "bars of the Cantor set: gaps at every scale", _cantor),
        HardPicture("koch", "Koch's curve turned inwards: it touches itself at every scale", _koch),
        HardPicture("carpet", "Sierpinski's carpet: holes at every scale", _carpet),
        HardPicture("hairline", "one pixel wide: no tube fits", partial(_lines, 1)),
        HardPicture("blank", "nothing to show", partial(_even, False)),
        HardPicture("full", "all ink: the border's own colour", partial(_even, True)),
        HardPicture("pixel", "a single pixel", _pixel),
        HardPicture("nearly-closed", "a ring with a gap of one pixel", partial(_ring, 1)),
        HardPicture("dots", "400 loose dots", _dots),
        HardPicture("page", "a page of text: hundreds of pieces, many with holes", _page),
        HardPicture("spiral", "one thin strand that passes itself a dozen times", _spiral),
        HardPicture("rings", "twenty rings within rings", _rings),
        HardPicture("comb", "teeth of two pixels on a broad back", _comb),
        HardPicture("kiss", "two discs that touch in one point", partial(_discs, 0)),
        HardPicture("dumbbell", "inset, it falls in two", partial(_discs, -24)),
        HardPicture("sliver", "a triangle 500 times as long as it is high", _sliver),
        HardPicture("strip", "a frame of 2000 by 3 pixels", _strip),
        HardPicture("lattice", "bars of six pixels that cross: 144 holes", _lattice),
    )


def _grid(width: int, height: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    v, u = np.mgrid[:height, :width]
    return u, v


def _add_margin(mask: Mask, margin: int = 16) -> Mask:
    return np.pad(mask, margin)


def _checks() -> Mask:
    u, v = _grid(224, 224)
    return _add_margin((u + v) % 2 == 0)


def _noise() -> Mask:
    return _add_margin(np.random.default_rng(6).random((224, 224)) < 0.5)


def _cantor() -> Mask:
    row = np.ones(1, dtype=bool)
    for _ in range(5):
        row = np.concatenate([row, np.zeros_like(row), row])
    return _add_margin(np.tile(row, (160, 1)))


def _polygon(corners: list[tuple[float, float]], size: int) -> Mask:
    image = Image.new("1", (size, size))
    ImageDraw.Draw(image).polygon(corners, fill=1)
    return np.asarray(image)


def _koch() -> Mask:
    z = 300 + 300j + 250 * np.exp(2j * pi * (np.arange(4) / 3 + 0.25))
    for _ in range(5):
        a, step = z[:-1], np.diff(z) / 3
        z = np.append(
            np.stack([a, a + step, a + step * (1 + np.exp(1j * pi / 3)), a + 2 * step], 1), z[-1]
        )
    return _polygon([(float(c.real), float(c.imag)) for c in z], 600)


def _carpet() -> Mask:
    mask = np.ones((1, 1), dtype=bool)
    for _ in range(5):
        hole = np.zeros_like(mask)
        edge = np.concatenate([mask, mask, mask], 1)
        mask = np.concatenate([edge, np.concatenate([mask, hole, mask], 1), edge])
    return _add_margin(mask)


def _lines(width: int) -> Mask:
    mask = np.zeros((256, 256), dtype=bool)
    mask[128 : 128 + width, 20:236] = True
    mask[20:236, 60 : 60 + width] = True
    return mask


def _even(ink: bool) -> Mask:
    return np.full((128, 128), ink)


def _pixel() -> Mask:
    mask = np.zeros((129, 129), dtype=bool)
    mask[64, 64] = True
    return mask


def _ring(gap: int) -> Mask:
    u, v = _grid(401, 401)
    r = np.hypot(u - 200, v - 200)
    mask = (r < 170) & (r > 120)
    mask[200 : 200 + gap, 200:] = False
    return mask


def _dots() -> Mask:
    u, v = _grid(480, 480)
    return _add_margin(np.hypot(u % 24 - 11.5, v % 24 - 11.5) < 7)


def _page() -> Mask:
    image = Image.new("1", (900, 600))
    font = ImageFont.truetype(FONT, 34)
    words = "a knot is a closed curve in space; its shadow may be any picture at all. "
    text = words * 6
    lines = "\n".join(text[k : k + 44] for k in range(0, len(text), 44))
    ImageDraw.Draw(image).multiline_text((20, 20), lines, fill=1, font=font)
    return np.asarray(image)


def _spiral() -> Mask:
    image = Image.new("1", (600, 600))
    turn = np.linspace(0, 24 * pi, 2400)
    points = [(300 + 3.6 * t * cos(t), 300 + 3.6 * t * sin(t)) for t in turn]
    ImageDraw.Draw(image).line(points, fill=1, width=9)
    return np.asarray(image)


def _rings() -> Mask:
    u, v = _grid(641, 641)
    r = np.hypot(u - 320, v - 320)
    return np.asarray((r // 7.5 % 2 == 0) & (r < 300))


def _comb() -> Mask:
    mask = np.zeros((300, 400), dtype=bool)
    mask[40:110, 20:380] = True
    for left in range(24, 380, 8):
        mask[110:270, left : left + 2] = True
    return mask


def _discs(gap: int) -> Mask:
    u, v = _grid(480, 280)
    away = np.minimum(np.hypot(u - 140.5, v - 140), np.hypot(u - 340.5 - gap / 4, v - 140))
    mask = away < 100
    if gap < 0:
        mask |= (abs(v - 140) < 8) & (abs(u - 240) < 60)
    return np.asarray(mask)


def _sliver() -> Mask:
    u, v = _grid(1000, 60)
    return np.asarray((u > 20) & (u < 980) & (v >= 29) & ((v - 29) * 480.0 <= 980 - u))


def _strip() -> Mask:
    mask = np.zeros((3, 2000), dtype=bool)
    mask[1, 100:1900] = True
    return mask


def _lattice() -> Mask:
    u, v = _grid(396, 396)
    return _add_margin((u % 30 < 6) | (v % 30 < 6))


# Hard centre lines: links and knots of few, long edges, touching strands, tubes at their bending
# limit.


@dataclass(frozen=True)
class HardKnot:
    """Closed polygons whose type a step could change; `why` that is easy here."""

    name: str
    why: str
    make: Callable[[], list[Array]]


def hard_knots() -> tuple[HardKnot, ...]:
    """Return all of them, in one order."""
    return (
        HardKnot("trefoil", "12 long edges that pass each other closely", partial(_one, 2, 3, 12)),
        HardKnot("T(2,5)", "20 edges, five crossings", partial(_one, 2, 5, 20)),
        HardKnot(
            "Hopf link",
            "two hexagons through each other: one pass frees them",
            partial(hopf_link, 6),
        ),
        HardKnot("free rings", "two rings side by side: one pass links them", _apart),
        HardKnot("touching", "two rings a millionth apart", _touching),
        HardKnot("hairpin", "an unknot folded on itself: kinks may cross, or fold back", _hairpin),
    )


def circle(count: int, radius: float = 1.0) -> Array:
    """Return [count] a regular polygon in the plane z = 0."""
    s = 2 * pi * np.arange(count) / count
    return radius * np.stack([np.cos(s), np.sin(s), 0 * s], 1)


def torus_knot(p: int, q: int, count: int) -> Array:
    """Return [count, 3] T(p, q) about the z axis."""
    s = 2 * pi * np.arange(count) / count
    r = 2 + np.cos(q * s)
    return np.stack([r * np.cos(p * s), r * np.sin(p * s), np.sin(q * s)], 1)


def _one(p: int, q: int, count: int) -> list[Array]:
    return [torus_knot(p, q, count)]


def hopf_link(count: int) -> list[Array]:
    """Return two polygons [count, 3], each through the other."""
    ring = circle(count)
    return [ring, ring[:, [0, 2, 1]] + (1.0, 0.05, 0.03)]


def _apart() -> list[Array]:
    return [circle(7), circle(8) + (2.3, 0.0, 0.1)]


def _touching() -> list[Array]:
    return [circle(10), circle(10) + (0.0, 0.0, 1e-6)]


def _hairpin() -> list[Array]:
    s = np.linspace(0, 4, 9)
    there = np.stack([s, 0.05 * np.sin(3 * s), 0 * s], 1)
    return [np.concatenate([there, there[::-1] + (0.0, 0.0, 0.05)])]


# The signed distance of a capsule's silhouette in 50 digits: what double precision is held
# against.


_ZERO = mpmath.mpf(0)
Vector = list[mpmath.mpf]


def _dot(a: Vector, b: Vector) -> mpmath.mpf:
    return mpmath.fsum(x * y for x, y in zip(a, b, strict=True))


def signed_distance_px(
    a: list[float], b: list[float], q: tuple[float, float], radius: float, focal_px: float
) -> mpmath.mpf | None:
    """Return (r - d) focal / z for the ray (q, 1): d from the line to the segment a-b, z where it is nearest.

    None for what lies before the light's near plane. The least distance is found from the components of
    both ends across the ray, not from moments.
    """
    with mpmath.workdps(50):
        one, two = [mpmath.mpf(x) for x in a], [mpmath.mpf(x) for x in b]
        least = mpmath.mpf(max(NEAREST_RADII * radius, 1e-9))
        if one[2] < least and two[2] < least:
            return None
        one, two = _cut(one, two, least), _cut(two, one, least)
        d = [mpmath.mpf(q[0]), mpmath.mpf(q[1]), mpmath.mpf(1)]
        across = []
        for p in (one, two):
            share = _dot(p, d) / _dot(d, d)
            across.append([x - share * y for x, y in zip(p, d, strict=True)])
        way = [y - x for x, y in zip(*across, strict=True)]
        square = _dot(way, way)
        t = _ZERO if square == 0 else -_dot(across[0], way) / square
        t = min(max(t, _ZERO), mpmath.mpf(1))
        at = [x + t * w for x, w in zip(across[0], way, strict=True)]
        depth = one[2] + t * (two[2] - one[2])
        return (mpmath.mpf(radius) - mpmath.sqrt(_dot(at, at))) * mpmath.mpf(focal_px) / depth


def _cut(end: Vector, other: Vector, least: mpmath.mpf) -> Vector:
    if end[2] >= least:
        return end
    t = (least - end[2]) / (other[2] - end[2])
    return [x + t * (y - x) for x, y in zip(end, other, strict=True)]
