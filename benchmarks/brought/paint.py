"""What the pictures are painted with: tints, and letters on a canvas."""

from __future__ import annotations

from math import atan2, cos, degrees, pi, sin
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont, ImageOps

from examples.pictures import BOLD, Canvas

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
