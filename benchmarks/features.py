"""The table of features: what works with one view, several, a free view and a sequence, each cell built.

`python -m benchmarks.features [--only ROW] [--column NAME] [--out DIR] [--write FILE.md]`
builds every cell with small pictures at sketch, looks into what was written for the thing asked
for, and prints the table. A cell either works or is refused with the physical reason. Ends with 1 if one
does neither. What is as it should be in DIR is not built again, so an interrupted run goes on where it was.
"""

from __future__ import annotations

import json
import os
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Literal

import trimesh
from PIL import Image, ImageDraw

import knotfab
from benchmarks.measurement import run_study

_PX = 160
_SEARCH = '[accuracy]\nname = "sketch"\n[search]\n'  # keys of a row's scene may follow


@dataclass(frozen=True)
class Found:
    """What a build left: its outcome, and the folder of its files."""

    outcome: knotfab.Outcome

    @property
    def report(self) -> dict[str, Any]:
        return self.outcome.report

    def files(self, pattern: str) -> list[Path]:
        return sorted(self.outcome.folder.glob(pattern))

    def check(self, name: str) -> list[str]:
        """Return the status of every check of that name."""
        return [c["status"] for c in self.report["checks"] if c["name"].split(" ")[0] == name]

    @property
    def scene(self) -> dict[str, Any]:
        path = next(iter(self.files("scene*.toml")))
        return tomllib.loads(path.read_text(encoding="utf-8"))

    @property
    def template(self) -> str:
        """What is known of where the knots, or those of the first frame, come from."""
        first = self.report["views"][0].get("certificate") or self.report["settings"]["certificate"]
        return str(first["template"])


@dataclass(frozen=True)
class Row:
    """A feature: keys of the scene, options of the call, and how it shows in what was written."""

    name: str
    page: str  # the page of docs/ where the feature is described
    shows: Callable[[Found], bool]
    scene: str = ""
    options: tuple[tuple[str, Any], ...] = ()
    passes: bool = True  # whether the build must end with 0; else its own limit may leave no room
    quickest: str = "one view"  # the column that the tests build
    refused: tuple[tuple[str, str], ...] = ()  # (column, words of the physical reason)
    lamps: tuple[tuple[str, Any], ...] = ()  # more options for coloured lamps


_BY_NETWORK = "carried along the invertible network"
COLUMNS = ("one view", "several views", "coloured lamps", "free view", "sequence")


def _is_mounted(kind: str) -> Callable[[Found], bool]:
    return lambda f: f.scene["mount"]["kind"] == kind and "fail" not in f.check("gap")


