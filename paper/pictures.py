"""Pictures of the kind that the paper shows, drawn here: the ten of its figures with their published IoU."""

from __future__ import annotations

from math import cos, pi, sin

from PIL import Image

from examples.pictures import Canvas, pictures

# IoU of the paper's own published pictures with their targets, measured from its figures; the first five
# with all its constraints, the others without.
PUBLISHED = {
    "bunny": 0.978,
    "bird": 0.952,
    "smiley": 0.964,
    "armoured head": 0.786,
    "spiral": 0.855,
    "arc": 0.990,
    "aeroplane": 0.887,
    "chair": 0.955,
    "wheel": 0.982,
    "stick man": 0.978,
}


def paper_pictures() -> dict[str, Image.Image]:
    """Return one picture of each kind, by the names of `PUBLISHED`: mode "L", black on white."""
    own = pictures()
    drawn = {
        "bunny": _bunny(),
        "bird": own["bird"],
        "smiley": own["smiley"],
        "armoured head": _armoured_head(),
        "spiral": own["spiral"],
        "arc": _arc(),
        "aeroplane": own["plane"],
        "chair": _chair(),
        "wheel": own["wheel"],
        "stick man": own["stickman"],
    }
    return {name: drawn[name] for name in PUBLISHED}


def _bunny() -> Image.Image:
    """Return a sitting hare from the side: round back, two ears laid back, a scut."""
    sheet = Canvas(0.94, 1.0)
    body = [(0.13, 0.84), (0.15, 0.58), (0.33, 0.44), (0.53, 0.46), (0.66, 0.60), (0.71, 0.80)]
    sheet.blob([*body, (0.66, 0.93), (0.40, 0.95), (0.20, 0.94)])
    sheet.disc(0.67, 0.41, 0.145, 0.125)
    sheet.disc(0.61, 0.53, 0.10)
    sheet.blob([(0.74, 0.36), (0.85, 0.43), (0.83, 0.49), (0.72, 0.51)])
    sheet.blob([(0.62, 0.36), (0.53, 0.20), (0.50, 0.06), (0.57, 0.06), (0.66, 0.18), (0.71, 0.33)])
    sheet.blob([(0.55, 0.38), (0.42, 0.26), (0.34, 0.14), (0.40, 0.11), (0.52, 0.20), (0.63, 0.34)])
    sheet.blob([(0.56, 0.62), (0.70, 0.60), (0.75, 0.80), (0.80, 0.93), (0.64, 0.94), (0.60, 0.80)])
    sheet.disc(0.12, 0.80, 0.075)
    sheet.disc(0.71, 0.39, 0.022, ink=255)
    return sheet.finish()


def _armoured_head() -> Image.Image:
    """Return a closed helmet from the side: plume, visor with slits and breaths, gorget with rivets."""
    sheet = Canvas(0.9, 1.0)
    dome = [(0.16, 0.62), (0.15, 0.36), (0.32, 0.19), (0.52, 0.18), (0.66, 0.30), (0.70, 0.46)]
    sheet.blob([*dome, (0.84, 0.56), (0.73, 0.66), (0.64, 0.76), (0.40, 0.80), (0.20, 0.76)])
    sheet.blob([(0.12, 0.80), (0.40, 0.76), (0.68, 0.78), (0.76, 0.95), (0.42, 0.97), (0.06, 0.95)])
    sheet.curve([(0.40, 0.20), (0.27, 0.09), (0.10, 0.14), (0.05, 0.40), (0.08, 0.58)], 0.09, 0.03)
    for k in range(5):
        sheet.disc(0.50 + 0.045 * k, 0.435 + 0.006 * k, 0.019, ink=255)
    for row in range(2):
        for k in range(3):
            sheet.disc(0.58 + 0.06 * k, 0.56 + 0.07 * row, 0.017, ink=255)
    for k in range(6):
        sheet.disc(0.17 + 0.105 * k, 0.89, 0.018, ink=255)
    sheet.disc(0.36, 0.50, 0.045, ink=255)
    sheet.disc(0.36, 0.50, 0.020)
    return sheet.finish()


def _arc() -> Image.Image:
    """Return three quarters of a ring."""
    sheet = Canvas()
    turn = [pi * (0.75 + 1.5 * k / 150) for k in range(151)]
    sheet.stroke([(0.5 + 0.36 * cos(a), 0.54 + 0.36 * sin(a)) for a in turn], 0.13)
    return sheet.finish()


def _chair() -> Image.Image:
    """Return a dining chair seen a little from above: four legs, a back with three bars."""
    sheet = Canvas(0.72, 1.0)
    sheet.stroke([(0.14, 0.06), (0.17, 0.95)], 0.05)
    sheet.stroke([(0.46, 0.06), (0.46, 0.60)], 0.05)
    for y in (0.10, 0.24, 0.38):
        sheet.stroke([(0.15, y), (0.46, y)], 0.055)
    sheet.shape([(0.13, 0.53), (0.47, 0.53), (0.64, 0.64), (0.27, 0.66)])
    sheet.stroke([(0.47, 0.58), (0.44, 0.84)], 0.045)
    sheet.stroke([(0.61, 0.63), (0.63, 0.94)], 0.05)
    sheet.stroke([(0.29, 0.64), (0.29, 0.95)], 0.05)
    sheet.stroke([(0.29, 0.80), (0.62, 0.79)], 0.04)
    return sheet.finish()
