"""Photographs, painted: gradients, soft edges, grain."""

from __future__ import annotations

from math import atan2, cos, degrees, pi, sin
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFilter, ImageFont, ImageOps

from examples.pictures import BOLD, Canvas

Grey = np.ndarray


def _layer(c: Canvas, blur: float) -> Grey:
    """Return what is drawn on a canvas as coverage 0 .. 1, with an edge as soft as `blur` px."""
    return 1 - np.asarray(c.finish().filter(ImageFilter.GaussianBlur(blur)), dtype=float) / 255


def _photo(colour: Grey, seed: int, grain: float = 5.0) -> Image.Image:
    noise = np.random.default_rng(seed).normal(0, grain, colour.shape)
    return Image.fromarray(np.clip(colour + noise, 0, 255).astype(np.uint8))


def backlit() -> Image.Image:
    """Draw a walker and a dog under a tree against the evening sky."""
    c = Canvas(1.0, 0.75)
    c.shape([(0.0, 0.64), (0.3, 0.62), (0.7, 0.65), (1.0, 0.63), (1.0, 0.75), (0.0, 0.75)])
    c.stroke([(0.20, 0.66), (0.215, 0.50), (0.20, 0.34)], 0.06, 0.04)
    for x, y, r in (
        (0.20, 0.24, 0.13),
        (0.10, 0.29, 0.08),
        (0.31, 0.28, 0.085),
        (0.22, 0.14, 0.09),
    ):
        c.disc(x, y, r)
    c.disc(0.60, 0.30, 0.042)
    c.blob(
        [(0.565, 0.36), (0.635, 0.36), (0.645, 0.46), (0.625, 0.52), (0.575, 0.52), (0.555, 0.46)]
    )
    c.stroke([(0.585, 0.50), (0.565, 0.64)], 0.042, 0.034)
    c.stroke([(0.615, 0.50), (0.645, 0.64)], 0.042, 0.034)
    c.stroke([(0.63, 0.39), (0.69, 0.46), (0.73, 0.45)], 0.03, 0.026)
    c.stroke([(0.73, 0.45), (0.81, 0.55)], 0.014)
    c.stroke([(0.80, 0.565), (0.90, 0.565)], 0.055)
    c.disc(0.79, 0.53, 0.03)
    for x in (0.81, 0.83, 0.88, 0.90):
        c.stroke([(x, 0.57), (x - 0.005, 0.65)], 0.02)
    c.curve([(0.91, 0.56), (0.945, 0.53), (0.955, 0.49)], 0.02)
    ink = _layer(c, 1.2)[..., None]
    height, width = ink.shape[:2]
    rise = np.linspace(0, 1, height)[:, None, None] * np.ones((1, width, 1))
    sky = np.array([176.0, 190.0, 216.0]) * (1 - rise) + np.array([255.0, 205.0, 140.0]) * rise
    return _photo(sky * (1 - ink) + np.array([28.0, 24.0, 30.0]) * ink, 1)


def jug() -> Image.Image:
    """Draw a dark jug on a pale table, with a soft shadow and a gleam."""
    c = Canvas(0.9, 1.0)
    c.blob([
        (0.34, 0.14), (0.52, 0.14), (0.55, 0.30), (0.66, 0.50), (0.67, 0.70), (0.56, 0.86), (0.34, 0.86),
        (0.22, 0.70), (0.23, 0.50), (0.33, 0.30),
    ])  # fmt: skip
    c.shape([(0.33, 0.13), (0.26, 0.10), (0.34, 0.24)])
    c.curve([(0.54, 0.22), (0.70, 0.20), (0.79, 0.34), (0.76, 0.50), (0.65, 0.56)], 0.05)
    body = _layer(c, 1.5)
    s = Canvas(0.9, 1.0)
    s.disc(0.52, 0.87, 0.30, 0.05)
    shade = _layer(s, 18.0)
    g = Canvas(0.9, 1.0)
    g.curve([(0.32, 0.48), (0.30, 0.58), (0.32, 0.68)], 0.024)
    gleam = _layer(g, 6.0)
    height, width = body.shape
    table = 222 + 14 * np.linspace(-1, 1, height)[:, None] + np.zeros((1, width))
    grey = table * (1 - 0.22 * shade)
    grey = (
        grey * (1 - body) + (58 + 20 * np.linspace(-1, 1, width)[None]) * body + 60 * gleam * body
    )
    warm = np.array([1.0, 0.97, 0.92])
    return _photo(grey[..., None] * warm, 2)