_ONE = "scenarios.md#one-picture-one-knot"
# radii that a column's strands keep to, where that leaves no room for all of the picture, mm
_BEND, _BENDS = 30.0, {"several views": 15.0, "sequence": 12.0, "coloured lamps": 8.0}
_DECIDED = tuple((c, "pictures decide the depth") for c in ("several views", "coloured lamps"))
ROWS: tuple[Row, ...] = (
    Row(
        "wall mount",
        "report.md#mounts",
        _is_mounted("wall"),
        options=(("mount", "wall"),),
        refused=(("several views", "light"), ("coloured lamps", "light")),
    ),
    Row("desk stand", "report.md#mounts", _is_mounted("stand"), options=(("mount", "stand"),)),
    Row(
        "eyelet for a thread",
        "report.md#mounts",
        _is_mounted("hang"),
        options=(("mount", "hang"),),
        # long rods join what the lamps hold apart, and hold thin strands too softly
        lamps=(("tube_radius", 2.0),),
    ),
    Row(
        "knot of a given type",
        _ONE,
        # in the longest of the knots, of which each lamp has its own
        lambda f: (any if len(f.scene["views"]) > 2 else all)(
            "3_1" in k["type"] for k in f.report["knots"]
        ),
        options=(("knot", "trefoil"), ("tube_radius", 2.0)),
    ),
    Row("network (inn)", _ONE, lambda f: _BY_NETWORK in f.template, options=(("search", "inn"),)),
    Row(
        "network, then flow (inn+flow)",
        _ONE,
        lambda f: _BY_NETWORK in f.template,
        options=(("search", "inn+flow"),),
    ),
    Row(
        "depth given",
        _ONE,
        lambda f: f.scene["piece"]["depth"] == 40.0,
        options=(("depth", 40),),
        refused=_DECIDED,
    ),
    Row(
        "flat",
        _ONE,
        lambda f: f.scene["piece"]["depth"] == "flat",
        options=(("depth", "flat"),),
        refused=_DECIDED,
    ),
    Row(
        "region mesh",
        "conventions.md#scenetoml-schema-1",
        lambda f: f.scene["region"]["kind"] == "mesh" and "fail" not in f.check("region"),
        '[region]\nkind = "mesh"\nfile = "region.stl"\n',
    ),
    Row(
        "time budget",
        "scenarios.md#how-well-and-how-long",
        lambda f: f.scene["search"]["fine_iterations"] != 30,
        options=(("time_budget", 40),),
    ),
    Row(
        "price of a limit",
        "report.md#search",
        lambda f: any("length" in price["limits"] for price in f.report.get("binding", ())),
        "[material]\nmax_length_mm = 260.0\n",
        passes=False,
    ),
    Row(
        "sparser filling",
        "report.md#search",
        lambda f: "binding" in f.report and "fail" not in f.check("bend") + f.check("clearance"),
        f"[material]\nmin_bend_radius_mm = {_BEND}\n",
        passes=False,
    ),
    Row(
        "slicing",
        "report.md#printing",
        lambda f: bool(f.check("slicer")) and "fail" not in f.check("slicer"),
        options=(("print", True), ("skip", ("shadow-render",))),
    ),
    Row(
        "repairs alone",
        _ONE,
        lambda f: (
            all(k["min_bend_radius_mm"] > 0 for k in f.report["knots"])
            and "fail" not in f.check("bend")
        ),
        "settle_iterations = 0",
    ),
    Row(
        "view found in the search",
        "scenarios.md#the-view-as-an-unknown",
        lambda f: (
            " ".join(repr(view["azimuth_deg"]) for view in f.scene["views"])
            != f.scene["search"]["free_azimuths_deg"]
            if len(f.scene["views"]) > 1
            else f.scene["views"][0]["light_distance_mm"] != f.scene["search"]["free_light_mm"] > 0
        ),
        options=(("free", "view"),),
        refused=(("coloured lamps", "the screen"),),
    ),
)


@dataclass(frozen=True)
class Cell:
    """One feature in one setting."""

    row: Row
    column: str

    @property
    def refusal(self) -> str | None:
        """Words of the physical reason for which this is refused; None: it is not."""
        return dict(self.row.refused).get(self.column)


CELLS = tuple(Cell(row, column) for row in ROWS for column in COLUMNS)


def draw_disc(middle: float = 0.5, size: float = 0.34) -> Image.Image:
    """Draw a disc with a notch, so that it is no circle: mode "L"."""
    image = Image.new("L", (_PX, _PX), 255)
    draw = ImageDraw.Draw(image)
    draw.ellipse([_PX * at for at in (middle - size, 0.16, middle + size, 0.84)], fill=0)
    draw.rectangle((0.46 * _PX, 0, 0.54 * _PX, 0.36 * _PX), fill=255)
    return image


def draw_house() -> Image.Image:
    """Draw a square with a roof, as high as the disc: mode "L"."""
    image = Image.new("L", (_PX, _PX), 255)
    corners = [(0.22, 0.84), (0.22, 0.42), (0.5, 0.16), (0.78, 0.42), (0.78, 0.84)]
    ImageDraw.Draw(image).polygon([(x * _PX, y * _PX) for x, y in corners], fill=0)
    return image


