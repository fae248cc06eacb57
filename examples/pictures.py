"""The project's own test pictures: glyphs and drawn silhouettes, black on white.

`python examples/pictures.py FOLDER` writes them all as PNG files.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from math import cos, pi, sin
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont, ImageOps

Point = tuple[float, float]

SIZE = 1024  # px, longer side
OVERSAMPLING = 4
FONT = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
BOLD = FONT.with_name("DejaVuSans-Bold.ttf")
SERIF = FONT.with_name("DejaVuSerif-Bold.ttf")


def pictures() -> dict[str, Image.Image]:
    """Return all pictures by name, in one order: mode "L", black on white, 1024 px on the longer side."""
    glyphs: dict[str, tuple[str, Path]] = {
        "knight": ("♞", FONT),
        "smiley": ("☺", FONT),
        "face": ("☻", FONT),
        "heart": ("♥", FONT),
        "plane": ("✈", FONT),
        "anchor": ("⚓", FONT),
        "notes": ("♫", FONT),
        "ampersand": ("&", SERIF),
        "r": ("R", SERIF),
        "eight": ("8", BOLD),
    }
    drawn: dict[str, Callable[[], Image.Image]] = {
        "cat": _cat,
        "bird": _bird,
        "wheel": _wheel,
        "bicycle": _bicycle,
        "tree": _tree,
        "pieces": _pieces,
        "spiral": _spiral,
        "stickman": _stickman,
        "teapot": _teapot,
    }
    found = {name: _glyph(text, font) for name, (text, font) in glyphs.items()}
    return found | {name: draw() for name, draw in drawn.items()}


def _glyph(text: str, font: Path, margin: float = 0.06) -> Image.Image:
    """Draw one character, cropped to its ink and set in a margin; the aspect is the character's own."""
    em = SIZE * OVERSAMPLING
    sheet = Image.new("L", (2 * em, 2 * em), 0)
    letter = ImageFont.truetype(str(font), em)
    ImageDraw.Draw(sheet).text((em // 2, em // 4), text, font=letter, fill=255)
    ink = ImageOps.invert(sheet.crop(sheet.getbbox()))
    edge = round(margin * SIZE)
    scale = (SIZE - 2 * edge) / max(ink.size)
    ink = ink.resize(
        (round(ink.width * scale), round(ink.height * scale)), Image.Resampling.LANCZOS
    )
    return ImageOps.expand(ink, edge, 255)


class Canvas:
    """A white sheet of `width` x `height` (1: the longer side), y down, in its own units."""

    def __init__(self, width: float = 1.0, height: float = 1.0) -> None:
        self.unit = SIZE * OVERSAMPLING
        self.size = (max(1, round(width * SIZE)), max(1, round(height * SIZE)))
        large = (self.size[0] * OVERSAMPLING, self.size[1] * OVERSAMPLING)
        self.image = Image.new("L", large, 255)
        self.draw = ImageDraw.Draw(self.image)

    def finish(self) -> Image.Image:
        """Return the sheet at its final size, smooth at the edges."""
        return self.image.resize(self.size, Image.Resampling.BOX)

    def disc(self, x: float, y: float, radius: float, y_radius: float = 0.0, ink: int = 0) -> None:
        other = y_radius or radius
        box = [x - radius, y - other, x + radius, y + other]
        self.draw.ellipse([c * self.unit for c in box], fill=ink)

    def ring(self, x: float, y: float, radius: float, width: float) -> None:
        """Draw a circle line whose middle has `radius`."""
        around = [polar(x, y, radius, 2 * pi * k / 200) for k in range(201)]
        self.stroke(around, width)

    def shape(self, outline: Sequence[Point], ink: int = 0) -> None:
        self.draw.polygon([(x * self.unit, y * self.unit) for x, y in outline], fill=ink)

    def blob(self, corners: Sequence[Point], ink: int = 0) -> None:
        """Fill the smooth closed curve through `corners`."""
        self.shape(spline(corners, closed=True), ink)

    def stroke(
        self, line: Sequence[Point], width: float, end_width: float | None = None, ink: int = 0
    ) -> None:
        """Draw a line with round ends and joins; its width may change linearly along it."""
        points = np.array(line)
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(step)]) / step.sum()
        widths = width + ((width if end_width is None else end_width) - width) * along
        for i in range(len(points) - 1):
            self._piece(points[i], points[i + 1], float(widths[i]), float(widths[i + 1]), ink)

    def curve(
        self, corners: Sequence[Point], width: float, end_width: float | None = None, ink: int = 0
    ) -> None:
        """Draw a stroke along the smooth open curve through `corners`."""
        self.stroke(spline(corners, closed=False), width, end_width, ink)

    def _piece(self, a: np.ndarray, b: np.ndarray, start: float, end: float, ink: int) -> None:
        across = np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.hypot(*(b - a))), 1e-12) / 2
        corners = [a + start * across, b + end * across, b - end * across, a - start * across]
        self.shape([(float(x), float(y)) for x, y in corners], ink)
        self.disc(float(a[0]), float(a[1]), start / 2, ink=ink)
        self.disc(float(b[0]), float(b[1]), end / 2, ink=ink)