def portrait() -> Image.Image:
    """Draw a face in soft light before a pale wall: dark hair, eyes and a jumper, skin half-way."""

    def layer(draw: object, blur: float) -> Grey:
        c = Canvas(0.8, 1.0)
        draw(c)  # type: ignore[operator]
        return _layer(c, blur)

    def hair(c: Canvas) -> None:
        c.blob(
            [
                (0.40, 0.10),
                (0.56, 0.14),
                (0.62, 0.30),
                (0.60, 0.46),
                (0.20, 0.46),
                (0.18, 0.30),
                (0.24, 0.14),
            ]
        )

    def face(c: Canvas) -> None:
        c.blob(
            [
                (0.40, 0.21),
                (0.51, 0.25),
                (0.54, 0.38),
                (0.51, 0.52),
                (0.40, 0.60),
                (0.29, 0.52),
                (0.26, 0.38),
                (0.29, 0.25),
            ]
        )
        c.stroke([(0.40, 0.55), (0.40, 0.70)], 0.15)

    def features(c: Canvas) -> None:
        for x in (0.335, 0.465):
            c.disc(x, 0.385, 0.026, 0.014)
            c.curve([(x - 0.045, 0.345), (x, 0.33), (x + 0.045, 0.345)], 0.014)
        c.curve([(0.35, 0.515), (0.40, 0.528), (0.45, 0.515)], 0.017)
        c.curve([(0.40, 0.39), (0.385, 0.45), (0.41, 0.462)], 0.008)

    def jumper(c: Canvas) -> None:
        c.blob(
            [
                (0.40, 0.66),
                (0.60, 0.70),
                (0.74, 0.80),
                (0.80, 1.06),
                (0.40, 1.10),
                (0.0, 1.06),
                (0.06, 0.80),
                (0.20, 0.70),
            ]
        )
        c.disc(0.40, 0.645, 0.085, ink=255)

    side = np.linspace(-1, 1, round(0.8 * 1024))[None]
    grey = 214 + 12 * side + np.zeros((1024, 1))
    for drawn, blur, tone in (
        (hair, 4.0, 48.0),
        (jumper, 3.0, 70.0),
        (face, 3.0, 150.0),
        (features, 2.0, 66.0),
    ):
        ink = layer(drawn, blur)
        grey = grey * (1 - ink) + (tone - 16 * side) * ink
    return _photo(grey, 3)


# What the pictures are painted with: tints, and letters on a canvas.


Colour = tuple[int, int, int]


def tint(drawn: Image.Image, ink: Colour, paper: Colour | None = (255, 255, 255)) -> Image.Image:
    """Draw a drawing, black on white, in a colour on paper of another, or on none: transparent."""
    if paper is None:
        flat = Image.new("RGBA", drawn.size, (*ink, 255))
        flat.putalpha(ImageOps.invert(drawn))
        return flat
    return ImageOps.colorize(drawn, ink, paper)


def letters(
    c: Canvas,
    text: str,
    at: tuple[float, float],
    height: float,
    font: Path = BOLD,
    ink: int = 0,
    spread: float = 0.0,
) -> None:
    """Draw a line of text about the point `at`: `height` of its em, letters `spread` ems farther apart."""
    face = ImageFont.truetype(str(font), round(height * c.unit))
    gap = spread * height * c.unit
    widths = [face.getlength(letter) + gap for letter in text]
    x = at[0] * c.unit - (sum(widths) - gap) / 2
    if not spread:
        c.draw.text((at[0] * c.unit, at[1] * c.unit), text, font=face, fill=ink, anchor="mm")
        return
    for letter, width in zip(text, widths, strict=True):
        c.draw.text((x, at[1] * c.unit), letter, font=face, fill=ink, anchor="lm")
        x += width


def around(
    c: Canvas, text: str, middle: tuple[float, float], radius: float, height: float, start: float
) -> None:
    """Draw letters along a circle, clockwise from the angle `start` (radians, 0 to the right, y down)."""
    face = ImageFont.truetype(str(BOLD), round(height * c.unit))
    angle = start
    for letter in text:
        width = face.getlength(letter) / c.unit + 0.15 * height
        turn = angle + width / 2 / radius
        x, y = middle[0] + radius * cos(turn), middle[1] + radius * sin(turn)
        side = round(2 * height * c.unit)
        sheet = Image.new("L", (side, side), 0)
        ImageDraw.Draw(sheet).text((side / 2, side / 2), letter, font=face, fill=255, anchor="mm")
        upright = degrees(atan2(sin(turn + pi / 2), cos(turn + pi / 2)))
        sheet = sheet.rotate(-upright, Image.Resampling.BICUBIC)
        c.image.paste(0, (round(x * c.unit) - side // 2, round(y * c.unit) - side // 2), sheet)
        angle += width / radius