def draw_flag() -> Image.Image:
    """Draw a red disc beside a blue house: mode "RGB"."""
    image = Image.new("RGB", (_PX, _PX), "white")
    for shape, colour, left in ((draw_disc(), "red", 0), (draw_house(), "blue", 1)):
        small = shape.resize((_PX // 2, _PX // 2))
        image.paste(colour, (left * _PX // 2, _PX // 4), Image.eval(small, lambda v: 255 - v))
    return image


def _inputs(cell: Cell, folder: Path) -> tuple[list[str], dict[str, Any]]:
    """Return the pictures of a cell and the options of its build; its scene is written into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    text = cell.row.scene
    if "[region]" in text:
        wide = 300 if cell.column == "coloured lamps" else 150  # their pieces stand side by side
        trimesh.creation.box(extents=(wide, wide, 150)).export(folder / "region.stl")
    bend = _BENDS.get(cell.column, _BEND)
    text = text.replace(f"min_bend_radius_mm = {_BEND}", f"min_bend_radius_mm = {bend}")
    # the exact polygons decide about shadows: rendering them costs as much as all the rest
    options: dict[str, Any] = {"skip": ("slicer", "shadow-render"), **dict(cell.row.options)}
    if cell.column == "several views":
        drawn = [draw_disc(), draw_house()]
    elif cell.column == "coloured lamps":
        drawn = [draw_flag()]
        # each half as large as the others' pictures
        options |= {"lamps": "rgb", "size": 200, **dict(cell.row.lamps)}
    elif cell.column == "sequence":
        drawn = [draw_disc(0.48), draw_disc(0.5), draw_disc(0.52)]
        options["sequence"] = True
    else:
        drawn = [draw_disc()]
        if cell.column == "free view":
            options["free"] = "view"
    pictures = []
    for number, image in enumerate(drawn, start=1):
        pictures.append(str(folder / f"picture-{number:02d}.png"))
        image.save(pictures[-1])
    scene = folder / "asked.toml"
    scene.write_text(_SEARCH + text, encoding="utf-8")
    return pictures, {**options, "scene": scene}


def build_cell(cell: Cell, folder: Path) -> tuple[bool, str]:
    """Build a cell in `folder`: whether it is as it should be, and what it came to, in a few words."""
    pictures, options = _inputs(cell, folder)
    try:
        outcome = knotfab.build(pictures, folder / "out", **options)
    except knotfab.InputError as error:
        wanted = cell.refusal
        return wanted is not None and wanted in str(error), f"refused: {error}"
    except knotfab.MachineError as error:
        return False, str(error)
    except knotfab.SceneError as error:
        return False, str(error)
    if cell.refusal is not None:
        return False, "built, though it should be refused"
    report, code = outcome.report, outcome.exit_code
    failed = [c["name"] for c in report["checks"] if c["required"] and c["status"] == "fail"]
    ious = ", ".join(f"{view['iou']:.3f}" for view in report["views"] if view.get("iou"))
    said = f"exit {code}, IoU {ious or 'none'}" + (f", {failed}" if failed else "")
    return cell.row.shows(Found(outcome)) and (code == 0 or not cell.row.passes), said


Result = tuple[bool, str, str]  # whether a cell is as it should be, what it came to, and the day

_PAGE = """# What works with what

`make feature-table` builds every cell for this page: pictures of 160 px at sketch. Built {days}.
"Exit 1" means that the row's own limit leaves no room for the picture: the build has what the row asks
for, fails the check of the shadow, and says so.

{table}
"""


def _table(results: Mapping[Cell, Result]) -> str:
    """Return the table in Markdown, with the refusals' reasons below."""
    lines = ["| | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    notes: list[str] = []
    for row in ROWS:
        words = []
        for column in COLUMNS:
            if (result := results.get(Cell(row, column))) is None:
                words.append("not run")
                continue
            good, said = result[0], result[1].partition(". ")[0]  # without the remedy
            if good and said.startswith("refused"):
                notes += [] if said in notes else [said]
                words.append(f"{said.split(':')[0]} [{notes.index(said) + 1}]")
            elif good:
                words.append("works" if said.startswith("exit 0") else "exit 1")
            else:
                words.append(f"**FAILS**: {said}")
        lines.append(f"| [{row.name}]({row.page}) | " + " | ".join(words) + " |")
    return "\n".join([*lines, "", *(f"[{n}] {note}  " for n, note in enumerate(notes, start=1))])


def main(
    *,
    only: str | None = None,
    column: Literal[*COLUMNS] | None = None,
    out: Path | None = None,
    write: Path | None = None,
) -> int:
    """Build the cells, print each as it comes, then the table; 1 if one neither works nor is refused."""
    results: dict[Cell, Result] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for cell in CELLS:
            if (only and only not in cell.row.name) or (column and column != cell.column):
                continue
            name = f"{cell.row.name}-{cell.column}".replace(" ", "-")
            place = Path(os.path.abspath((out or Path(scratch)) / name))
            done = place / "done.json"
            if done.is_file():
                results[cell] = (True, *json.loads(done.read_text(encoding="utf-8")))
                continue
            good, said = build_cell(cell, place)
            results[cell] = good, said, date.today().isoformat()
            print(f"{'ok  ' if good else 'FAIL'} {name}: {said}", flush=True)
            if good:
                done.write_text(json.dumps(results[cell][1:]), encoding="utf-8")
    table = _table(results)
    print(f"\n{table}")
    if write:
        days = sorted({day for _, _, day in results.values()})
        built = "on " + days[0] if len(days) == 1 else f"from {days[0]} to {days[-1]}"
        write.write_text(_PAGE.format(days=built, table=table), encoding="utf-8")
    return int(not all(ok for ok, _, _ in results.values()))


if __name__ == "__main__":
    run_study(main)
