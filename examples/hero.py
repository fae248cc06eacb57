"""The README's picture: what a build wrote, target and shadow above, the part from four sides below.

`python -m examples.hero FOLDER docs/knight.png`
"""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from benchmarks.measurement import run_study

WIDTH = 1200


def compose(folder: Path, out: Path, /) -> None:
    """Stack a build's compare-*.png and part.png, both `WIDTH` wide, and write the result."""
    found = [next(iter(sorted(folder.glob("compare-*.png")))), folder / "part.png"]
    rows = []
    for path in found:
        image = Image.open(path).convert("RGB")
        size = (WIDTH, round(image.height * WIDTH / image.width))
        rows.append(image.resize(size, Image.Resampling.LANCZOS))
    page = Image.new("RGB", (WIDTH, sum(r.height for r in rows)), (250, 248, 244))
    top = 0
    for row in rows:
        page.paste(row, (0, top))
        top += row.height
    page.quantize(128).save(out, optimize=True)


if __name__ == "__main__":
    run_study(compose)
