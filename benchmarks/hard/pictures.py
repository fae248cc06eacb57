"""The hardest pictures: noise, fractals, slivers, hundreds of pieces, shapes that split when inset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from knotfab.base.arrays import Mask

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
