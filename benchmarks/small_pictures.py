"""Pictures whose small parts are what people look at first, such as eyes and letters; drawings of lines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import pi

from PIL import Image, ImageDraw, ImageFont

from examples.pictures import BOLD, Canvas, Point, polar


def small_pictures() -> dict[str, Image.Image]:
    """Return all of them by name: mode "L", black on white, 1024 px on the longer side."""
    drawn: dict[str, Callable[[], Image.Image]] = {
        "owl": _owl,
        "otter": _otter,
        "whiskers": _whiskers,
        "alps": _alps,
        "ship": _ship,
        "crown": _crown,
        "snowflake": _snowflake,
    }
    return {name: draw() for name, draw in drawn.items()}


def line_pictures(names: Iterable[str]) -> dict[str, Image.Image]:
    """Draw the lines that are among `names`: a drawing and how many of the thinnest tubes wide its line is.

    "brow5": the profile with the brow, five tubes of 1.6 mm wide at the usual 180 mm.
    """
    drawn = {}
    for name in names:
        which = name.rstrip("0123456789.")
        if which in _LINES:
            c = Canvas()
            c.curve(_LINES[which], float(name.removeprefix(which)) * _TUBE)
            drawn[name] = c.finish()
    return drawn


def _profile(brow: float, nose: float, chin: float) -> list[Point]:
    """Place the corners of a face in profile; brow, nose and chin stand out by so much more."""
    return [
        (0.32, 0.95), (0.33, 0.78), (0.22, 0.62), (0.19, 0.42), (0.25, 0.20), (0.46, 0.09),
        (0.64 + brow, 0.13), (0.70 + brow, 0.26), (0.70, 0.35), (0.78 + nose, 0.49), (0.71, 0.53),
        (0.73, 0.59), (0.70, 0.63), (0.72, 0.68), (0.68 + chin, 0.77), (0.57, 0.78), (0.55, 0.86),
        (0.56, 0.95),
    ]  # fmt: skip


# the shadow of the thinnest tube, 1.92 mm, as a share of the sheet: 0.93 of that are 180 mm
_TUBE = 1.92 / 180 * 0.93
_LINES = {
    "brow": _profile(0.03, 0.0, 0.0),
    "nose": _profile(0.0, 0.06, 0.03),
    "chin": _profile(-0.02, -0.03, 0.05),
    "puss": [
        (0.30, 0.93), (0.19, 0.86), (0.17, 0.59), (0.24, 0.37), (0.21, 0.15), (0.37, 0.25),
        (0.51, 0.23), (0.64, 0.25), (0.78, 0.15), (0.76, 0.37), (0.82, 0.59), (0.78, 0.86),
        (0.65, 0.93),
    ],
}  # fmt: skip


def _owl() -> Image.Image:
    """Draw an owl from the front: ears, two ringed eyes with pupils, a beak, feet."""
    c = Canvas(0.74, 1.0)
    c.blob([
        (0.37, 0.13), (0.55, 0.20), (0.62, 0.40), (0.64, 0.62), (0.56, 0.82), (0.37, 0.90),
        (0.18, 0.82), (0.10, 0.62), (0.12, 0.40), (0.19, 0.20),
    ])  # fmt: skip
    for side in (-1, 1):
        c.shape([(0.37 + side * x, y) for x, y in ((0.05, 0.16), (0.235, 0.05), (0.22, 0.30))])
        c.disc(0.37 + side * 0.115, 0.32, 0.085, ink=255)
        c.disc(0.37 + side * 0.115, 0.32, 0.042)
        c.disc(0.37 + side * 0.10, 0.905, 0.05, 0.035)
    c.shape([(0.345, 0.42), (0.395, 0.42), (0.37, 0.50)], ink=255)
    return c.finish()


def _otter() -> Image.Image:
    """Draw an otter that stands upright: round head with two eyes and a nose, arms, a thick tail."""
    c = Canvas(0.62, 1.0)
    c.blob([
        (0.26, 0.28), (0.36, 0.34), (0.41, 0.52), (0.43, 0.72), (0.40, 0.88), (0.28, 0.93),
        (0.14, 0.91), (0.10, 0.72), (0.12, 0.52), (0.17, 0.34),
    ])  # fmt: skip
    c.disc(0.26, 0.20, 0.135, 0.125)
    for side in (-1, 1):
        c.disc(0.26 + side * 0.125, 0.12, 0.04)
        c.disc(0.26 + side * 0.055, 0.175, 0.022, ink=255)
    c.disc(0.26, 0.235, 0.026, 0.018, ink=255)
    c.curve([(0.36, 0.86), (0.48, 0.90), (0.57, 0.80)], 0.10, 0.05)
    c.curve([(0.14, 0.45), (0.07, 0.54), (0.06, 0.62)], 0.05)
    return c.finish()


def _whiskers() -> Image.Image:
    """Draw a cat's head from the front: eyes, nose, and three whiskers to each side."""
    c = Canvas(1.0, 0.82)
    c.disc(0.5, 0.47, 0.27, 0.26)
    for side in (-1, 1):
        c.shape([(0.5 + side * x, y) for x, y in ((0.26, 0.42), (0.25, 0.06), (0.05, 0.23))])
        c.disc(0.5 + side * 0.105, 0.40, 0.042, 0.052, ink=255)
        for turn in (-0.26, 0.0, 0.26):
            far = polar(0.5 + side * 0.1, 0.53, 0.36, turn if side > 0 else pi - turn)
            c.stroke([(0.5 + side * 0.1, 0.53), far], 0.028)
    c.shape([(0.455, 0.51), (0.545, 0.51), (0.5, 0.565)], ink=255)
    return c.finish()


