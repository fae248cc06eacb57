"""What is written: signatures, QR codes, and text of several sizes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from PIL import Image

from benchmarks.brought.photos import letters, tint
from examples.pictures import FONT, SERIF, Canvas, spline

_PAGE = (
    "A knot is a closed curve in space that",
    "does not meet itself. Two knots are the",
    "same where one can be moved into the",
    "other without a cut. The shadow of a",
    "knot is a closed curve in the plane,",
    "which crosses itself where one strand",
    "runs above another. From many sides it",
    "looks like a heap of wire; from one it",
    "may look like anything at all.",
)
QUIET = 2  # modules of white about a QR code


def marker() -> Image.Image:
    """Draw a signature by a broad marker: a first letter with a loop, waves, and a line under it."""
    c, w = Canvas(1.0, 0.56), 0.03
    c.curve([(0.10, 0.40), (0.16, 0.20), (0.22, 0.07), (0.26, 0.13), (0.22, 0.30), (0.20, 0.43)], w)
    c.curve([(0.13, 0.29), (0.24, 0.245), (0.33, 0.25)], w)
    c.curve([
        (0.33, 0.25), (0.345, 0.36), (0.39, 0.38), (0.43, 0.27), (0.455, 0.36), (0.50, 0.38), (0.53, 0.27),
        (0.555, 0.37), (0.60, 0.36), (0.655, 0.19), (0.68, 0.07), (0.645, 0.10), (0.645, 0.31), (0.685, 0.38),
        (0.75, 0.32), (0.79, 0.29), (0.82, 0.36), (0.92, 0.33),
    ], w)  # fmt: skip
    c.curve([(0.14, 0.50), (0.45, 0.475), (0.88, 0.47)], w, 0.02)
    return tint(c.finish(), (20, 30, 110))


def initials() -> Image.Image:
    """Draw two initials in one flourish, by a brush."""
    c = Canvas(0.94, 0.80)
    c.curve([(0.12, 0.68), (0.20, 0.36), (0.30, 0.10), (0.36, 0.36), (0.44, 0.66)], 0.03, 0.045)
    c.curve([(0.17, 0.47), (0.28, 0.43), (0.40, 0.46)], 0.028)
    c.curve([
        (0.53, 0.67), (0.55, 0.40), (0.575, 0.12), (0.70, 0.10), (0.755, 0.22), (0.68, 0.34), (0.57, 0.36),
        (0.70, 0.38), (0.80, 0.50), (0.73, 0.65), (0.53, 0.67),
    ], 0.036)  # fmt: skip
    c.curve([(0.80, 0.62), (0.88, 0.70), (0.60, 0.755), (0.06, 0.745)], 0.03, 0.02)
    return tint(c.finish(), (10, 10, 10), (250, 249, 244))


def pen() -> Image.Image:
    """Draw a signature by a pen: hairlines upwards, swells downwards."""
    c = Canvas(1.0, 0.5)
    line = spline([
        (0.05, 0.36), (0.12, 0.14), (0.18, 0.06), (0.17, 0.20), (0.14, 0.40), (0.21, 0.28), (0.26, 0.24),
        (0.255, 0.34), (0.30, 0.33), (0.345, 0.24), (0.345, 0.34), (0.40, 0.32), (0.44, 0.24), (0.44, 0.34),
        (0.49, 0.32), (0.56, 0.10), (0.555, 0.06), (0.53, 0.20), (0.535, 0.34), (0.60, 0.30), (0.645, 0.24),
        (0.645, 0.34), (0.70, 0.31), (0.74, 0.25), (0.75, 0.34), (0.84, 0.30), (0.95, 0.22),
    ], False)  # fmt: skip
    points = np.array(line)
    for a, b in pairwise(points):
        down = max(0.0, float(b[1] - a[1]) / max(float(np.hypot(*(b - a))), 1e-9))
        c.stroke([tuple(a), tuple(b)], 0.005 + 0.011 * down)
    return tint(c.finish(), (20, 20, 70))


def qr(content: str, version: int) -> Image.Image:
    """Draw a QR code, error correction M, with two modules of white about it."""
    import segno

    code = segno.make(content, version=version, error="m", micro=False)
    modules = np.array([[not bit for bit in row] for row in code.matrix])
    sheet = np.pad(modules, QUIET, constant_values=True)
    side = max(1, 1024 // len(sheet))
    grey = np.where(np.kron(sheet, np.ones((side, side), dtype=bool)), 255, 0)
    return Image.fromarray(grey.astype(np.uint8))


def large_word() -> Image.Image:
    """Draw one bold word across the sheet."""
    c = Canvas(1.0, 0.36)
    letters(c, "knots", (0.5, 0.17), 0.31)
    return c.finish()


def two_lines() -> Image.Image:
    """Draw two lines in a bold serif."""
    c = Canvas(1.0, 0.62)
    letters(c, "Good", (0.5, 0.17), 0.25, SERIF, spread=0.03)
    letters(c, "morning", (0.5, 0.44), 0.185, SERIF, spread=0.03)
    return tint(c.finish(), (60, 20, 20), (255, 250, 240))


def card() -> Image.Image:
    """Draw a visiting card: a large name, and three small lines under it."""
    c = Canvas(1.0, 0.6)
    letters(c, "Ada Byron", (0.5, 0.16), 0.155)
    c.stroke([(0.08, 0.29), (0.92, 0.29)], 0.018)
    for k, line in enumerate(
        ("mathematics and engines", "12 St James's Square, London", "ada@example.org")
    ):
        letters(c, line, (0.5, 0.37 + 0.075 * k), 0.05, FONT)
    return tint(c.finish(), (30, 30, 30))


def page() -> Image.Image:
    """Draw a paragraph of nine lines, as a photograph of a page has."""
    c = Canvas(1.0, 0.8)
    for k, line in enumerate(_PAGE):
        letters(c, line, (0.5, 0.08 + 0.08 * k), 0.044, SERIF if k == 0 else FONT)
    return tint(c.finish(), (40, 40, 40), (250, 246, 236))
