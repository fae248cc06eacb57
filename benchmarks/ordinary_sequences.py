"""Sequences as people draw them: a walk, a ball that bounces, two that are juggled, a bird, morphing letters.

`python -m benchmarks.ordinary_sequences [--only NAME] [--out DIR] [--accuracy draft]` draws the frames into
DIR/NAME/frames, builds each sequence into DIR/NAME/parts, and prints what every frame came to. `--draw` stops
at the frames; `--sheet PNG` draws the verified shadows of all that lie in DIR. Ends with 1 if one fails.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image, ImageDraw, ImageFont, ImageOps
from scipy.ndimage import distance_transform_edt

import knotfab
from benchmarks.measurement import Stopwatch, make_folder, run_study
from examples.pictures import BOLD, SIZE, Canvas
from examples.walk_cycle import polar_down, print_frames
from knotfab.sequence.frames import frame_name

_ROW_PX, _GAP_PX, _PAPER = 150, 6, 235  # of the sheet


@dataclass(frozen=True)
class Drawn:
    """A sequence as a person would draw it, and whether its last frame leads back to the first."""

    draw: Callable[[], list[Image.Image]]
    loops: bool = True


def stick_walk(frames: int = 6, lift: float = 0.5) -> list[Image.Image]:
    """A stick figure walks: two legs that scissor, two arms against them, one stroke wide throughout.

    Args:
        lift: rad that the knee bends of the leg that swings forward; at 0 one leg wholly hides the other.
    """
    return [_stick_figure(2 * pi * k / frames, lift) for k in range(frames)]


def _stick_figure(phase: float, lift: float) -> Image.Image:
    c, width = Canvas(0.8, 1.0), 0.055
    swing, bob = 0.5 * sin(phase), 0.012 * cos(2 * phase)
    neck, hip = (0.40, 0.32 - bob), (0.40, 0.58 - bob)
    c.disc(0.40, 0.17 - bob, 0.095)
    c.stroke([(0.40, 0.24 - bob), neck, hip], width)
    for side in (1, -1):
        knee = polar_down(hip, 0.18, side * swing)
        bend = lift * (0.3 + max(0.0, side * cos(phase)))
        c.stroke([hip, knee, polar_down(knee, 0.17, side * swing - bend)], width)
        elbow = polar_down(neck, 0.13, -side * swing)
        c.stroke([neck, elbow, polar_down(elbow, 0.12, -side * swing + 0.3)], width)
    return c.finish()


def bouncing_ball(frames: int = 8) -> list[Image.Image]:
    """A ball falls, is squashed on the ground, and goes up again; there and back over the frames."""
    found = []
    for k in range(frames):
        c, up = Canvas(0.6, 1.0), abs(cos(pi * k / frames))
        squash = 1.0 if up > 0.2 else 1.35
        across, high = 0.16 * squash, 0.16 / squash
        c.disc(0.30, 0.93 - high - 0.55 * up, across, high)
        found.append(c.finish())
    return found


def juggled_balls(frames: int = 8) -> list[Image.Image]:
    """Two balls go up and down in turn above a floor that they never touch: three pieces in every frame."""
    found = []
    for k in range(frames):
        c, up = Canvas(1.0, 1.0), 0.5 * cos(2 * pi * k / frames)
        c.shape([(0.06, 0.86), (0.94, 0.86), (0.94, 0.95), (0.06, 0.95)])
        for x, high in ((0.30, 0.5 + up), (0.70, 0.5 - up)):
            c.disc(x, 0.66 - 0.46 * high, 0.14)
        found.append(c.finish())
    return found


def flapping_bird(frames: int = 6) -> list[Image.Image]:
    """A bird from the front: a body, and two wings that go up and down."""
    found = []
    for k in range(frames):
        c, up = Canvas(1.0, 0.8), cos(2 * pi * k / frames)
        c.disc(0.50, 0.44, 0.085, 0.11)
        for side in (1, -1):
            elbow = 0.50 + side * 0.20, 0.40 - 0.14 * up
            tip = 0.50 + side * 0.42, 0.44 - 0.26 * up
            c.curve([(0.50, 0.42), elbow, tip], 0.13, 0.04)
        found.append(c.finish())
    return found


def morphing_letters(frames: int = 8, text: str = "TLC") -> list[Image.Image]:
    """One letter becomes the next: the distances from their outlines, mixed and cut at zero."""
    fields = [_letter_distance(letter) for letter in text]
    found = []
    for k in range(frames):
        at = k * (len(fields) - 1) / (frames - 1)
        before = min(int(at), len(fields) - 2)
        share = at - before
        mixed = (1 - share) * fields[before] + share * fields[before + 1]
        ink = np.clip(0.5 - mixed, 0.0, 1.0)
        found.append(Image.fromarray(np.uint8(255 * (1 - ink))))
    return found


def _letter_distance(letter: str) -> np.ndarray:
    """(SIZE, SIZE) px to the outline, negative inside."""
    sheet = Image.new("L", (SIZE, SIZE), 0)
    font = ImageFont.truetype(str(BOLD), round(0.95 * SIZE))
    ImageDraw.Draw(sheet).text((SIZE / 2, SIZE / 2), letter, font=font, fill=255, anchor="mm")
    ink = np.asarray(sheet) > 127
    distance: np.ndarray = distance_transform_edt(~ink) - distance_transform_edt(ink)
    return distance


SEQUENCES: dict[str, Drawn] = {
    "walk": Drawn(stick_walk),
    "stiff-walk": Drawn(lambda: stick_walk(lift=0.0)),
    "ball": Drawn(bouncing_ball),
    "balls": Drawn(juggled_balls),
    "bird": Drawn(flapping_bird),
    "letters": Drawn(morphing_letters, loops=False),
}


def draw_frames(name: str, folder: Path) -> Path:
    """The frames of a sequence as numbered PNG files in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(SEQUENCES[name].draw(), start=1):
        image.save(folder / f"{frame_name(number)}.png", optimize=True)
    return folder