def spline(corners: Sequence[Point], closed: bool, steps: int = 24) -> list[Point]:
    """Return points of the centripetal Catmull-Rom spline through the corners (Yuksel et al. 2011)."""
    p = np.array(corners, dtype=np.float64)
    if closed:
        p = np.concatenate([p[-1:], p, p[:2]])
    else:
        p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    found = []
    for p0, p1, p2, p3 in zip(p, p[1:], p[2:], p[3:], strict=False):
        t1, t2, t3 = np.cumsum([float(np.hypot(*d)) ** 0.5 for d in (p1 - p0, p2 - p1, p3 - p2)])
        t = np.linspace(t1, t2, steps, endpoint=False)[:, None]
        a1 = (t1 - t) / t1 * p0 + t / t1 * p1
        a2 = (t2 - t) / (t2 - t1) * p1 + (t - t1) / (t2 - t1) * p2
        a3 = (t3 - t) / (t3 - t2) * p2 + (t - t2) / (t3 - t2) * p3
        b1 = (t2 - t) / t2 * a1 + t / t2 * a2
        b2 = (t3 - t) / (t3 - t1) * a2 + (t - t1) / (t3 - t1) * a3
        found.append((t2 - t) / (t2 - t1) * b1 + (t - t1) / (t2 - t1) * b2)
    curve = [(float(x), float(y)) for x, y in np.concatenate(found)]
    return curve if closed else [*curve, (float(p[-2][0]), float(p[-2][1]))]


def polar(x: float, y: float, radius: float, angle: float) -> Point:
    return x + radius * cos(angle), y + radius * sin(angle)


def _cat() -> Image.Image:
    """Draw a sitting cat seen from behind its shoulder: pear body, ears, tail curled to the side."""
    c = Canvas(0.8, 1.0)
    c.blob([
        (0.40, 0.30), (0.50, 0.42), (0.58, 0.58), (0.62, 0.76), (0.58, 0.90), (0.48, 0.935),
        (0.34, 0.935), (0.20, 0.935), (0.13, 0.88), (0.11, 0.74), (0.16, 0.56), (0.24, 0.42),
    ])  # fmt: skip
    c.blob([
        (0.36, 0.145), (0.45, 0.165), (0.515, 0.235), (0.50, 0.335), (0.42, 0.395), (0.30, 0.395),
        (0.215, 0.335), (0.20, 0.235), (0.27, 0.165),
    ])  # fmt: skip
    c.shape([(0.197, 0.27), (0.195, 0.05), (0.335, 0.16)])
    c.shape([(0.518, 0.27), (0.52, 0.05), (0.38, 0.16)])
    c.curve(
        [(0.52, 0.88), (0.63, 0.895), (0.70, 0.83), (0.705, 0.72), (0.655, 0.63), (0.66, 0.545)],
        0.085,
        0.05,
    )
    return c.finish()


