"""Build a table of pictures by settings, each as a process of its own, and print what they reach.

`python -m benchmarks.build_table TABLE [PICTURE ...] [--settings NAME ...] [--accuracy NAME] [--out DIR]
[--before CHECKOUT] [--sheet FILE.png]`, where TABLE is one of TABLES below: a row for each picture and
setting, then the means, and for further settings the ratio to the first, picture by picture. A PICTURE such
as heart+teapot is one part of two views, and heart+teapot@eye one that is looked at. With --out, what is done
is not built again. With --before, another checkout builds the first setting as well; ratios are to that.
`--sheet` draws pictures beside their shadows.
"""

from __future__ import annotations

import json
import statistics
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import run
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.measurement import (
    Stopwatch,
    build_apart,
    failed_checks,
    make_folder,
    mean_bend,
    read_report,
    run_study,
)
from benchmarks.on_paper import draw_photographs
from benchmarks.small_pictures import line_pictures, small_pictures
from examples.lamps.draw import PICTURES as COLOURED
from examples.pictures import pictures
from knotfab.design.survey import GUESSED, TOLD_NEAR
from knotfab.picture.source import TEXT_PREFIX
from knotfab.pipeline.finish import SAME_TUBE
from paper.pictures import PUBLISHED, paper_pictures

Report = Mapping[str, Any]
Row = dict[str, float | str]
_EYE, _BEFORE = "@eye", "before"
_WIDE_LOSS = 1.5  # tube diameters: a lost piece or hole wider than this could have been drawn


def _worst(key: str) -> Callable[[Report], float]:
    return lambda report: min(float(view[key]) for view in report["views"])


def _drawn(report: Report) -> float:
    """Give the worst view's IoU with what was drawn: with the picture as it was bent."""
    return min(float(view.get("iou_drawn", view["iou"])) for view in report["views"])


def count_lost(view: Mapping[str, Any]) -> int:
    """Count the pieces and holes that a view lost though the tube was thin enough for them."""
    return sum(
        loss["size_mm"] > _WIDE_LOSS * loss["needed_mm"]
        for loss in view["verdict"]["lost"]
        if loss["what"] in ("piece", "hole")
    )


def _mount(report: Report) -> Mapping[str, Any]:
    return report["print"].get("mount") or {"kind": "none"}


def _holder(report: Report) -> str:
    mount = _mount(report)
    return "-".join(filter(None, [mount["kind"], mount.get("plate") or mount.get("foot")]))


def _knot(report: Report) -> str:
    check = next(c for c in report["checks"] if c["name"] == "knot_type")
    return f"{check['measured']} ({check['status']})"


def _sliced(key: str, per: float = 1.0) -> Callable[[Report], float]:
    return lambda report: float(report["print"].get(key, float("nan"))) / per


COLUMNS: dict[str, Callable[[Report], float | str]] = {
    "word": lambda r: (r.get("verdict") or {}).get("word", "-"),
    "iou": _worst("iou"),
    "iou_tube": _worst("iou_tube"),
    "iou_frame": _worst("iou_frame"),
    "drawn": _drawn,
    "bound": lambda r: min(view.get("bound", 1.0) for view in r["views"]),
    "lost": lambda r: sum(map(count_lost, r["views"])),
    "p95_radii": lambda r: r["verdict"]["outline_p95_radii"],
    "radius_mm": lambda r: r["settings"]["tube_radius_mm"],
    "depth": lambda r: r["print"]["depth_ratio"],
    "told": lambda r: r["views"][0]["told"]["worst"]["share"],
    "door": lambda r: r["views"][0]["told"]["door"],
    "specks": lambda r: float(r["verdict"]["specks"]),
    "bars": lambda r: float((r["print"].get("bars") or {"count": 0})["count"]),
    "bend": mean_bend,
    "turns": lambda r: sum(k["turns"] for k in r["knots"]),
    "length_mm": lambda r: sum(k["length_mm"] for k in r["knots"]),
    "knots": lambda r: len(r["knots"]),
    "knot": _knot,
    "holder": _holder,
    "sag_mm": lambda r: _mount(r).get("sag_mm") or 0.0,
    "tip_deg": lambda r: _mount(r).get("tip_deg") or float("nan"),
    "grams": _sliced("filament_g"),
    "support_g": _sliced("support_g"),
    "hours": _sliced("time_s", 3600),
    "colours": lambda r: r["colours"]["share"],
    "inside": lambda r: r["colours"]["share_inside"],
    "moved": lambda r: r["colours"]["misregistration"]["share"],
    "delta_e": lambda r: r["colours"]["delta_e"],
    "failed": lambda r: " ".join(failed_checks(r)) or "-",
    "published": lambda r: PUBLISHED[r["title"]],
    "warned": lambda r: float(any("preview" in told for told in r.get("warnings") or ())),
}
"""What is read from report.json, by the column's name."""
# columns that come from the build's process, and from that of a preview: its seconds and what it promises
PROMISES = (
    "preview_s",
    "said_holder",
    "said_mm",
    "said_g",
    "said_h",
    "said_told",
    "g_off",
    "h_off",
    "same",
)
PROCESS = ("code", "cpu_s", "wall_s", "peak_mb", *PROMISES)


