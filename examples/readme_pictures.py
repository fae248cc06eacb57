"""The pictures that README and the tutorial name: they stand beside this file.

`python -m examples.readme_pictures [FOLDER]` (examples-pictures by default)
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageOps

from benchmarks.brought.drawings import leaf, mug, peak, star
from examples.pictures import pictures
from examples.walk_cycle import walk_cycle

PX = 512  # longer side
LOGO = """<svg xmlns="http://www.w3.org/2000/svg" width="80mm" height="60mm" viewBox="0 0 80 60">
  <path d="M4 50 L24 12 L36 34 L44 22 L62 50 Z"/>
  <circle cx="64" cy="16" r="10"/>
  <rect x="4" y="53" width="72" height="5" rx="2.5"/>
</svg>
"""


def badge(heart: Image.Image) -> Image.Image:
    """Return a red heart (black on white) in a red ring, on a blue disc."""
    size = 4 * PX
    sheet = Image.new("RGB", (size, size), "white")
    pen = ImageDraw.Draw(sheet)
    pen.ellipse((0.03 * size, 0.03 * size, 0.97 * size, 0.97 * size), fill="#1b4f8a")
    ring = (0.08 * size, 0.08 * size, 0.92 * size, 0.92 * size)
    pen.ellipse(ring, outline="#e02b20", width=round(0.07 * size))
    shape = ImageOps.invert(heart).resize((round(0.5 * size),) * 2)
    sheet.paste("#e02b20", (round(0.25 * size), round(0.27 * size)), shape)
    return sheet.resize((PX, PX), Image.Resampling.LANCZOS)


def write_pictures(folder: Path) -> list[Path]:
    """Write all of them into `folder`; returns where."""
    known = pictures()
    found = {f"{name}.png": known[name] for name in ("cat", "heart", "teapot")}
    found["badge.png"] = badge(known["heart"])
    found |= {f"logos/{draw.__name__}.png": draw() for draw in (leaf, mug, peak, star)}
    found |= {f"walk/{k:02d}.png": frame for k, frame in enumerate(walk_cycle(), start=1)}
    written = []
    for name, image in found.items():
        image.thumbnail((PX, PX), Image.Resampling.LANCZOS)
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        image.quantize(32).save(path, optimize=True)
        written.append(path)
    (folder / "logo.svg").write_text(LOGO, encoding="utf-8")
    return [*written, folder / "logo.svg"]


if __name__ == "__main__":
    place = Path(*sys.argv[1:2] or ["examples-pictures"])
    place.mkdir(parents=True, exist_ok=True)
    for path in write_pictures(place):
        print(path)
