"""Six pictures in colours by three lamps: what each build reached, and what its colours are on the screen.

`python -m benchmarks.coloured_lamps --out DIR`: builds the pictures of `examples.lamps.draw` with the
command's own options, and some of the project's pictures alone, whose median time is the unit of the others'.
Prints a line a picture: the share of pixels in the right colour (also inside alone, and what the masks
themselves have right of the picture), each mask's IoU, the verdict, lamps moved by 2 mm, lamps of 5 mm, and
the time. What is built already is not built again; all are drawn into DIR/lamps.png: as they came, as seen,
and what is wrong. `--picture FILE` draws three of them for docs/lamps.md.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.measurement import build_once, make_folder, run_study, stack
from benchmarks.several_table import build_set
from examples.lamps.draw import PICTURES
from knotfab.base.disk import read_text
from knotfab.render.part_picture import PAPER

_ALONE = ("heart", "cat", "knight")
_WIDE_MM = 5.0
_ROW, _PANEL = 1100, 240  # px
_SHOWN = ("parrot-outlined", "parrot", "word")


def build_picture(name: str, folder: Path, lamps: str = "rgb") -> dict[str, Any]:
    """Build a picture into `folder`/NAME, where that is not done yet: code, seconds, report, where it is."""
    file = folder / "pictures" / f"{name}.png"
    file.parent.mkdir(exist_ok=True)
    if not file.is_file():
        PICTURES[name]().save(file)
    return build_once(file, folder / name, "--lamps", lamps)


def share_under(built: dict[str, Any], lamp_mm: float) -> float:
    """Return the share of pixels in the right colour under lamps of another size, verified anew."""
    moved = built["folder"] / "other-lamps"
    moved.mkdir(exist_ok=True)
    for file in built["folder"].iterdir():
        if file.suffix in (".stl", ".png", ".json") and file.is_file():
            shutil.copy(file, moved)
    scene = read_text(built["folder"] / "scene.toml", "scene.toml", "scene file")
    lines = [
        f"light_diameter_mm = {lamp_mm}" if line.startswith("light_diameter_mm") else line
        for line in scene.splitlines()
    ]
    (moved / "scene.toml").write_text("\n".join(lines))
    command = [sys.executable, "-m", "knotfab_validators", str(moved / "part.stl"), "--json"]
    command += ["--knots", str(moved / "knots.json"), "--scene", str(moved / "scene.toml")]
    told = json.loads(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
    shutil.rmtree(moved)
    return float(told["colours"]["share"])


def print_picture(name: str, built: dict[str, Any], unit_s: float) -> None:
    """Print a line for a picture."""
    report = built["report"]
    if not report or "colours" not in report:
        print(f"{name:16} code {built['code']}  {built['said'][-300:]}", flush=True)
        return
    colours = report["colours"]
    ious = " ".join(f"{view['name']} {view['iou']:.4f}" for view in report["views"])
    moved = colours["misregistration"]
    print(
        f"{name:16} code {built['code']} {report['verdict']['word']:9} right {colours['share']:.4f} "
        f"(inside {colours['share_inside']:.4f}, masks' own {colours['picture']['masks_share']:.4f}, "
        f"{_WIDE_MM:g} mm lamps {share_under(built, _WIDE_MM):.4f}, "
        f"moved {moved['moved_mm']:g} mm {moved['share']:.4f})  IoU {ious}  dE {colours['delta_e']:.1f}  "
        f"{len(report['knots'])} knots of {report['settings']['tube_radius_mm']:.2f} mm  "
        f"{built['cpu_s']:.0f} CPU s ({built['cpu_s'] / unit_s:.1f}x)",
        flush=True,
    )


def draw_sheet(built: list[dict[str, Any]], path: Path) -> None:
    """Draw all pictures under each other: as it came, as its masks have it, as seen, and what is wrong."""
    files = [one["folder"] / "compare-colours.png" for one in built]
    rows = [Image.open(file).convert("RGB") for file in files if file.is_file()]
    stack(rows, _ROW, "white").save(path, optimize=True)


def draw_page(folder: Path, path: Path) -> None:
    """Draw three pictures for the page on lamps: each as it came, as seen on the screen, and its part."""
    rows = []
    for name in _SHOWN:
        built = build_picture(name, folder)["folder"]
        came, seen, part = (
            Image.open(built / file).convert("RGB")
            for file in ("picture-colours.png", "colours.png", "part.png")
        )
        part = part.crop((0, 0, part.width // 2, part.height))
        height = round(_PANEL * came.height / came.width)
        row = Image.new("RGB", (4 * _PANEL, max(height, _PANEL)), PAPER)
        for n, one in enumerate((came, seen)):
            row.paste(
                one.resize((_PANEL - 6, height - 6)),
                (n * _PANEL + 3, (row.height - height) // 2 + 3),
            )
        row.paste(part.resize((2 * _PANEL, _PANEL)), (2 * _PANEL, (row.height - _PANEL) // 2))
        rows.append(row)
    stack(rows, 4 * _PANEL, PAPER).save(path, optimize=True)  # in all its colours


def main(*, out: Path | None = None, only: str = "", picture: Path | None = None) -> None:
    """Build, print the table and draw the sheet; or draw the page's picture alone."""
    folder = make_folder(out, "lamps")
    if picture:
        draw_page(folder, picture)
        return
    unit_s = float(np.median([build_set(name, folder)["cpu_s"] for name in _ALONE]))
    print(f"one picture takes {unit_s:.1f} CPU s (median)", flush=True)
    found = []
    for name in [only] if only else PICTURES:
        found.append(build_picture(name, folder))
        print_picture(name, found[-1], unit_s)
    draw_sheet(found, folder / "lamps.png")


if __name__ == "__main__":
    run_study(main)