def draw_sets(seed: int = 39) -> dict[int, list[str]]:
    """Draw 12 pairs, 8 triples and 2 sets of four of the project's pictures, and 5 alone; no set twice."""
    pick, names = np.random.default_rng(seed), list(pictures())
    found: dict[int, list[str]] = {}
    for many, count in {2: 12, 3: 8, 4: 2, 1: 5}.items():
        sets: list[str] = []
        while len(sets) < count:
            drawn = "+".join(pick.choice(names, many, replace=False))
            if sorted(drawn.split("+")) not in [sorted(s.split("+")) for s in sets]:
                sets.append(drawn)
        found[many] = sets
    return found


NAMED = (
    "heart+teapot",
    "cat+bird",
    "knight+face",
    f"heart+teapot{_EYE}",
    "heart+face+teapot",
    "knight+cat+bird",
    "anchor+wheel+plane",
)
SMALL = (
    "otter+snowflake",
    "owl+knight",
    "whiskers+bird",
    "alps+heart",
    "ship+anchor",
    "crown+face",
)
KNOTS = ("3_1", "left 3_1", "4_1", "5_1", "5_2", "6_1", "6_2", "6_3", "7_1", "7_4", "8_18", "8_19")


# words, and photographs of drawings on paper, of which previews are known to promise less well
WORDS = ("LOVE", "Hello", "42", "Anna", "Yes!", "&")
ON_PAPER = ("felt-tip, falling light, cloud", "print, lined, leaf", "wash, phone, pear")


def _promised() -> list[str]:
    return [*pictures(), *(TEXT_PREFIX + word for word in WORDS), *ON_PAPER]


def _several() -> list[str]:
    drawn = draw_sets()
    return [*drawn[1], *NAMED, *drawn[2], *drawn[3], *drawn[4], *SMALL]


@dataclass(frozen=True)
class Table:
    """Pictures by settings: every picture is built with the options of every setting."""

    columns: tuple[str, ...]
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: {"default": ()})
    names: Callable[[], list[str]] = lambda: list(pictures())
    options: tuple[str, ...] = ("--print",)  # of every build


_UNSLICED = ("--print", "--skip", "slicer")
_PLAIN = ("--skip", "slicer")
TABLES = {
    "accuracy": Table(
        (*PROCESS, "iou", "p95_radii", "radius_mm", "depth", "told", "bend", "turns", "failed"),
        options=_UNSLICED,
    ),
    "accuracies": Table(
        ("code", "cpu_s", "wall_s", "word", "iou"),
        {name: ("--accuracy", name) for name in ("sketch", "draft", "standard", "fine")},
        lambda: ["knight", "anchor", "cat", "teapot"],
        _PLAIN,
    ),
    "budgets": Table(
        ("code", "wall_s", "word", "iou"),
        {f"{s} s": ("--time-budget", f"{s}s") for s in (5, 10, 20, 40, 80)},
        lambda: ["knight", "smiley", "anchor", "cat", "wheel", "bicycle"],
        _PLAIN,
    ),
    "mounts": Table(
        ("code", "holder", "word", "iou_tube", "iou_frame", "sag_mm", "tip_deg", "cpu_s", "failed"),
        {
            "auto": (),
            "wall": ("--mount", "wall"),
            "stand": ("--mount", "stand"),
            "hang": ("--mount", "hang"),
        },
        options=_UNSLICED,
    ),
    "promises": Table(
        (
            "code",
            "holder",
            "said_holder",
            "radius_mm",
            "said_mm",
            "grams",
            "said_g",
            "g_off",
            "hours",
        )
        + ("said_h", "h_off", "told", "said_told", "preview_s", "same", "warned"),
        names=_promised,
    ),
    "supports": Table(
        ("code", "cpu_s", "holder", "grams", "support_g", "hours", "said_g", "said_h")
        + ("told", "door", "bars", "specks", "word", "iou", "failed")
    ),
    "knots": Table(
        ("code", "cpu_s", "knot", "iou", "length_mm"),
        {"unknot": ()} | {name: ("--knot", name) for name in KNOTS},
        lambda: ["knight"],
        _PLAIN,
    ),
    "several": Table(
        ("code", "cpu_s", "word", "drawn", "bound", "lost", "knots", "radius_mm", "bend"),
        names=_several,
        options=_PLAIN,
    ),
    "paper": Table(
        ("code", "iou", "published", "failed", "wall_s"),
        names=lambda: list(PUBLISHED),
        options=_PLAIN,
    ),
    "lamps": Table(
        ("code", "cpu_s", "word", "colours", "inside", "moved", "delta_e", "iou", "knots"),
        names=lambda: list(COLOURED),
        options=(*_PLAIN, "--lamps", "rgb"),
    ),
}


