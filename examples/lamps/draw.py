"""Draw the six pictures in colours for lamps: `python -m examples.lamps.draw [FOLDER]`.

Two have black outlines, one is a word in three colours, and one has soft colours that no lamps mix.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

SIDE, FINER = 720, 4
INK = "black"
Spots = list[tuple[float, float]]


class Sheet:
    """A square of white paper, its sides from 0 to 100, drawn on finer pixels."""

    def __init__(self, outline: float = 0.0) -> None:
        self.scale = SIDE * FINER / 100
        self.image = Image.new("RGB", (SIDE * FINER,) * 2, "white")
        self.pen = ImageDraw.Draw(self.image)
        self.outline = outline

    def area(self, spots: Spots, colour: str) -> None:
        """Draw a polygon, with the sheet's outline."""
        points = [(x * self.scale, y * self.scale) for x, y in spots]
        self.pen.polygon(points, fill=colour)
        if self.outline:
            wide = round(self.outline * self.scale)
            self.pen.line([*points, *points[:2]], fill=INK, width=wide, joint="curve")

    def disc(self, x: float, y: float, across: float, up: float, colour: str) -> None:
        """Draw an ellipse about a place, so far to each side."""
        self.area(arc(x, y, across, up, 0, 360), colour)

    def line(self, spots: Spots, wide: float, colour: str = INK) -> None:
        """Draw a line with round ends."""
        points = [(x * self.scale, y * self.scale) for x, y in spots]
        self.pen.line(points, fill=colour, width=round(wide * self.scale), joint="curve")
        half = 0.5 * wide * self.scale
        for x, y in (points[0], points[-1]):
            self.pen.ellipse([x - half, y - half, x + half, y + half], fill=colour)

    def done(self) -> Image.Image:
        """Return the picture, antialiased."""
        return self.image.resize((SIDE, SIDE), Image.Resampling.LANCZOS)


def arc(x: float, y: float, across: float, up: float, start: float, end: float) -> Spots:
    """Return places on an ellipse from one angle to another, degrees clockwise from the right."""
    count = max(8, round(abs(end - start) / 3))
    turns = [math.radians(start + (end - start) * k / count) for k in range(count + 1)]
    return [(x + across * math.cos(t), y + up * math.sin(t)) for t in turns]


def parrot(outline: float) -> Image.Image:
    """Draw a parrot in eight colours."""
    sheet = Sheet(outline)
    sheet.area([(40, 66), (55, 66), (47, 94), (33, 94)], "#0000ff")
    sheet.disc(46, 54, 21, 26, "#ff0000")
    sheet.area(arc(52, 58, 13, 19, 0, 360), "#00ff00")
    sheet.disc(55, 26, 19, 18, "#ffff00")
    sheet.area([(71, 19), (90, 31), (72, 36)], "#ff00ff")
    sheet.area(arc(46, 12, 7, 6, 150, 400), "#00ffff")
    sheet.disc(59, 24, 6.5, 6.5, "white")
    sheet.disc(60, 24, 3, 3, INK)
    return sheet.done()


def balloon() -> Image.Image:
    """Draw a balloon with gores, its basket below."""
    sheet = Sheet(2.2)
    colours = ("#ff0000", "#ffff00", "#00ff00", "#00ffff", "#0000ff")
    edges = [-34, -21, -7, 7, 21, 34]
    for left, right, colour in zip(edges, edges[1:], colours, strict=False):
        side = [
            [
                (50 + e * math.sin(math.radians(t)), 40 - 34 * math.cos(math.radians(t)))
                for t in range(0, 151, 5)
            ]
            for e in (left, right)
        ]
        sheet.area([*side[0], *reversed(side[1])], colour)
    sheet.line([(36, 70), (43, 84)], 1.8)
    sheet.line([(64, 70), (57, 84)], 1.8)
    sheet.area([(41, 83), (59, 83), (57, 95), (43, 95)], "#ff00ff")
    return sheet.done()


def fish() -> Image.Image:
    """Draw a fish in stripes, without outlines."""
    sheet = Sheet()
    sheet.area([(62, 50), (93, 27), (88, 50), (93, 73)], "#ff00ff")
    sheet.area([(32, 26), (50, 10), (64, 30)], "#00ff00")
    sheet.area([(34, 74), (48, 89), (62, 70)], "#00ff00")
    sheet.disc(43, 50, 34, 27, "#ffff00")
    for x, wide in ((33, 8), (55, 8)):
        high = 26.5 * math.sqrt(1 - ((x - 43) / 34) ** 2)
        sheet.area(
            [
                (x - wide / 2, 50 - high),
                (x + wide / 2, 50 - high),
                (x + wide / 2, 50 + high),
                (x - wide / 2, 50 + high),
            ],
            "#0000ff",
        )
    sheet.disc(21, 44, 5, 5, INK)
    return sheet.done()


def word() -> Image.Image:
    """Draw a word, its letters in three colours."""
    from matplotlib import font_manager

    sheet = Sheet()
    file = font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans", weight="bold"))
    font = ImageFont.truetype(file, round(31 * sheet.scale))
    text, colours = "KNOT", ("#ff0000", "#00ff00", "#0000ff", "#ff0000")
    widths = [font.getlength(sign) for sign in text]
    x = 0.5 * (SIDE * FINER - sum(widths))
    for sign, colour, width in zip(text, colours, widths, strict=True):
        sheet.pen.text((x, 50 * sheet.scale), sign, fill=colour, font=font, anchor="lm")
        x += width
    return sheet.done().crop((0, SIDE // 4, SIDE, 3 * SIDE // 4))


def flower() -> Image.Image:
    """Draw a flower in colours that lamps cannot mix: they are drawn in the nearest ones."""
    sheet = Sheet()
    sheet.line([(50, 60), (52, 96)], 5, "#2e8b57")
    sheet.area([*arc(64, 82, 13, 6, 0, 360)], "#3cb371")
    for k in range(6):
        turn = math.radians(60 * k)
        x, y = 50 + 20 * math.cos(turn), 38 + 20 * math.sin(turn)
        sheet.disc(x, y, 11.5, 11.5, ("#e63946", "#ff7f50")[k % 2])
    sheet.disc(50, 38, 11, 11, "#ffd43b")
    return sheet.done()


PICTURES: dict[str, Callable[[], Image.Image]] = {
    "parrot-outlined": lambda: parrot(2.4),
    "parrot": lambda: parrot(0.0),
    "balloon": balloon,
    "fish": fish,
    "word": word,
    "flower": flower,
}


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        draw().save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
