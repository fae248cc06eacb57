"""Parts as they stand on the printer's bed, and as the lamp and a viewer aside see them: a row each.

`python -m examples.standing OUT.png FOLDER...`, such as a build with the slicer's supports (which are not
drawn) above one without.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.measurement import run_study, stack
from knotfab.base.arrays import Array
from knotfab.geometry.tube import join_meshes
from knotfab.part.files import read_shells
from knotfab.render.part_picture import draw_part, turn_eye
from knotfab.scene.camera import camera_of
from knotfab.scene.load import load_scene

WIDTH, PANEL_PX = 1200, 400
ASIDE_DEG = (0.0, 45.0)
BED_EYE_MM = np.array([[120.0, 90.0, 700.0]])  # low before the printer
_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z up to y up


def draw_row(folder: Path) -> Image.Image:
    """Draw a build's part on the bed, from its lamp, and from aside."""
    scene = load_scene(folder / "scene.toml")
    assert scene.pose is not None
    vertices, faces = join_meshes(read_shells(folder / "part.3mf"))
    pose, light = np.array(scene.pose.matrix), camera_of(scene.views[0], 1, 1).eye

    def panels(points: Array, eyes: Array) -> Image.Image:
        drawn = io.BytesIO()
        draw_part(points, faces, drawn, eyes, PANEL_PX)
        return Image.open(drawn).convert("RGB")

    lying = vertices @ _UPRIGHT.T
    row = Image.new("RGB", (3 * PANEL_PX, PANEL_PX))
    row.paste(panels(lying - (lying.min(axis=0) + lying.max(axis=0)) / 2, BED_EYE_MM), (0, 0))
    seen = panels(vertices @ pose[:3, :3].T + pose[:3, 3], turn_eye(light, ASIDE_DEG))
    row.paste(seen, (PANEL_PX, 0))
    return row


def main(out: Path, *folders: Path) -> None:
    """Write the picture."""
    rows = [draw_row(folder) for folder in folders]
    stack(rows, WIDTH, "white").quantize(96).save(out, optimize=True)


if __name__ == "__main__":
    run_study(main)
