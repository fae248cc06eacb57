"""Several pictures in one part: what each build reached, the hull's bound, the bending and the time.

`python -m benchmarks.several_table --out DIR`: builds sets of the project's own pictures with the command's
own options: the named ones; 12 pairs, 8 triples and 2 sets of four that a fixed seed draws; six pairs with
small parts, such as eyes and letters; and some pictures alone, whose median time is the unit of the others'.
Prints a line a view, with the pieces and holes wider than 1.5 tube diameters that are lost and how far the
shadow stands out, and a line a set, and sums up what is drawn. What is built already is not built again.
`--only NAME` builds one set (any of the pictures' names, joined by -; `line_pictures` has lines, as in
brow5-nose5-chin5); `--picture FILE` draws it. The sets
that the seed drew and the six pairs are drawn into DIR/several-N.png and several-small.png, picture beside
shadow.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt

from benchmarks.measurement import build_once, make_folder, run_study, save_pictures, stack
from benchmarks.small_pictures import line_pictures, small_pictures
from examples.pictures import pictures
from knotfab.render.part_picture import PAPER, draw_part, turn_eye

_WIDE = 760  # pixels of a comparison
_SMALL = 300  # px: the longer side of a picture on a sheet of many
_SEED, _DRAWN = 39, {2: 12, 3: 8, 4: 2}  # sets of so many pictures
_ALONE = 5  # pictures built alone
_EYE = "-by-eye"
_GOOD = ("faithful", "good")
_WIDE_LOSS = 1.5  # tube diameters: a lost piece or hole wider than this could have been drawn

NAMED = (
    "heart-teapot",
    "cat-bird",
    "knight-face",
    f"heart-teapot{_EYE}",
    "heart-face-teapot",
    "knight-cat-bird",
    "anchor-wheel-plane",
)

SMALL = (
    "otter-snowflake",
    "owl-knight",
    "whiskers-bird",
    "alps-heart",
    "ship-anchor",
    "crown-face",
)


def draw_sets() -> dict[int, list[str]]:
    """Draw the sets that the seed draws, by how many pictures they have, and those alone; no set twice."""
    pick, names = np.random.default_rng(_SEED), list(pictures())
    found: dict[int, list[str]] = {}
    for many, count in {**_DRAWN, 1: _ALONE}.items():
        sets: list[str] = []
        while len(sets) < count:
            drawn = "-".join(pick.choice(names, many, replace=False))
            sets += (
                [drawn]
                if sorted(drawn.split("-")) not in [sorted(s.split("-")) for s in sets]
                else []
            )
        found[many] = sets
    return found


def build_set(name: str, folder: Path) -> dict[str, Any]:
    """Build a set into `folder`/NAME, where that is not done yet: code, seconds, what was said, report."""
    names = name.removesuffix(_EYE).split("-")
    first, *more = (str(folder / f"{n}.png") for n in names)
    if not (folder / f"{name}.json").is_file():
        save_pictures(pictures() | small_pictures() | line_pictures(names), folder, names)
    if name.endswith(_EYE):
        scene = folder / "by-eye.toml"
        views = (
            f'[[views]]\nname = "{n}"\nkind = "eye"\nazimuth_deg = {90 * k}'
            for k, n in enumerate("ab")
        )
        scene.write_text("schema = 1\n" + "\n".join(views))
        more += ["--scene", str(scene)]
    return build_once(first, folder / name, *more)


def draw_part_between(folder: Path, scratch: Path) -> Image.Image:
    """Draw the part of a build from the direction midway between its first two views."""
    mesh = trimesh.load_mesh(folder / "part.stl")
    with (folder / "scene.toml").open("rb") as file:
        scene = tomllib.load(file)
    pose = np.array(scene["pose"]["matrix"])
    points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    between = 0.5 * float(scene["views"][1]["azimuth_deg"])
    draw_part(points, mesh.faces, scratch, turn_eye((0.0, 0.0, 500.0), (between,)))
    image = Image.open(scratch).convert("RGB")
    scratch.unlink()
    return image


def draw_case(folder: Path, names: list[str], path: Path) -> None:
    """Draw each target with its verified shadow, and the part from the direction midway between the views."""
    panels = [Image.open(folder / f"compare-{name}.png").convert("RGB") for name in names]
    side = draw_part_between(folder, path.with_suffix(".part.png"))
    drawn = stack(panels, _WIDE, PAPER)
    beside = min(drawn.height, _WIDE)
    page = Image.new("RGB", (_WIDE + beside, drawn.height), PAPER)
    page.paste(drawn, (0, 0))
    page.paste(side.resize((beside, beside)), (_WIDE, (drawn.height - beside) // 2))
    page.quantize(128, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


def _views_of(built: dict[str, Any]) -> list[dict[str, Any]]:
    return built["report"]["views"] if built["report"] else []


def _draw_sheet(sets: list[tuple[str, dict[str, Any]]], path: Path) -> None:
    """Draw all sets of one size, five in a row: each picture beside its shadow, and the verdict's word."""
    cards = []
    for name, built in sets:
        files = [built["folder"] / f"compare-{view['name']}.png" for view in _views_of(built)]
        if files and all(file.is_file() for file in files):
            card = stack([Image.open(f).convert("RGB") for f in files], _SMALL, PAPER)
            page = Image.new("RGB", (_SMALL + 8, card.height + 22), PAPER)
            page.paste(card, (4, 18))
            ImageDraw.Draw(page).text((6, 4), f"{name}: {_word(built)}", fill=(40, 40, 40))
            cards.append(page)
    rows = [cards[k : k + 5] for k in range(0, len(cards), 5)]
    high = [max(card.height for card in row) for row in rows]
    if not rows:
        return
    sheet = Image.new("RGB", (len(rows[0]) * (_SMALL + 8), sum(high)), PAPER)
    for number, row in enumerate(rows):
        for k, card in enumerate(row):
            sheet.paste(card, (k * card.width, sum(high[:number])))
    sheet.quantize(64, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


def _word(built: dict[str, Any]) -> str:
    return str(built["report"]["verdict"]["word"]) if built["report"] else "none"


def _drawn(built: dict[str, Any]) -> list[float]:
    """Give the IoU of each view with what was drawn: with the picture as it was bent."""
    return [float(view.get("iou_drawn", view["iou"])) for view in _views_of(built)]


def count_lost(view: dict[str, Any]) -> int:
    """Count the pieces and holes that a view lost though the tube was thin enough for them."""
    return sum(
        loss["size_mm"] > _WIDE_LOSS * loss["needed_mm"]
        for loss in view["verdict"]["lost"]
        if loss["what"] in ("piece", "hole")
    )


def measure_knob(folder: Path, view: dict[str, Any]) -> float:
    """Return how far a view's shadow stands out of the picture as it was drawn, in tube radii."""
    verdict, name = view["verdict"], view["name"]
    drawn = folder / f"drawn-{name}.png"
    shadow, wanted = (
        np.pad(np.asarray(Image.open(file).convert("L")) < 128, 64)
        for file in (
            folder / f"shadow-{name}.png",
            drawn if drawn.is_file() else folder / f"picture-{name}.png",
        )
    )
    radii = verdict["outline_p95_radii"] / max(verdict["outline_p95_mm"], 1e-9)
    with (folder / "scene.toml").open("rb") as file:
        views = {v["name"]: v for v in tomllib.load(file)["views"]}
    pixel_mm = views[name]["frame_width_mm"] / (shadow.shape[1] - 128)
    return float(distance_transform_edt(~wanted)[shadow].max(initial=0.0) * pixel_mm * radii)


def _print_set(name: str, built: dict[str, Any], unit_s: float) -> None:
    for view, drawn in zip(_views_of(built), _drawn(built), strict=True):
        bent = view.get("bending") or {}
        moved = f"bent {100 * bent.get('rms', 0.0):4.1f} %, {100 * bent.get('most', 0.0):4.1f} % at most"
        print(
            f"  {name:28} {view['name']:10} {view['kind']:6} IoU {view['iou']:.4f}  drawn {drawn:.4f}  "
            f"bound {view.get('bound', 1.0):.4f}  {moved}  {count_lost(view)} lost, "
            f"out by {measure_knob(built['folder'], view):.2f} radii"
        )
    report = built["report"]
    told = built["said"]
    if report:
        bends = max(knot["mean_curvature_radii"] for knot in report["knots"])
        told = "; ".join(report["verdict"]["reasons"][:3])
        radius = report["settings"]["tube_radius_mm"]
        told = (
            f"{len(report['knots'])} knots, radius {radius:.2f} mm, curvature {bends:.2f}; {told}"
        )
    times = built["cpu_s"] / unit_s if unit_s else float("nan")
    print(
        f"{name:30} code {built['code']} {_word(built):9} {built['cpu_s']:5.1f} CPU s ({times:.1f}x)  {told}",
        flush=True,
    )


def _print_sum(kind: str, sets: list[dict[str, Any]], unit_s: float) -> None:
    words = [_word(s) for s in sets]
    drawn = [min(_drawn(s)) for s in sets if _drawn(s)]
    every = [iou for s in sets for iou in _drawn(s)]
    ended = sum(s["code"] == 0 for s in sets)
    lost = sum(count_lost(view) for s in sets for view in _views_of(s))
    good, faithful = sum(w in _GOOD for w in words), words.count("faithful")
    mean = float(np.mean(every)) if every else 0.0
    times = np.median([s["cpu_s"] for s in sets]) / unit_s
    print(
        f"{len(sets)} sets {kind}: {ended} end with 0, {good} good or better, {faithful} faithful; of "
        f"what was drawn worst {min(drawn, default=0.0):.4f}, mean {mean:.4f}; {times:.1f}x the time of one; "
        f"{lost} pieces or holes lost that the tube could draw"
    )


def main(*, out: Path | None = None, only: str = "", picture: Path | None = None) -> None:
    """Build, print the table and draw the sheets."""
    if picture and not only:
        raise SystemExit("--picture draws one set: name it with --only")
    folder = make_folder(out, "several")
    if only:
        built = build_set(only, folder)
        _print_set(only, built, 0.0)
        if picture:
            draw_case(built["folder"], [view["name"] for view in _views_of(built)], picture)
        return
    drawn = draw_sets()
    unit_s = float(np.median([build_set(name, folder)["cpu_s"] for name in drawn.pop(1)]))
    print(f"one picture takes {unit_s:.1f} CPU s (median)", flush=True)
    for name in NAMED:
        _print_set(name, build_set(name, folder), unit_s)
    kinds = {str(many): (f"of {many}", names) for many, names in drawn.items()}
    for kind, (words, names) in {**kinds, "small": ("with small parts", SMALL)}.items():
        sets = []
        for name in names:
            sets.append((name, build_set(name, folder)))
            _print_set(*sets[-1], unit_s)
        _print_sum(words, [built for _, built in sets], unit_s)
        _draw_sheet(sets, folder / f"several-{kind}.png")


if __name__ == "__main__":
    run_study(main)
