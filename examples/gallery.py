"""Ten pieces worth hanging: each built, drawn with its lamp off and on, with its hours and grams.

`python -m examples.gallery WORK docs` builds what WORK does not hold yet, and writes docs/gallery.md with its
pictures, docs/gallery/NAME.webp. What is sliced is kept in WORK as well, so that an interrupted run goes on.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image, ImageOps

import knotfab
from benchmarks.measurement import run_study
from examples.pictures import pictures
from knotfab.part.slicer import slice_part
from knotfab.part.slicer_process import Sliced
from knotfab.report.summary import tell_share
from knotfab.scene.load import load_scene

HEIGHT, WIDTH = 360, 1400  # px of a row of panels; of the page's pictures
PAPER, SHADOW = (250, 248, 244), (52, 49, 45)
SLICED, SLICING_S = "sliced.json", 3600.0  # the slicer has so long for one file


@dataclass(frozen=True)
class Piece:
    """What is built: pictures of `examples.pictures` or `text:…`, options as the command line has them."""

    name: str
    title: str
    sources: tuple[str, ...]
    options: str = ""


PIECES = (
    Piece("floral-heart", "Floral heart", ("text:❦",)),
    Piece("cat", "A cat", ("cat",)),
    Piece("knight", "A knight", ("knight",)),
    Piece("queen", "A queen", ("text:♛",)),
    Piece("teapot", "A teapot", ("teapot",)),
    Piece("flower", "A flower of open petals", ("text:❀",)),
    Piece("anchor", "An anchor", ("anchor",)),
    Piece("yin-yang", "Yin and yang", ("text:☯",)),
    Piece("trefoil-heart", "A trefoil, a heart", ("heart",), "--knot trefoil"),
    Piece("king-and-knight", "King and knight, at right angles", ("text:♚", "knight"), "--mount stand"),
)  # fmt: skip


def main(work: Path, docs: Path, /, *, only: str = "") -> None:
    """Build the pieces that `work` does not hold, or those whose names `only` lists, and write the page."""
    drawn = work / "pictures"
    drawn.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures().items():
        picture.save(drawn / f"{name}.png")
    for piece in PIECES:
        out = work / piece.name
        asked = piece.name in only.split(",") if only else True
        if asked and (only or not (out / "report.json").is_file()):
            print(piece.name, flush=True)
            _build(piece, drawn, out)
    for piece in PIECES:
        if (work / piece.name / "report.json").is_file():
            _slice(work / piece.name)
    (docs / "gallery").mkdir(exist_ok=True)
    (docs / "gallery.md").write_text("".join(_page(work, docs / "gallery")), encoding="utf-8")


def _files(piece: Piece, folder: Path) -> list[str]:
    return [s if s.startswith("text:") else str(folder / f"{s}.png") for s in piece.sources]


def _build(piece: Piece, drawn: Path, out: Path) -> None:
    words = shlex.split(piece.options)
    given: dict[str, Any] = {
        name.removeprefix("--").replace("-", "_"): value
        for name, value in zip(words[::2], words[1::2], strict=True)
    }
    if "size" in given:
        given["size"] = float(given["size"])
    outcome = knotfab.build(_files(piece, drawn), out, print_=True, skip="slicer", **given)
    if outcome.exit_code:
        print(f"  exit code {outcome.exit_code}: see {outcome.folder}", flush=True)


def _slice(folder: Path) -> None:
    """Have PrusaSlicer slice what is printed, however long it takes, and keep its hours and grams."""
    kept = folder / SLICED
    if kept.is_file():
        return
    scene = load_scene(folder / "scene.toml")
    one = slice_part(folder / "part.3mf", scene, folder, SLICING_S)
    if isinstance(one, Sliced):
        kept.write_text(json.dumps({"hours": one.time_s / 3600, "grams": one.filament_g}))


def _page(work: Path, pictures_to: Path) -> Iterable[str]:
    yield (
        "# Ten pieces worth hanging\n\n"
        "`make gallery` builds them and draws this page: shadows of the written files, then the piece by\n"
        "day, from the door and from where it tells most of its picture (told, 0 to 1), and with its lamp\n"
        "on. Most print with supports off, in roots, or in a plate where roots would tell the picture;\n"
        "the others take the slicer's. Hours and grams are\n"
        "PrusaSlicer's for the default printer (Prusa MK4, PLA). Glyphs are those of DejaVu Sans; the other\n"
        "pictures are drawn by `examples/pictures.py`, which writes them as files:\n"
        "`python examples/pictures.py FOLDER`.\n"
    )
    for piece in PIECES:
        folder = work / piece.name
        sources = [s if s.startswith("text:") else f"{s}.png" for s in piece.sources]
        call = " ".join(["knotfab build", *sources, "--print", *piece.options.split()])
        if not (folder / "report.json").is_file():
            yield f"\n## {piece.title}\n\n`{call}`\n"
            continue
        report = json.loads((folder / "report.json").read_text("utf-8"))
        name = f"{piece.name}.webp"
        _draw(folder, report).save(pictures_to / name, quality=80, method=6)
        alt = f"{piece.title}: its shadow, and the piece with its lamp off and on"
        yield f"\n## {piece.title}\n\n![{alt}](gallery/{name})\n\n"
        yield f"`{call}`: {_facts(report, folder / SLICED)}.\n"


def _facts(report: dict[str, Any], sliced: Path) -> str:
    made, views = report["print"], report["views"]
    alike = " and ".join(tell_share(view.get("iou_frame") or view["iou"]) for view in views)
    size = " × ".join(f"{s:.0f}" for s in made["bounding_box_mm"])
    knots = len(report["knots"])
    told = [f"{alike} alike", f"{size} mm", f"{knots} knot{'s' * (knots > 1)}"]
    seen = max((v["told"]["worst"]["share"] for v in views if v.get("told")), default=None)
    told += [] if seen is None else [f"told {seen:.2f}"]
    if sliced.is_file():
        figures = json.loads(sliced.read_text("utf-8"))
        told.append(f"{figures['hours']:.1f} h, {figures['grams']:.0f} g")
    return ", ".join(told)


def _draw(folder: Path, report: dict[str, Any]) -> Image.Image:
    """Draw the shadows as their lamps throw them, then the piece, lamp off and lamp on, in a row."""
    row = []
    for view in report["views"]:
        soft = folder / f"soft-{view['name']}.png"
        path = soft if soft.is_file() else folder / f"shadow-{view['name']}.png"
        wall = ImageOps.colorize(Image.open(path).convert("L"), SHADOW, PAPER)
        row.append(ImageOps.pad(wall, (HEIGHT, HEIGHT), color=PAPER))
    for name in ("unlit.png", "piece.png"):
        if (folder / name).is_file():
            part = Image.open(folder / name).convert("RGB")
            row.append(part.resize((round(part.width * HEIGHT / part.height), HEIGHT)))
    sheet = Image.new("RGB", (sum(p.width for p in row), HEIGHT), PAPER)
    left = 0
    for one in row:
        sheet.paste(one, (left, 0))
        left += one.width
    return sheet.resize((WIDTH, round(HEIGHT * WIDTH / sheet.width)), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    run_study(main)