def draw_picture(name: str) -> Image.Image:
    """Draw a picture of the project's own by its name.

    Raises:
        KeyError: there is none of that name.
    """
    if name in COLOURED:
        return COLOURED[name]()
    if "," in name:
        return next(drawn for named, drawn, _ in draw_photographs(name) if named == name)
    if name in (drawn := pictures()):
        return drawn[name]
    return (paper_pictures() if name in PUBLISHED else small_pictures() | line_pictures([name]))[
        name
    ]


def build_row(
    name: str, setting: str, options: tuple[str, ...], folder: Path, checkout: Path | None = None
) -> tuple[Row, Path]:
    """Build a picture, or several joined by +, unless that is done: what it took, and its files' folder."""
    folder = folder.resolve()
    place = folder / f"{name}-{setting}".replace(" ", "-")
    kept = place.with_name(f"{place.name}.json")
    if not kept.is_file():
        files = write_pictures(name, folder)
        if name.endswith(_EYE):
            scene = folder / "by-eye.toml"
            views = (
                f'[[views]]\nname = "{n}"\nkind = "eye"\nazimuth_deg = {90 * k}'
                for k, n in enumerate("ab")
            )
            scene.write_text("schema = 1\n" + "\n".join(views))
            files += ["--scene", str(scene)]
        more = [*files[1:], *options]
        built = build_apart(files[0], place, *more, printing=False, checkout=checkout)
        took = {"code": built.code, "cpu_s": built.cpu_s, "wall_s": built.wall_s}
        said = " ".join(built.said.split())[:300]
        kept.write_text(json.dumps({**took, "peak_mb": built.peak_mb, "said": said}))
    row: Row = json.loads(kept.read_text())
    return row, place if row["code"] == 0 else place / "rejected"


def write_pictures(name: str, folder: Path) -> list[str]:
    """Write the pictures of a row unless they are there, and return their files; a text is its own."""
    files = []
    for one in name.removesuffix(_EYE).split("+"):
        path = folder / f"{one}.png"
        if not one.startswith(TEXT_PREFIX) and not path.is_file():
            draw_picture(one).save(path)
        files.append(one if one.startswith(TEXT_PREFIX) else str(path))
    return files


def ask_preview(files: list[str], options: tuple[str, ...]) -> Row:
    """Return what a preview promises of a build, and its CPU seconds; no promise where it refuses."""
    asked = [word for word in options if word not in _UNSLICED]
    with TemporaryDirectory() as place:
        call = [sys.executable, "-m", "knotfab", "preview", *files, *asked, "--json"]
        watch = Stopwatch()
        done = run([*call, "--out", f"{place}/out.png"], capture_output=True, text=True)
        row: Row = {"preview_s": watch.children_s}
    if done.returncode:
        return row
    told = json.loads(done.stdout)
    row |= {"said_holder": told["holder"], "said_mm": told["tube_radius_mm"]}
    guess = {"said_told": told["guess"]["told"]} if told["guess"]["told"] else {}
    return row | guess | {"said_g": told["guess"]["mass_g"], "said_h": told["guess"]["hours"]}


def compare_promise(promise: Row, report: Report | None) -> Row:
    """Return by how much grams and hours are off, and whether all that was promised is what came.

    Nothing is promised of what an unlit piece tells where builds differ too much.
    """
    if report is None or "said_g" not in promise:
        return {}
    came = read_row(("grams", "hours", "radius_mm", "told"), {}, report)
    pairs = (
        ("g_off", "said_g", "grams"),
        ("h_off", "said_h", "hours"),
        ("", "said_mm", "radius_mm"),
    )
    off = {k: float(promise[said]) / float(came[had]) - 1 for k, said, had in pairs if had in came}
    plate = (report["print"].get("mount") or {}).get("plate") or "none"
    same = plate in str(promise["said_holder"]) and abs(off.pop("", 0.0)) <= SAME_TUBE
    told = abs(float(promise.get("said_told", "nan")) - float(came.get("told", "nan")))
    same &= not told > TOLD_NEAR
    return {**off, "same": float(same and all(abs(one) <= GUESSED - 1 for one in off.values()))}


