"""Line drawings, as felt pens and fine pens draw them."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from PIL import Image

from benchmarks.brought.photos import around, letters, tint
from examples.pictures import SERIF, Canvas, polar


def house() -> Image.Image:
    """Draw a child's house: walls, roof, door, window with a cross, smoke."""
    c, w = Canvas(0.92, 1.0), 0.032
    c.stroke([(0.14, 0.46), (0.14, 0.92), (0.78, 0.92), (0.78, 0.46)], w)
    c.stroke([(0.06, 0.50), (0.46, 0.14), (0.86, 0.50)], w)
    c.stroke([(0.24, 0.92), (0.24, 0.62), (0.40, 0.62), (0.40, 0.92)], w)
    c.stroke([(0.50, 0.58), (0.68, 0.58), (0.68, 0.76), (0.50, 0.76), (0.50, 0.58)], w)
    c.stroke([(0.59, 0.58), (0.59, 0.76)], 0.024)
    c.stroke([(0.50, 0.67), (0.68, 0.67)], 0.024)
    c.stroke([(0.62, 0.26), (0.62, 0.12), (0.72, 0.12), (0.72, 0.35)], w)
    c.curve([(0.68, 0.08), (0.74, 0.03), (0.80, 0.06), (0.86, 0.02)], 0.026)
    return c.finish()


def cat() -> Image.Image:
    """Draw a cat's face: round, two ears, eyes, a nose and whiskers."""
    c, w = Canvas(1.0, 0.9), 0.03
    around = [(0.5 + 0.33 * cos(t), 0.52 + 0.31 * sin(t)) for t in _turn()]
    c.stroke(around, w)
    c.stroke([(0.215, 0.36), (0.20, 0.07), (0.40, 0.225)], w)
    c.stroke([(0.785, 0.36), (0.80, 0.07), (0.60, 0.225)], w)
    c.disc(0.38, 0.45, 0.036, 0.055)
    c.disc(0.62, 0.45, 0.036, 0.055)
    c.shape([(0.455, 0.58), (0.545, 0.58), (0.5, 0.63)])
    c.curve([(0.5, 0.62), (0.485, 0.69), (0.42, 0.70), (0.385, 0.67)], 0.022)
    c.curve([(0.5, 0.62), (0.515, 0.69), (0.58, 0.70), (0.615, 0.67)], 0.022)
    for side in (-1, 1):
        for rise in (-0.05, 0.03):
            c.stroke([(0.5 + side * 0.21, 0.615), (0.5 + side * 0.46, 0.62 + rise)], 0.02)
    return c.finish()


def _turn() -> list[float]:
    return [2 * pi * k / 120 for k in range(121)]


def boat() -> Image.Image:
    """Draw a sailing boat on two waves, one line throughout."""
    c, w = Canvas(1.0, 1.0), 0.026
    c.stroke([(0.16, 0.70), (0.86, 0.70), (0.74, 0.85), (0.28, 0.85), (0.16, 0.70)], w)
    c.stroke([(0.48, 0.70), (0.48, 0.06)], w)
    c.curve([(0.48, 0.08), (0.66, 0.28), (0.79, 0.60)], w)
    c.stroke([(0.79, 0.60), (0.48, 0.62)], w)
    c.curve([(0.48, 0.14), (0.36, 0.36), (0.24, 0.60)], w)
    c.stroke([(0.24, 0.60), (0.48, 0.62)], w)
    c.curve([(0.06, 0.93), (0.18, 0.90), (0.30, 0.95), (0.44, 0.91), (0.58, 0.95), (0.72, 0.91),
             (0.84, 0.95), (0.94, 0.92)], 0.024)  # fmt: skip
    return c.finish()


def fine() -> Image.Image:
    """Draw a flower with veins and hatching, by a fine pen: lines of 4 px."""
    c, w = Canvas(0.86, 1.0), 0.004
    for k in range(9):
        turn = 2 * pi * k / 9
        tip = polar(0.43, 0.36, 0.30, turn)
        sides = [polar(0.43, 0.36, 0.2, turn + s * 0.3) for s in (-1, 1)]
        root = polar(0.43, 0.36, 0.07, turn)
        c.curve([root, sides[0], tip], w)
        c.curve([root, sides[1], tip], w)
        for s in (0.4, 0.6, 0.8):
            c.stroke(
                [polar(0.43, 0.36, 0.3 * s, turn), polar(0.43, 0.36, 0.3 * s + 0.04, turn + 0.1)], w
            )
    c.ring(0.43, 0.36, 0.065, w)
    for k in range(7):
        c.stroke([(0.385 + 0.015 * k, 0.33), (0.385 + 0.015 * k, 0.39)], w)
    c.curve([(0.43, 0.66), (0.46, 0.80), (0.42, 0.96)], w)
    c.curve([(0.45, 0.80), (0.56, 0.70), (0.68, 0.72)], w)
    c.curve([(0.45, 0.80), (0.58, 0.82), (0.68, 0.72)], w)
    return c.finish()


