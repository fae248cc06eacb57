"""The film of a sequence: the verified shadow of each part, and beside it the part from the side.

`python -m examples.walk_film DIR FILM.gif` takes the folder that `knotfab build --sequence` wrote, and shows
what is in its files: shadow-frame-NN.png and knots-NN.json.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.measurement import run_study
from examples.side_view import beside, side_view, write_gif
from knotfab.knots import read_start

SIZE = 320  # px, of each half's height
TURN_DEG = 50.0
FRAME_MS = 100


def walk_film(folder: Path) -> list[Image.Image]:
    """Return one picture a frame: the shadow to the left, the part turned by 50 degrees to the right.

    Raises:
        FileNotFoundError: the folder is not that of a sequence.
    """
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    knots = []
    for number in range(1, len(report["views"]) + 1):
        knots.append(read_start(folder / f"knots-{number:02d}.json").points)
    radius = float(report["settings"]["tube_radius_mm"])
    reach = 1.05 * max(float(np.linalg.norm(k, axis=1).max()) for k in knots) + radius
    found = []
    for number, knot in enumerate(knots, start=1):
        with Image.open(folder / f"shadow-frame-{number:02d}.png") as image:
            shadow = image.convert("RGB")
        shadow = shadow.resize(
            (round(SIZE * shadow.width / shadow.height), SIZE), Image.Resampling.BOX
        )
        found.append(beside(shadow, side_view([knot], radius, reach, SIZE, TURN_DEG)))
    return found


def main(folder: Path, path: Path, /) -> None:
    """Write the film of one sequence."""
    pictures = walk_film(folder)
    write_gif(path, pictures, FRAME_MS)
    print(f"{path}: {len(pictures)} pictures")


if __name__ == "__main__":
    run_study(main)