def read_row(columns: tuple[str, ...], row: Row, report: Report | None) -> Row:
    """Return the values of a table's columns; those that a report lacks are left out."""
    found: Row = {}
    for column in columns:
        if column in PROCESS:
            found |= {column: row[column]} if column in row else {}
        elif report is not None:
            try:
                found[column] = COLUMNS[column](report)
            except (KeyError, StopIteration, TypeError):
                continue
    return found


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}" if value == value else "-"


def summarize(rows: Mapping[str, Mapping[str, Row]]) -> Iterator[str]:
    """Yield each setting's means, and its ratios to the first setting over the pictures that both have.

    Args:
        rows: by setting, then by picture.
    """
    first = next(iter(rows.values()), {})
    for setting, own in rows.items():
        keys = dict.fromkeys(key for row in own.values() for key in row)
        numbers = {
            key: [
                v for row in own.values() if isinstance(v := row.get(key), float | int) and v == v
            ]
            for key in keys
        }
        means = [
            f"{k} {statistics.mean(v):.4g} (median {statistics.median(v):.4g}, {min(v):.4g} to {max(v):.4g})"
            for k, v in numbers.items()
            if v
        ]
        yield f"{setting}, {len(own)} built: {'; '.join(means)}"
        ratios = []
        for key in numbers:
            pairs = [(row.get(key), first.get(name, {}).get(key)) for name, row in own.items()]
            found = [
                a / b
                for a, b in pairs
                if isinstance(a, float) and isinstance(b, float) and b and a == a
            ]
            if found and own is not first:
                ratios.append(f"{key} {statistics.mean(found):.3f} (at most {max(found):.3f})")
        if ratios:
            yield f"  beside the first setting: {'; '.join(ratios)}"


def draw_sheet(built: Mapping[str, Path], path: Path, wide: int = 300, across: int = 5) -> None:
    """Draw what was built, several in a row: each picture beside its shadow, under its name and word."""
    cards = []
    for name, folder in built.items():
        report = read_report(folder) or {"views": []}
        files = [folder / f"compare-{view['name']}.png" for view in report["views"]]
        files = [f for f in [folder / "compare-colours.png", *files] if f.is_file()][:4]
        images = [Image.open(file).convert("RGB") for file in files]
        images = [i.resize((wide, round(i.height * wide / i.width))) for i in images]
        card = Image.new("RGB", (wide + 8, 22 + sum(i.height for i in images)), "white")
        word = (report.get("verdict") or {}).get("word", "none")
        ImageDraw.Draw(card).text((6, 4), f"{name}: {word}", fill="black")
        top = 18
        for image in images:
            card.paste(image, (4, top))
            top += image.height
        cards.append(card)
    rows = [cards[k : k + across] for k in range(0, len(cards), across)]
    high = [max(card.height for card in row) for row in rows]
    sheet = Image.new("RGB", (max(map(len, rows)) * (wide + 8), sum(high)), "white")
    for number, row in enumerate(rows):
        for k, card in enumerate(row):
            sheet.paste(card, (k * card.width, sum(high[:number])))
    sheet.quantize(64, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


def main(
    table: str,
    *names: str,
    settings: tuple[str, ...] = (),
    accuracy: str | None = None,
    out: Path | None = None,
    before: Path | None = None,
    sheet: Path | None = None,
) -> int:
    """Print the table and its summary; 1 if a build failed."""
    if table not in TABLES:
        raise SystemExit(f"{table}: there is no such table. Use one of {', '.join(TABLES)}")
    asked, folder = TABLES[table], make_folder(out, table)
    chosen = {key: asked.settings[key] for key in settings or asked.settings}
    more = () if accuracy is None else ("--accuracy", accuracy)
    if before is not None:
        chosen = {_BEFORE: next(iter(chosen.values())), **chosen}
    rows: dict[str, dict[str, Row]] = {key: {} for key in chosen}
    made: dict[str, Path] = {}
    print("picture", "setting", *asked.columns, sep="  ")
    for name in names or asked.names():
        for key, options in chosen.items():
            checkout = before if key == _BEFORE else None
            how = (*asked.options, *options, *more)
            row, place = build_row(name, key, how, folder, checkout)
            report = read_report(place)
            if checkout is None and not {*PROMISES}.isdisjoint(asked.columns):
                promise = ask_preview(write_pictures(name, folder), how)
                row = {**row, **promise, **compare_promise(promise, report)}
            found = read_row(asked.columns, row, report)
            rows[key][name] = found
            made[name if len(chosen) == 1 else f"{name}, {key}"] = place
            told = "" if report else f"  {row['said']}"
            print(f"{name}  {key}  {'  '.join(map(_cell, found.values()))}{told}", flush=True)
    print("", *summarize(rows), sep="\n", flush=True)
    if sheet is not None:
        draw_sheet(made, sheet)
    return int(any(row["code"] != 0 for own in rows.values() for row in own.values()))


if __name__ == "__main__":
    run_study(main)