def draw_sheet(folder: Path, path: Path) -> None:
    """The verified shadows of all sequences that were built in `folder`, a row each."""
    rows = []
    for name in SEQUENCES:
        shadows = sorted((folder / name / "parts").glob("shadow-*.png"))
        seen = [Image.open(shadow).convert("L") for shadow in shadows]
        rows.append([ImageOps.contain(image, (_ROW_PX, _ROW_PX)) for image in seen])
    rows = [row for row in rows if row]
    wide = max(sum(image.width + _GAP_PX for image in row) for row in rows) - _GAP_PX
    sheet = Image.new("L", (wide, len(rows) * (_ROW_PX + _GAP_PX) - _GAP_PX), _PAPER)
    for k, row in enumerate(rows):
        x = 0
        for image in row:
            sheet.paste(image, (x, k * (_ROW_PX + _GAP_PX)))
            x += image.width + _GAP_PX
    sheet.save(path, optimize=True)


def main(
    *,
    only: Literal[*SEQUENCES] | None = None,
    out: Path | None = None,
    accuracy: str = "draft",
    draw: bool = False,
    sheet: Path | None = None,
) -> int:
    """Draw, build, print; 1 where a sequence fails."""
    folder, failed = make_folder(out, "sequences"), []
    for name in [only] if only else SEQUENCES:
        frames = draw_frames(name, folder / name / "frames")
        if draw:
            continue
        watch = Stopwatch()
        outcome = knotfab.build(
            str(frames),
            folder / name / "parts",
            sequence=True,
            no_loop=not SEQUENCES[name].loops,
            accuracy=accuracy,
            skip=("slicer",),
        )
        print(f"{name}: exit {outcome.exit_code}, {watch.wall_s:.0f} s", flush=True)
        print_frames(outcome.report)
        if outcome.exit_code:
            failed.append(name)
    if sheet is not None:
        draw_sheet(folder, sheet)
    return int(bool(failed))


if __name__ == "__main__":
    run_study(main)
