"""Line drawings, as felt pens and fine pens draw them."""

from __future__ import annotations

from math import cos, pi, sin

from PIL import Image

from examples.pictures import Canvas, polar


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
