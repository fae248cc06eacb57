"""Maps: an island with a lake, metro lines, streets, and more islands than can be drawn."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
from PIL import Image

from benchmarks.brought.paint import tint
from examples.pictures import Canvas


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
