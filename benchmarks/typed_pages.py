"""Types the commands of README and of the tutorial as they stand there, in a copy of examples/.

A command that ends with another code than 0 fails, and so does a line that promises hours and grams which are
not within a tenth of what the command prints. The photograph that `knotfab compare` asks for is rendered from
the built shadow.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.measurement import run_study
from knotfab.apps.compare.rectify import homography
from knotfab.picture.read import read_target
from knotfab.report.drill_template import CARD_MM, MARK_RADII_MM, card_middles
from knotfab.scene.load import load_scene

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "docs/tutorial.md")
# the word, the report, and of the lines below it the hours and grams
PROMISE = re.compile(
    r"^ *pass +(?P<word>\S.*\S)  in .*: open (?P<report>\S+)\n"
    r"(?:.*\n)*?.* (?P<hours>[\d.]+) h, (?P<grams>\d+) g",
    re.M,
)
WITHIN = 0.1  # share by which printed hours and grams may differ
_PX_PER_MM = 4.0
# commands that never end, or only after many minutes: a page that waits for a browser, a measurement
_MORE = {"studio": ("--no-open",), "tradeoff": ("--time-limit", "1min", "--accuracy", "sketch")}
_STUDIO_S = 15.0


def commands_of(text: str) -> list[list[str]]:
    """Read the words of each `knotfab …` line in a page's blocks of shell commands, without comments."""
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("knotfab ")]


def take_photograph(folder: Path, path: Path) -> None:
    """Render a photograph, aslant, of the shadow of a folder's piece, with the four marks of setup.pdf.

    Where the piece is not built yet, its shadow is the picture.
    """
    scene = load_scene(folder / "scene.toml")
    view = scene.views[0]
    shadow = folder / f"shadow-{view.name}.png"
    asked = read_target(folder / view.picture).asked
    image = (
        Image.open(shadow).convert("L")
        if shadow.is_file()
        else Image.fromarray(~asked).convert("L")
    )
    assert view.frame_width_mm and view.frame_height_mm
    frame = view.frame_width_mm, view.frame_height_mm
    across, up = (round(_PX_PER_MM * side) for side in frame)
    border = round(_PX_PER_MM * (scene.mount.plate_margin_mm + 2 * CARD_MM))
    wall = Image.new("L", (across + 2 * border, up + 2 * border), 235)
    wall.paste(
        image.resize((across, up)).point(lambda grey: 90 + grey * 145 // 255), (border, border)
    )
    draw = ImageDraw.Draw(wall)
    held = scene.mount.asked and scene.mount.kind == "wall"
    for x, y in card_middles(frame, scene.mount.plate_margin_mm if held else 0.0):
        middle = border + _PX_PER_MM * x, border + _PX_PER_MM * y
        for radius, grey in zip(reversed(MARK_RADII_MM), (20, 235, 20), strict=True):
            draw.circle(middle, _PX_PER_MM * radius, fill=grey)
    wide, high = wall.size
    square = np.array([[0.0, 0.0], [wide, 0.0], [wide, high], [0.0, high]])
    aslant = square + np.array([[0, 0], [-0.03, 0.03], [0, -0.02], [0.02, 0]]) * wide
    way = homography(aslant, square)
    photo = wall.transform(
        wall.size, Image.Transform.PERSPECTIVE, (way / way[2, 2]).ravel()[:8], Image.Resampling.BICUBIC,
        fillcolor=235,
    )  # fmt: skip
    noise = np.random.default_rng(1).normal(0, 3, photo.size[::-1])
    Image.fromarray((np.asarray(photo) + noise).clip(0, 255).astype(np.uint8)).save(path)


def type_command(words: Sequence[str], folder: Path) -> tuple[int, str]:
    """Run a command in a folder as a person does; its exit code, and what it printed."""
    if words[0] == "compare":
        take_photograph(folder / words[2], folder / words[1])
    call = [sys.executable, "-m", "knotfab", *words, *_MORE.get(words[0], ())]
    quiet = {**os.environ, "BROWSER": "true"}
    limit = _STUDIO_S if words[0] == "studio" else None
    try:
        done = subprocess.run(
            call, cwd=folder, env=quiet, capture_output=True, text=True, timeout=limit, check=False
        )
    except subprocess.TimeoutExpired as ended:  # a page that was served all the time
        return 0, (ended.stdout or b"").decode()
    return done.returncode, done.stdout + done.stderr


def broken_promises(page: str, said: str) -> list[str]:
    """Return the lines of a page that promise more, or less, than what was printed for the same report."""
    printed = {found["report"]: found for found in PROMISE.finditer(said)}
    wrong = []
    for found in PROMISE.finditer(page):
        own = printed.get(found["report"])
        if own is None:
            continue
        near = all(
            abs(float(own[key]) / float(found[key]) - 1) <= WITHIN for key in ("hours", "grams")
        )
        if own["word"] != found["word"] or not near:
            told = [f"{one['word']}, {one['hours']} h, {one['grams']} g" for one in (found, own)]
            wrong.append(f"{told[0]} of {found['report']}: now {told[1]}")
    return wrong


def main(*, pages: str = " ".join(PAGES), only: str = "") -> int:
    """Type what stands in the pages, or what of it begins with `only`; 1 where anything fails."""
    failed = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(shutil.copytree(ROOT / "examples", Path(place) / "examples"))
        for page in pages.split():
            text = (ROOT / page).read_text("utf-8")
            for words in commands_of(text):
                if not " ".join(words).startswith(only):
                    continue
                began = time.perf_counter()
                code, said = type_command(words, folder)
                wrong = broken_promises(text, said)
                failed += code != 0 or bool(wrong)
                seconds = time.perf_counter() - began
                print(f"{code} {seconds:6.1f} s  {page}: knotfab {shlex.join(words)}", flush=True)
                print("\n".join([*(said.splitlines() if code else said.splitlines()[-1:]), *wrong]))
    return int(failed > 0)


if __name__ == "__main__":
    run_study(main)