# Logos and badges: bold shapes, some with letters that are too small.


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


# Maps: an island with a lake, metro lines, streets, and more islands than can be drawn.


def _coast(
    x: float, y: float, radius: float, seed: int, rough: float = 0.16
) -> list[tuple[float, float]]:
    """Draw a closed coast about a point: a circle with six harmonics of chance."""
    rng = np.random.default_rng(seed)
    waves = [(k, rng.normal() * rough / k, rng.uniform(0, 2 * pi)) for k in range(2, 8)]
    found = []
    for t in np.linspace(0, 2 * pi, 240, endpoint=False):
        r = radius * (1 + sum(a * cos(k * t + p) for k, a, p in waves))
        found.append((x + r * cos(t), y + r * sin(t)))
    return found


def island() -> Image.Image:
    """Draw an island with a lake, two bays and three smaller islands off its coast."""
    c = Canvas(1.0, 0.86)
    c.shape(_coast(0.44, 0.42, 0.31, 3, 0.22))
    c.shape(_coast(0.47, 0.37, 0.075, 5), 255)
    c.shape(_coast(0.86, 0.62, 0.075, 9))
    c.shape(_coast(0.90, 0.27, 0.05, 11))
    c.shape(_coast(0.68, 0.80, 0.04, 13))
    return tint(c.finish(), (90, 110, 60), (226, 238, 246))


def metro() -> Image.Image:
    """Draw three metro lines with rings for stations where they cross."""
    c, w = Canvas(1.0, 0.8), 0.034
    c.stroke([(0.06, 0.20), (0.30, 0.20), (0.62, 0.52), (0.94, 0.52)], w)
    c.stroke([(0.06, 0.62), (0.34, 0.62), (0.62, 0.34), (0.80, 0.16), (0.94, 0.16)], w)
    c.stroke([(0.22, 0.06), (0.22, 0.44), (0.46, 0.70), (0.80, 0.70), (0.94, 0.70)], w)
    for x, y in ((0.22, 0.20), (0.53, 0.43), (0.37, 0.605)):
        c.disc(x, y, 0.05)
        c.disc(x, y, 0.026, ink=255)
    for x, y in (
        (0.06, 0.20),
        (0.94, 0.52),
        (0.06, 0.62),
        (0.94, 0.16),
        (0.22, 0.06),
        (0.94, 0.70),
    ):
        c.disc(x, y, 0.034)
    return tint(c.finish(), (30, 40, 60))


def streets() -> Image.Image:
    """Draw city blocks between streets, with an avenue, a square and a roundabout."""
    c = Canvas(1.0, 0.9)
    c.shape([(0.03, 0.03), (0.97, 0.03), (0.97, 0.87), (0.03, 0.87)])
    for x in (0.22, 0.42, 0.63, 0.81):
        c.stroke([(x, 0.0), (x + 0.03, 0.9)], 0.026, ink=255)
    for y in (0.24, 0.46, 0.67):
        c.stroke([(0.0, y), (1.0, y - 0.03)], 0.026, ink=255)
    c.stroke([(0.0, 0.80), (1.0, 0.08)], 0.042, ink=255)
    c.disc(0.533, 0.417, 0.085, ink=255)
    c.disc(0.533, 0.417, 0.042)
    return tint(c.finish(), (120, 116, 108))


def archipelago() -> Image.Image:
    """Draw four islands and some sixty skerries, most of them smaller than a tube is wide."""
    c = Canvas(1.0, 0.9)
    for k, (x, y, r) in enumerate(
        ((0.30, 0.30, 0.16), (0.66, 0.24, 0.1), (0.62, 0.64, 0.15), (0.24, 0.72, 0.08))
    ):
        c.shape(_coast(x, y, r, 20 + k, 0.2))
    rng = np.random.default_rng(8)
    for k in range(64):
        x, y = rng.uniform(0.04, 0.96), rng.uniform(0.04, 0.86)
        c.shape(_coast(x, y, float(rng.choice([0.004, 0.005, 0.006, 0.008])), 50 + k))
    return tint(c.finish(), (70, 90, 70), (230, 238, 240))