def _bird() -> Image.Image:
    """Draw a bird in flight: two raised wings with open feathers, fanned tail, beak."""
    c = Canvas(1.0, 0.78)
    c.blob([
        (0.13, 0.50), (0.19, 0.44), (0.28, 0.44), (0.38, 0.47), (0.52, 0.48), (0.66, 0.515),
        (0.76, 0.545), (0.64, 0.60), (0.48, 0.63), (0.32, 0.615), (0.20, 0.565),
    ])  # fmt: skip
    c.shape([(0.04, 0.53), (0.155, 0.465), (0.17, 0.545)])
    c.shape([
        (0.60, 0.50), (0.76, 0.515), (0.94, 0.465), (0.905, 0.515), (0.965, 0.535), (0.91, 0.565),
        (0.955, 0.605), (0.89, 0.615), (0.91, 0.665), (0.76, 0.60), (0.60, 0.60),
    ])  # fmt: skip
    c.shape([
        (0.34, 0.50), *spline([(0.34, 0.48), (0.40, 0.30), (0.52, 0.14), (0.70, 0.045)], False),
        (0.665, 0.13), (0.725, 0.14), (0.675, 0.215), (0.725, 0.24), (0.665, 0.305),
        (0.70, 0.345), (0.635, 0.39), (0.66, 0.44), (0.60, 0.47), (0.62, 0.53),
    ])  # fmt: skip
    c.shape([
        (0.28, 0.50), *spline([(0.28, 0.46), (0.27, 0.33), (0.21, 0.19), (0.12, 0.07)], False),
        (0.225, 0.09), (0.245, 0.145), (0.305, 0.155), (0.315, 0.21), (0.36, 0.225),
        (0.355, 0.30), (0.37, 0.40), (0.42, 0.52),
    ])  # fmt: skip
    return c.finish()


def _wheel() -> Image.Image:
    """Draw a rim, a hub with a hole, six spokes."""
    c = Canvas()
    c.ring(0.5, 0.5, 0.41, 0.075)
    for k in range(6):
        angle = pi / 2 + k * pi / 3
        c.stroke([polar(0.5, 0.5, 0.1, angle), polar(0.5, 0.5, 0.41, angle)], 0.05)
    c.ring(0.5, 0.5, 0.095, 0.065)
    return c.finish()


def _bicycle() -> Image.Image:
    """Draw two wheels, a diamond frame, saddle, handlebar and crank: thin lines and many holes."""
    c = Canvas(1.0, 0.64)
    rear, front = (0.22, 0.42), (0.78, 0.42)
    crank, seat, head = (0.455, 0.435), (0.385, 0.20), (0.685, 0.17)
    for hub in (rear, front):
        c.ring(*hub, 0.175, 0.028)
        c.disc(*hub, 0.026)
    for a, b in ((rear, crank), (rear, seat), (crank, seat), (crank, head), (seat, head)):
        c.stroke([a, b], 0.024)
    c.stroke([(0.365, 0.135), crank], 0.024)
    c.stroke([(0.66, 0.085), head, front], 0.026)
    c.curve([(0.66, 0.085), (0.72, 0.065), (0.765, 0.085), (0.755, 0.125)], 0.026)
    c.blob(
        [(0.295, 0.115), (0.36, 0.115), (0.43, 0.125), (0.43, 0.145), (0.36, 0.15), (0.30, 0.145)]
    )
    c.ring(*crank, 0.045, 0.02)
    c.stroke([(0.42, 0.525), crank, (0.49, 0.345)], 0.018)
    c.stroke([(0.39, 0.527), (0.45, 0.527)], 0.018)
    return c.finish()


