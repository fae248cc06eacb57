"""Two and three pictures in one part: what each build reached, beside the bound of its hull.

`python -m paper.two_views --out DIR`: builds the pairs below from the project's own pictures,
by shadow and by eye, and prints a line a view. `--only NAME` builds one, and `--picture FILE` draws it.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh
from PIL import Image

from benchmarks.measurement import Stopwatch, make_folder, run_study, save_pictures
from examples.pictures import pictures
from knotfab.design.frames import spread_views
from knotfab.errors import KnotfabError
from knotfab.pipeline import build
from knotfab.report.pictures import PAPER, draw_part, turn_eye
from knotfab.request import Outcome, Request
from knotfab.scene.model import Scene

_WIDE = 760  # pixels of a comparison

CASES: dict[str, tuple[str, ...]] = {
    "heart-teapot": ("heart", "teapot"),
    "cat-bird": ("cat", "bird"),
    "knight-face": ("knight", "face"),
    "heart-teapot-by-eye": ("heart", "teapot"),
    "heart-face-teapot": ("heart", "face", "teapot"),
    "knight-cat-bird": ("knight", "cat", "bird"),
    "anchor-wheel-plane": ("anchor", "wheel", "plane"),
}


def build_case(name: str, folder: Path) -> Outcome:
    """Draw the pictures of a case into `folder` and build them into `folder`/NAME."""
    saved = save_pictures(pictures(), make_folder(folder, name), CASES[name])
    files = [str(saved[picture]) for picture in CASES[name]]
    scene = spread_views(Scene(), files)
    if name.endswith("by-eye"):
        views = tuple(v.model_copy(update={"kind": "eye"}) for v in scene.views)
        scene = scene.model_copy(update={"views": views})
    return build(Request(scene, tuple(files), folder / name))


def draw_case(outcome: Outcome, path: Path) -> None:
    """Each target with its verified shadow, and the part from the direction midway between the views."""
    scratch = path.with_suffix(".part.png")
    mesh = trimesh.load_mesh(outcome.folder / "part.stl")
    with (outcome.folder / "scene.toml").open("rb") as file:
        scene = tomllib.load(file)
    pose = np.array(scene["pose"]["matrix"])
    points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    between = 0.5 * float(scene["views"][1]["azimuth_deg"])
    panels = []
    for view in outcome.report["views"]:
        panels.append(Image.open(outcome.folder / f"compare-{view['name']}.png").convert("RGB"))
    draw_part(points, mesh.faces, scratch, turn_eye((0.0, 0.0, 500.0), (between,)))
    panels.append(Image.open(scratch).convert("RGB"))
    panels[-1].load()
    scratch.unlink()
    _stack(panels).quantize(128, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


def _stack(panels: list[Image.Image]) -> Image.Image:
    """The comparisons under each other, and the part to the right of them."""
    rows, side = panels, None
    if panels[-1].width == panels[-1].height:
        rows, side = panels[:-1], panels[-1]
    rows = [p.resize((_WIDE, round(p.height * _WIDE / p.width))) for p in rows]
    high = sum(p.height for p in rows)
    beside = min(high, _WIDE) if side else 0
    page = Image.new("RGB", (_WIDE + beside, high), PAPER)
    top = 0
    for row in rows:
        page.paste(row, (0, top))
        top += row.height
    if side:
        page.paste(side.resize((beside, beside)), (_WIDE, (high - beside) // 2))
    return page


def _print_case(name: str, outcome: Outcome, watch: Stopwatch) -> None:
    for view, picture in zip(outcome.report["views"], CASES[name], strict=True):
        print(
            f"{name:20} {picture:8} {view['kind']:6} IoU {view['iou']:.4f}  "
            f"bound {view['bound']:.4f}  short of it {view['bound'] - view['iou']:.4f}"
        )
    radius = outcome.report["settings"]["tube_radius_mm"]
    print(
        f"{name:20} {outcome.report['status']}, tube radius {radius:.2f} mm, "
        f"{watch.wall_s:.0f} s ({watch.cpu_s:.0f} CPU s)"
    )


def main(*, out: Path, only: Literal[*CASES] | None = None, picture: Path | None = None) -> None:
    """Build, and print the table; a case that cannot be built prints why."""
    if picture and not only:
        raise SystemExit("--picture draws one case: name it with --only")
    for name in [only] if only else CASES:
        watch = Stopwatch()
        try:
            outcome = build_case(name, out)
        except KnotfabError as error:
            print(f"{name:20} {error}")
            continue
        _print_case(name, outcome, watch)
        if picture:
            draw_case(outcome, picture)


if __name__ == "__main__":
    run_study(main)