def _alps() -> Image.Image:
    """Draw two peaks with the sun beside them, and the word ALPS beneath."""
    c = Canvas(1.0, 0.86)
    c.shape([(0.05, 0.56), (0.33, 0.10), (0.47, 0.34), (0.60, 0.20), (0.95, 0.56)])
    c.disc(0.80, 0.16, 0.065)
    font = ImageFont.truetype(str(BOLD), round(0.27 * c.unit))
    place = (0.5 * c.unit, 0.72 * c.unit)
    ImageDraw.Draw(c.image).text(place, "ALPS", font=font, fill=0, anchor="mm")
    return c.finish()


def _ship() -> Image.Image:
    """Draw a ship: hull with portholes, two sails, and a mast whose top carries a flag."""
    c = Canvas(0.86, 1.0)
    c.shape([(0.06, 0.74), (0.80, 0.74), (0.70, 0.92), (0.17, 0.92)])
    for k in range(3):
        c.disc(0.30 + 0.14 * k, 0.82, 0.026, ink=255)
    c.stroke([(0.43, 0.76), (0.43, 0.05)], 0.026)
    c.shape([(0.43, 0.05), (0.60, 0.095), (0.43, 0.15)])
    c.shape([(0.47, 0.22), (0.76, 0.67), (0.47, 0.67)])
    c.shape([(0.39, 0.30), (0.39, 0.67), (0.12, 0.67)])
    return c.finish()


def _crown() -> Image.Image:
    """Draw a crown: five prongs with a ball on each, and a band with three jewels cut out."""
    c = Canvas(1.0, 0.78)
    tips = [(0.07, 0.26), (0.29, 0.15), (0.5, 0.11), (0.71, 0.15), (0.93, 0.26)]
    valleys = [(0.27, 0.48), (0.41, 0.44), (0.59, 0.44), (0.73, 0.48)]
    edge = [p for pair in zip(tips, [*valleys, (0.86, 0.70)], strict=True) for p in pair]
    c.shape([*edge, (0.14, 0.70)])
    for x, y in tips:
        c.disc(x, y - 0.02, 0.036)
    for x in (0.32, 0.5, 0.68):
        c.disc(x, 0.61, 0.03, ink=255)
    return c.finish()


def _snowflake() -> Image.Image:
    """Draw a snowflake: six arms, each with two pairs of twigs, about a ring."""
    c = Canvas()
    c.ring(0.5, 0.5, 0.085, 0.05)
    for k in range(6):
        angle = pi / 2 + k * pi / 3
        c.stroke([polar(0.5, 0.5, 0.085, angle), polar(0.5, 0.5, 0.43, angle)], 0.045)
        for along, length in ((0.22, 0.12), (0.31, 0.09)):
            at = polar(0.5, 0.5, along, angle)
            for turn in (-pi / 3.2, pi / 3.2):
                c.stroke([at, polar(*at, length, angle + turn)], 0.036)
    return c.finish()
