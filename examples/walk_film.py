"""The film of a sequence: the verified shadow of each part, and beside it the part from the side.

`python -m examples.walk_film DIR FILM.gif` takes the folder that `knotfab build --sequence` wrote, and shows
what is in its files: shadow-frame-NN.png and knots-NN.json.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageChops, ImageOps

from benchmarks.measurement import run_study
from examples.side_view import beside, side_view
from knotfab.knots import read_start
from knotfab.render.part_picture import draw_part, write_gif
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.shadows.render import why_no_rendering

SIZE = 320  # px, of each half's height
TURN_DEG = 50.0
FRAME_MS = 100
ABOVE_DEG = 24.0
PAPER = (250, 248, 244)


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


def zoetrope_picture(part: Path, path: Path, pixels: int = 1100) -> bool:
    """Return the zoetrope from a little above, cropped; whether this machine could draw it."""
    mesh = read_mesh(part)
    a = np.deg2rad(ABOVE_DEG)
    # from z up to y up, as the pictures of parts have it, and tilted towards the eye
    x, y, z = mesh.vertices.T
    tilted = np.column_stack([x, z * np.cos(a) + y * np.sin(a), z * np.sin(a) - y * np.cos(a)])
    if why_no_rendering() is not None:
        return False
    import pyvista

    # the ring's edges are to be sharp: corners there are one for each side
    triangles: Any = mesh.faces
    whole = pyvista.PolyData.from_regular_faces(tilted, triangles)
    parted = whole.compute_normals(split_vertices=True, feature_angle=50.0)
    eye = np.array([[0.0, 0.0, 900.0]])
    draw_part(np.array(parted.points), parted.regular_faces, path, eye, pixels)
    with Image.open(path) as drawn:
        image = drawn.convert("RGB")
    paper = Image.new("RGB", image.size, PAPER)
    box = ImageChops.difference(image, paper).getbbox()
    small = ImageOps.expand(image.crop(box), 20, PAPER).quantize(64)
    small.save(path, optimize=True)
    return True


def main(folder: Path, path: Path, /) -> None:
    """Write the film of one sequence."""
    pictures = walk_film(folder)
    write_gif(path, pictures, FRAME_MS)
    print(f"{path}: {len(pictures)} pictures")


if __name__ == "__main__":
    run_study(main)
