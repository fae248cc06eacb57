"""A walk cycle, drawn: twelve frames of a figure that walks, one arm swings, the other waves.

`python examples/walk_cycle.py FOLDER` writes them as frame-01.png, frame-02.png, ... and walk.gif.
"""

from __future__ import annotations

import sys
from math import cos, pi, sin
from pathlib import Path

if __package__ in (None, ""):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from PIL import Image

from examples.pictures import Canvas, Point

__all__ = ["FRAMES", "walk_cycle"]

FRAMES = 12
_THIGH, _SHANK, _FOOT = 0.18, 0.18, 0.045
_GROUND = 0.925
_STRIDE = 0.56  # rad, the hip's swing to either side


def walk_cycle(frames: int = FRAMES) -> list[Image.Image]:
    """The frames of one whole cycle (two steps): mode "L", black on white, all of one size."""
    # the middle of each stretch: in no frame does one leg hide the other
    return [_walker(2 * pi * (k + 0.5) / frames) for k in range(frames)]


def _walker(phase: float) -> Image.Image:
    """The figure at `phase` of its cycle; it walks to the right."""
    sheet = Canvas(0.86, 1.0)
    legs = [_leg(phase), _leg(phase + pi)]
    # the lower sole is on the ground: the hip bobs twice a cycle
    lowest = max(y for leg in legs for _, y in leg)
    hip = (0.40, _GROUND - 0.03 - lowest)
    for leg in legs:
        thigh, shank, foot = ([_moved(hip, p) for p in leg[k : k + 2]] for k in range(3))
        sheet.stroke(thigh, 0.10, 0.08)
        sheet.stroke(shank, 0.08, 0.07)
        sheet.stroke(foot, 0.07, 0.065)
    neck = _moved(hip, (0.035, -0.28))
    sheet.stroke([hip, _moved(hip, (0.02, -0.14)), _moved(neck, (0.0, 0.02))], 0.13, 0.15)
    sheet.disc(*_moved(neck, (0.02, -0.125)), 0.082, 0.092)
    # both arms reach ahead, where they can be seen: the lower one swings, the upper one waves
    for shoulder, raised, bend in (
        (neck, 0.95 - 0.30 * cos(phase), 0.20),
        (_moved(neck, (0.02, 0.0)), 1.95 + 0.15 * sin(phase), 0.35 + 0.4 * sin(phase)),
    ):
        elbow = _polar_down(shoulder, 0.16, raised)
        sheet.stroke([shoulder, elbow], 0.085, 0.075)
        sheet.stroke([elbow, _polar_down(elbow, 0.135, raised + bend)], 0.075, 0.07)
    return sheet.finished()


def _leg(phase: float) -> list[Point]:
    """Hip, knee, ankle and toe from the hip: the leg swings forward where its knee bends."""
    hip = _STRIDE * cos(phase)
    bend = 0.10 + 0.20 * max(0.0, -sin(phase))
    knee = _polar_down((0.0, 0.0), _THIGH, hip + 0.5 * bend)
    ankle = _polar_down(knee, _SHANK, hip - 0.5 * bend)
    toe = _polar_down(ankle, _FOOT, 0.5 * pi + 0.5 * (hip - bend) * (hip < bend))
    return [(0.0, 0.0), knee, ankle, toe]


def _polar_down(at: Point, length: float, angle: float) -> Point:
    """`length` away from `at`, `angle` from straight down, towards the right."""
    return at[0] + length * sin(angle), at[1] + length * cos(angle)


def _moved(at: Point, by: Point) -> Point:
    return at[0] + by[0], at[1] + by[1]


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/walk_cycle.py FOLDER")
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    drawn = walk_cycle()
    for number, image in enumerate(drawn, start=1):
        image.save(folder / f"frame-{number:02d}.png", optimize=True)
    small = [image.resize((image.width // 4, image.height // 4)) for image in drawn]
    small[0].save(folder / "walk.gif", save_all=True, append_images=small[1:], duration=90, loop=0)
    print(folder)
