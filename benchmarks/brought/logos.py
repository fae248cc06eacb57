"""Logos and badges: bold shapes, some with letters that are too small."""

from __future__ import annotations

from math import pi

from PIL import Image

from benchmarks.brought.paint import around, letters, tint
from examples.pictures import SERIF, Canvas, polar


def peak() -> Image.Image:
    """Draw two peaks with snow and a sun, blue."""
    c = Canvas(1.0, 0.8)
    c.disc(0.72, 0.20, 0.11)
    c.shape([(0.04, 0.74), (0.36, 0.16), (0.52, 0.45), (0.61, 0.33), (0.96, 0.74)])
    c.shape(
        [(0.36, 0.26), (0.30, 0.37), (0.335, 0.40), (0.37, 0.36), (0.41, 0.40), (0.425, 0.38)], 255
    )
    return tint(c.finish(), (24, 66, 140))


def leaf() -> Image.Image:
    """Draw a leaf with a vein cut out, green on transparent."""
    c = Canvas(0.9, 1.0)
    c.blob([
        (0.80, 0.08), (0.84, 0.30), (0.78, 0.56), (0.60, 0.76), (0.36, 0.80), (0.18, 0.68),
        (0.14, 0.48), (0.28, 0.28), (0.54, 0.16),
    ])  # fmt: skip
    c.curve([(0.74, 0.16), (0.56, 0.36), (0.38, 0.58), (0.29, 0.70)], 0.02, 0.034, 255)
    c.curve([(0.56, 0.36), (0.58, 0.48), (0.57, 0.58)], 0.022, 0.022, 255)
    c.curve([(0.47, 0.47), (0.40, 0.42), (0.34, 0.40)], 0.022, 0.022, 255)
    c.curve([(0.285, 0.70), (0.20, 0.82), (0.13, 0.93)], 0.036, 0.05)
    return tint(c.finish(), (34, 120, 60), None)


def mug() -> Image.Image:
    """Draw a coffee mug with three curls of steam."""
    c = Canvas(1.0, 1.0)
    c.shape([(0.18, 0.42), (0.68, 0.42), (0.64, 0.86), (0.22, 0.86)])
    c.curve([(0.66, 0.48), (0.82, 0.48), (0.85, 0.62), (0.76, 0.73), (0.64, 0.74)], 0.055)
    c.shape([(0.10, 0.90), (0.76, 0.90), (0.70, 0.95), (0.16, 0.95)])
    for x in (0.28, 0.43, 0.58):
        c.curve([(x, 0.36), (x - 0.035, 0.28), (x + 0.035, 0.18), (x, 0.08)], 0.036)
    return tint(c.finish(), (92, 52, 28), (246, 238, 224))


def word() -> Image.Image:
    """Draw a compass rose over a bold word."""
    c = Canvas(1.0, 0.86)
    _compass(c, 0.5, 0.29, 0.25)
    letters(c, "NORTH", (0.5, 0.72), 0.225, spread=0.06)
    return tint(c.finish(), (20, 20, 20))


def subtitle() -> Image.Image:
    """Return the same with a line of small letters under it, as stationery has."""
    c = Canvas(1.0, 0.94)
    _compass(c, 0.5, 0.29, 0.25)
    letters(c, "NORTH", (0.5, 0.70), 0.21, spread=0.08)
    letters(c, "outdoor equipment since 1987", (0.5, 0.87), 0.046, spread=0.05)
    return tint(c.finish(), (20, 20, 20))


def _compass(c: Canvas, x: float, y: float, radius: float) -> None:
    for k in range(8):
        long = radius if k % 2 == 0 else 0.62 * radius
        turn = k * pi / 4
        c.shape([
            polar(x, y, long, turn), polar(x, y, 0.3 * radius, turn + pi / 8), (x, y),
            polar(x, y, 0.3 * radius, turn - pi / 8),
        ])  # fmt: skip
    c.disc(x, y, 0.1 * radius, ink=255)


def tick() -> Image.Image:
    """Draw a red disc with a white tick, on transparent: both are opaque."""
    c = Canvas()
    c.disc(0.5, 0.5, 0.44)
    badge = tint(c.finish(), (200, 30, 40), None)
    c = Canvas()
    c.stroke([(0.29, 0.52), (0.44, 0.67), (0.72, 0.35)], 0.1)
    badge.alpha_composite(tint(c.finish(), (255, 255, 255), None))
    return badge


def star() -> Image.Image:
    """Draw a sheriff's star: round tips, a ring cut out of it and a star inside."""
    c = Canvas()
    tips = [polar(0.5, 0.52, 0.40, -pi / 2 + k * pi / 3) for k in range(6)]
    inner = [polar(0.5, 0.52, 0.25, -pi / 3 + k * pi / 3) for k in range(6)]
    c.shape([p for pair in zip(tips, inner, strict=True) for p in pair])
    for tip in tips:
        c.disc(*tip, 0.055)
    c.disc(0.5, 0.52, 0.19, ink=255)
    c.shape([
        polar(0.5, 0.52, 0.145 if k % 2 == 0 else 0.06, -pi / 2 + k * pi / 5) for k in range(10)
    ])  # fmt: skip
    return tint(c.finish(), (160, 120, 20), (250, 250, 250))


def rosette() -> Image.Image:
    """Draw a prize rosette with ribbons and a 1 in it, blue and white."""
    c = Canvas(0.76, 1.0)
    c.shape([(0.26, 0.52), (0.14, 0.95), (0.25, 0.90), (0.33, 0.97), (0.41, 0.56)])
    c.shape([(0.50, 0.52), (0.62, 0.95), (0.51, 0.90), (0.43, 0.97), (0.35, 0.56)])
    c.shape([
        polar(0.38, 0.37, 0.325 if k % 2 == 0 else 0.275, k * pi / 16) for k in range(32)
    ])  # fmt: skip
    c.disc(0.38, 0.37, 0.215, ink=255)
    letters(c, "1", (0.375, 0.375), 0.34, SERIF)
    return tint(c.finish(), (30, 60, 150))


def seal() -> Image.Image:
    """Draw a round seal: an anchor-like cross in the middle, small letters around it between two rings."""
    c = Canvas()
    c.ring(0.5, 0.5, 0.455, 0.03)
    c.ring(0.5, 0.5, 0.325, 0.02)
    around(c, "CITY OF NORTHAVEN * HARBOUR OFFICE * ", (0.5, 0.5), 0.388, 0.075, -pi)
    c.stroke([(0.5, 0.30), (0.5, 0.70)], 0.05)
    c.stroke([(0.40, 0.38), (0.60, 0.38)], 0.045)
    c.curve([(0.33, 0.56), (0.39, 0.66), (0.5, 0.70), (0.61, 0.66), (0.67, 0.56)], 0.045)
    return tint(c.finish(), (110, 20, 30), (252, 248, 240))
