"""Draw built pieces, unlit, for readers who do not know them: shuffled, numbered, without names.

`python -m benchmarks.strangers BUILDS SHEET.png [--seed N] [--views N]`: all pieces below BUILDS, such as
supports-table's, from 45 degrees to either side, 20 a sheet: SHEET-1.png and so on. With `--views`, so many
from any of the twelve sides of `told`. SHEET.json has the key: of each number the piece, where it is seen
from, and what `told` says of that look. Who reads the sheets writes down for each number what it is, or that
it is a tangle.
"""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from trimesh import load_mesh

from benchmarks.measurement import run_study
from knotfab.picture.read import read_targets
from knotfab.render.part_picture import draw_part, look_from
from knotfab.scene.camera import view_axes
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import load_scene
from knotfab_validators.shadows.told import DOOR, SIDES, tell_side

PX, ACROSS, DOWN = 260, 5, 4


def list_pieces(builds: Path) -> list[Path]:
    """List the folders of passed builds of one view below a folder."""
    found = sorted(path.parent for path in builds.rglob("part.stl"))
    return [
        one for one in found if one.name != "rejected" and (one / "picture-front.png").is_file()
    ]


def draw_looks(folder: Path, sides: list[tuple[int, int]]) -> tuple[list[Image.Image], list[float]]:
    """Draw a piece from these sides; also return what each tells of its picture."""
    scene = resolve(load_scene(folder / "scene.toml"))
    assert scene.pose is not None
    mesh, matrix = load_mesh(folder / "part.stl"), np.array(scene.pose.matrix)
    vertices, faces = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], np.asarray(mesh.faces)
    view = scene.views[0]
    (target,) = read_targets([view.picture], [view], base=folder)
    strip, told = io.BytesIO(), []
    draw_part(vertices, faces, strip, np.array([look_from(view, *side) for side in sides]), PX)
    for side in sides:
        told.append(tell_side(vertices @ view_axes(view).T, faces, side, target.asked))
    row = Image.open(strip)
    return [row.crop((PX * k, 0, PX * (k + 1), PX)) for k in range(len(sides))], told


def main(builds: Path, sheet: Path, /, *, seed: int = 0, views: int = 0) -> None:
    """Draw the sheets and their key."""
    pieces, rng = list_pieces(builds), np.random.default_rng(seed)
    if not pieces:
        raise SystemExit(f"{builds}: there is no part.stl below it. Name a folder of builds")
    every = [(one, side) for one in pieces for side in (SIDES if views else DOOR)]
    order = rng.permutation(len(every))[: views or None]
    chosen = [every[k] for k in order.tolist()]
    looks: dict[tuple[Path, tuple[int, int]], tuple[Image.Image, float]] = {}
    for piece in pieces:
        sides = [side for one, side in chosen if one == piece]
        if sides:
            drawn = zip(*draw_looks(piece, sides), strict=True)
            looks |= {(piece, side): look for side, look in zip(sides, drawn, strict=True)}
    key = {}
    for first in range(0, len(chosen), ACROSS * DOWN):
        some = chosen[first : first + ACROSS * DOWN]
        page = Image.new("RGB", (PX * ACROSS, PX * -(-len(some) // ACROSS)), "white")
        for k, (piece, side) in enumerate(some):
            image, told = looks[piece, side]
            at = PX * (k % ACROSS), PX * (k // ACROSS)
            page.paste(image, at)
            ImageDraw.Draw(page).text((at[0] + 6, at[1] + 6), str(first + k + 1), fill="black")
            place = str(piece.relative_to(builds))
            key[first + k + 1] = {"piece": place, "side": side, "told": round(told, 3)}
        page.save(sheet.with_stem(f"{sheet.stem}-{first // (ACROSS * DOWN) + 1}"))
    sheet.with_suffix(".json").write_text(json.dumps(key, indent=1))


if __name__ == "__main__":
    run_study(main)