def _tree() -> Image.Image:
    """Draw a bare tree: branches fork into ever thinner twigs."""
    c = Canvas(0.96, 1.0)
    c.shape([
        *spline([(0.36, 0.95), (0.425, 0.90), (0.44, 0.78), (0.445, 0.60)], False),
        *spline([(0.50, 0.60), (0.50, 0.78), (0.515, 0.90), (0.585, 0.95)], False),
    ])  # fmt: skip

    def branch(x: float, y: float, angle: float, length: float, width: float, depth: int) -> None:
        tip = polar(x, y, length, angle)
        bent = polar(x, y, 0.55 * length, angle + 0.12 * (-1) ** depth)
        c.curve([(x, y), bent, tip], width, max(0.7 * width, 0.014))
        for turn, part in ((-0.42, 0.80), (0.38, 0.74)) if depth else ():
            branch(*tip, angle + turn, part * length, max(0.66 * width, 0.016), depth - 1)

    for turn, length in ((-0.95, 0.158), (-0.32, 0.19), (0.28, 0.182), (0.92, 0.162)):
        branch(0.472, 0.62, -pi / 2 + turn, length, 0.05, 3)
    return c.finish()


def _pieces() -> Image.Image:
    """Draw three pieces apart: a moon, a star and a mountain."""
    c = Canvas(1.0, 0.75)
    c.disc(0.25, 0.25, 0.17)
    c.disc(0.325, 0.205, 0.145, ink=255)
    star = [
        polar(0.70, 0.23, 0.165 if k % 2 == 0 else 0.072, -pi / 2 + k * pi / 5) for k in range(10)
    ]
    c.shape(star)
    c.shape([
        (0.06, 0.68), (0.24, 0.50), (0.31, 0.555), (0.47, 0.39), (0.62, 0.535), (0.69, 0.475),
        (0.94, 0.68),
    ])  # fmt: skip
    return c.finish()


def _spiral() -> Image.Image:
    """Draw one stroke that winds outwards three times, with the same gap all the way."""
    c = Canvas()
    angles = np.linspace(0.4 * pi, 6.6 * pi, 500)
    c.stroke([polar(0.5, 0.5, 0.43 * float(a) / (6.6 * pi), float(a)) for a in angles], 0.055)
    return c.finish()


def _stickman() -> Image.Image:
    """Draw a running stick man, one stroke wide throughout."""
    c = Canvas(0.86, 1.0)
    width = 0.06
    neck, hip = (0.475, 0.29), (0.41, 0.56)
    c.disc(0.525, 0.155, 0.095)
    c.stroke([(0.50, 0.22), neck, hip], width)
    c.stroke([neck, (0.63, 0.40), (0.76, 0.30)], width)
    c.stroke([neck, (0.29, 0.335), (0.19, 0.465)], width)
    c.stroke([hip, (0.60, 0.64), (0.56, 0.84), (0.66, 0.86)], width)
    c.stroke([hip, (0.35, 0.75), (0.13, 0.80), (0.10, 0.88)], width)
    return c.finish()


def _teapot() -> Image.Image:
    """Draw a teapot: round body, spout, and a handle that closes a hole."""
    c = Canvas(1.0, 0.72)
    c.blob([
        (0.50, 0.20), (0.63, 0.225), (0.71, 0.33), (0.72, 0.45), (0.66, 0.58), (0.57, 0.635),
        (0.43, 0.635), (0.34, 0.58), (0.28, 0.45), (0.29, 0.33), (0.37, 0.225),
    ])  # fmt: skip
    c.shape([(0.41, 0.60), (0.59, 0.60), (0.62, 0.66), (0.38, 0.66)])
    c.blob([(0.40, 0.215), (0.44, 0.155), (0.50, 0.14), (0.56, 0.155), (0.60, 0.215)])
    c.disc(0.50, 0.105, 0.04)
    c.shape([
        *spline([(0.66, 0.52), (0.78, 0.47), (0.835, 0.34), (0.93, 0.225)], False),
        *spline([(0.865, 0.195), (0.775, 0.265), (0.74, 0.34), (0.68, 0.36)], False),
    ])  # fmt: skip
    c.curve(
        [(0.34, 0.27), (0.21, 0.21), (0.10, 0.27), (0.12, 0.41), (0.21, 0.50), (0.33, 0.53)], 0.06
    )
    return c.finish()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/pictures.py FOLDER")
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, image in pictures().items():
        image.save(folder / f"{name}.png", optimize=True)
        print(folder / f"{name}.png")
