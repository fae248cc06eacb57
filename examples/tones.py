"""A portrait in greys, painted for `--tone lines`, and what became of it.

`python -m examples.tones portrait.png` paints it; after `knotfab build portrait.png --tone lines
--tube-radius 0.8 --size 220 --out DIR`, `python -m examples.tones --built DIR docs/tones.png` lays picture,
verified shadow, and that shadow seen through a Gaussian of three tube radii beside each other.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.measurement import run_study

Grey = np.ndarray
LIGHT = np.array([-0.52, -0.50, 0.69])  # from the upper left, in front


def paint_portrait(height: int = 1000) -> Image.Image:
    """Return a face before a pale wall, lit from the side: hair, brows, eyes, nose, mouth, a dark jumper."""
    y, x = np.mgrid[0:height, 0 : round(0.84 * height)] / height
    x, y = 0.115 + 0.70 * x, 0.10 + 0.70 * y  # close up
    grey = 1.0 + 0.0 * x

    def lay(shape: Grey, shade: Grey | float) -> None:
        nonlocal grey
        grey = grey * (1 - shape) + np.asarray(shade) * shape

    shoulders = _soft(1.06 - np.hypot((x - 0.41) / 0.40, (y - 1.14) / 0.36))
    neck = _soft(1 - ((x - 0.41) / 0.105) ** 6 - ((y - 0.78) / 0.17) ** 6)
    hair = _soft(1 - np.hypot((x - 0.405) / 0.285, (y - 0.36) / 0.315))
    lay(hair, 0.10 + 0.10 * np.exp(-(((x - 0.27) / 0.09) ** 2 + ((y - 0.15) / 0.06) ** 2)))
    lay(neck, 0.62 - 0.34 * _soft((x - 0.40) / 0.08) - 0.30 * _soft((0.80 - y) / 0.06))
    lay(shoulders, 0.22 - 0.10 * _soft((x - 0.45) / 0.2))
    across, down = (x - 0.40) / 0.218, (y - 0.47) / 0.318
    round_face = np.hypot(across, down * (1 - 0.10 * down))
    skin = _soft(1 - np.hypot(across * (1 + 0.14 * np.maximum(down, 0)), down))
    depth = np.sqrt(np.clip(1 - round_face**2, 0, 1))
    lambert = np.clip(LIGHT[0] * across + LIGHT[1] * down * 0.7 + LIGHT[2] * depth, 0, 1)
    lay(skin, 0.42 + 0.44 * lambert)
    fringe = _soft(0.62 - np.hypot((x - 0.47) / 0.36, (y - 0.10) / 0.335), 0.02)
    lay(fringe * hair, 0.10)
    for side in (-1, 1):
        eye = 0.40 + 0.098 * side
        grey = grey - 0.20 * _spot(x - eye, y - 0.432, 0.062, 0.034)
        lay(_soft(1 - np.hypot((x - eye) / 0.056, (y - 0.447) / 0.025)), 1.0)
        lay(_soft(1 - np.hypot((x - eye) / 0.026, (y - 0.445) / 0.026)), 0.0)
        lid = y - 0.421 - 3.0 * (x - eye) ** 2
        lay(_soft(1 - np.abs((x - eye) / 0.062) ** 4 - (lid / 0.009) ** 2), 0.1)
        brow = y - 0.366 - 1.6 * (x - eye) ** 2 - 0.05 * side * (x - eye)
        lay(_soft(1 - np.abs((x - eye) / 0.068) ** 4 - (brow / 0.017) ** 2), 0.0)
    nose = 0.408 + 0.10 * (y - 0.45)
    grey = grey - 0.36 * _spot(x - nose - 0.026, y - 0.52, 0.016, 0.062)
    grey = grey + 0.22 * _spot(x - nose + 0.006, y - 0.52, 0.011, 0.07)
    for at in (0.385, 0.437):
        grey = grey - 0.42 * _spot(x - at, y - 0.592, 0.013, 0.008)
    grey = grey - 0.22 * _spot(x - 0.415, y - 0.603, 0.035, 0.010)
    mouth = y - 0.675 + 1.6 * (x - 0.405) ** 2
    lay(_soft(1 - np.abs((x - 0.405) / 0.088) ** 2 - (mouth / 0.017) ** 2), 0.0)
    grey = grey - 0.16 * _spot(x - 0.42, y - 0.712, 0.045, 0.012)
    return Image.fromarray(np.clip(255 * grey, 0, 255).astype(np.uint8))


def _soft(inside: Grey, edge: float = 0.03) -> Grey:
    """Return 1 where a function is above 0, 0 where it is below, with a soft edge."""
    return np.clip(0.5 + inside / (2 * edge), 0.0, 1.0)


def _spot(dx: Grey, dy: Grey, width: float, height: float) -> Grey:
    """Return a Gaussian spot."""
    return np.exp(-0.5 * ((dx / width) ** 2 + (dy / height) ** 2))


def lay_beside(folder: Path, height: int = 560, gap: int = 24) -> Image.Image:
    """Return picture, shadow, and the shadow as it is judged, of a build in greys."""
    from scipy.ndimage import gaussian_filter

    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    scene = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
    view = scene["views"][0]
    picture = Image.open(folder / report["views"][0]["picture"]).convert("L")
    shadow = Image.open(folder / "shadow-front.png").convert("L")
    # sigma is three times half the width of a line
    sigma = 1.5 * view["thicken_mm"] * shadow.width / view["frame_width_mm"]
    soft = gaussian_filter(255.0 - np.asarray(shadow, dtype=float), sigma, mode="constant")
    size = (round(height * picture.width / picture.height), height)
    shown = [picture, shadow, Image.fromarray((255.0 - soft).astype(np.uint8))]
    laid = Image.new("L", (3 * size[0] + 2 * gap, height), "white")
    for k, image in enumerate(shown):
        laid.paste(image.resize(size, Image.Resampling.LANCZOS), (k * (size[0] + gap), 0))
    return laid


def main(file: Path, *, built: Path | None = None) -> None:
    """Write the portrait, or what became of it."""
    made = paint_portrait() if built is None else lay_beside(built)
    made.save(file, optimize=True)


if __name__ == "__main__":
    run_study(main)
