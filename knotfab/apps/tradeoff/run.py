"""`knotfab tradeoff`: build a picture in many ways, and show which of them nothing beats."""

from __future__ import annotations

import hashlib
import io
import json
import os
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import tomli_w

from knotfab.api import build
from knotfab.base.apps import VERSION
from knotfab.base.disk import read_file, temporary_folder, write_whole
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.progress import Progress
from knotfab.part.slicer_process import REMEDY, find_slicer
from knotfab.picture.source import TEXT_PREFIX, plain_name
from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS, SearchSettings

Options = dict[str, Any]
Builder = Callable[[str, Path, Options], dict[str, Any]]  # picture, folder, options: the report
CHOSEN = "as a build chooses"
PRINTS: tuple[tuple[str, Options], ...] = (
    ("full plate", {"supports": "none", "mount": "wall", "plate": "full"}),
    ("pegs on a plate", {"mount": "wall", "plate": "pegs"}),
    ("bare, without supports", {"supports": "none", "mount": "none"}),
    ("bare, with supports", {"supports": "slicer", "mount": "none"}),
)
_NETWORK = {"method": "inn+flow", "network_depth": 4, "network_width": 32}
KNOBS: tuple[dict[str, Any], ...] = (  # keys of [search], each set beside those of the middle
    {"coarse_px": 128}, {"coarse_px": 256}, {"fine_px": 384}, {"fine_px": 1024},
    {"edge_radii": 0.6}, {"settle_edge_radii": 0.6}, {"settle_edge_radii": 0.3},
    {"winners_every": 8}, {"winners_every": 1}, {"tau": 12.0}, {"tau": 36.0}, {"precision": "double"},
    {"renderer": "capsule"}, {"renderer": "ellipse"}, {"depth_candidates": 100}, {"depth_candidates": 600},
    {"radius_candidates": 4}, {"radius_give": 0.02}, {"radius_give": 0.0}, {"radius_from": 0.75},
    {"tolerance_px": 1.0}, {"tolerance_px": 0.1}, {"outline_px": 1.0, "mesh_sides": 16}, {"grace": 0.0},
    _NETWORK, {**_NETWORK, "network_iterations": 100}, {**_NETWORK, "network_rate_radii": 0.1},
    {**_NETWORK, "network_start": "circle"},
)  # fmt: skip
_TIMES = (0.5, 2.0)  # of all iterations
_SHARES = (0.75, 1.3)  # of the depth and the radius that a build chooses
_RUNS = "tradeoff-runs.json"


@dataclass(frozen=True)
class Way:
    """One way to build, with means over the pictures; `failed` says why it does not count."""

    label: str
    iou: float = 0.0
    seconds: float = 0.0
    """Of the whole build, as a person waits for it."""
    cpu_s: float = 0.0
    """CPU seconds, which other work on the machine changes little; 0 where no earlier run kept them."""
    hours: float = 0.0
    grams: float = 0.0
    support_grams: float = 0.0
    failed: str = ""

    @property
    def error(self) -> float:
        return max(1.0 - self.iou, 1e-4)

    @property
    def costs(self) -> tuple[float, ...]:
        return self.seconds, self.hours, self.grams, self.error


def front_of(ways: Sequence[Way], *costs: str) -> list[Way]:
    """List the ways that no other beats, fewest seconds first.

    One beats another if it costs no more of anything, and less of something.

    Args:
        costs: what counts; by default seconds, hours, grams and error.
    """

    def cost(way: Way) -> tuple[float, ...]:
        return tuple(getattr(way, name) for name in costs) if costs else way.costs

    def beats(one: Way, other: Way) -> bool:
        pairs = list(zip(cost(one), cost(other), strict=True))
        return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)

    sound = [way for way in ways if not way.failed]
    return sorted((w for w in sound if not any(beats(o, w) for o in sound)), key=cost)


def list_ways(middle: SearchSettings, accuracy: str, printed: bool) -> list[tuple[str, Options]]:
    """List what to build: as it is asked, the presets, then ways to print or single keys of [search]."""
    ways: list[tuple[str, Options]] = [(CHOSEN, {})]
    ways += [(name, {"accuracy": name}) for name in PRESETS if name != accuracy]
    if printed:
        return [*ways, *PRINTS]
    keys = ("coarse_iterations", "fine_iterations", "settle_iterations")
    for times in _TIMES:
        more = middle.scaled(times)
        ways.append((f"iterations × {times:g}", {"search": {k: getattr(more, k) for k in keys}}))
    for knob in KNOBS:
        if any(getattr(middle, key) != value for key, value in knob.items()):
            label = ", ".join(f"{key} {value}" for key, value in knob.items())
            ways.append((label, {"search": knob}))
    return ways


def tradeoff(
    pictures: Sequence[str],
    out: Path,
    given: Options,
    middle: SearchSettings,
    accuracy: str,
    progress: Progress,
    printed: bool = False,
    limit_s: float | None = None,
    builder: Builder | None = None,
) -> list[Way]:
    """Build every picture in every way, and write the figures; what an earlier call built is not built again.

    Args:
        given: options of every build; its `scene` is read and its [search] set anew for each way, with the
            keys of its `search`.
        middle: the settings beside which keys are set.
        printed: build as `--print` does, and in ways that change what the printer does.
        limit_s: seconds after which no way is begun.

    Returns:
        The ways that there was time for, that of a plain build first.

    Raises:
        MachineError: PrusaSlicer, whose hours and grams these are, is not installed.
        InputError: the folder cannot be written.
    """
    if printed and builder is None and find_slicer() is None:
        raise MachineError("--print", "hours and grams are PrusaSlicer's, which is missing", REMEDY)
    _make_writable(out)
    kept, began, found = _read_kept(out), time.monotonic(), list[Way]()
    make = _keep(builder or _warm(), kept, out)
    todo = list_ways(middle, accuracy, printed)
    try:
        with progress.stage("measure"):
            while todo and (limit_s is None or time.monotonic() - began < limit_s):
                label, options = todo.pop(0)
                keys = {**given.get("search", {}), **options.get("search", {})}
                asked = {**given, "print_": printed, **options} | ({"search": keys} if keys else {})
                place = out / "builds" / plain_name(label, "way")
                reports = []
                for number, picture in enumerate(pictures, start=1):
                    try:
                        reports.append(make(picture, place / str(number), asked))
                    except (InputError, SceneError) as error:
                        reports.append({"refused": str(error)})
                found.append(_weigh(label, reports, printed))
                if printed and label == CHOSEN and not found[0].failed:
                    todo += _list_shares(reports[0])
                _write(out, pictures, found)
                progress.update(len(found) / (len(found) + len(todo)), found[-1].iou)
    except KeyboardInterrupt:
        if not found:
            raise
        raise KeyboardInterrupt(f"{len(found)} ways are kept in {out}") from None
    finally:
        if found:
            write_whole(out / "tradeoff.png", draw(found))
    return found


def _make_writable(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {out}", f"it cannot be made: {error.strerror}", "Name a folder"
        ) from error
    if not os.access(out, os.W_OK):
        raise InputError(f"--out {out}", "it may not be written", "Name another folder")


def _warm() -> Builder:
    """Return a builder that builds once for nothing, so that no way pays for what a process loads."""
    warm: list[bool] = []

    def make(picture: str, folder: Path, options: Options) -> dict[str, Any]:
        if not warm:
            warm.append(True)
            with temporary_folder("knotfab-tradeoff-") as place:
                _build(picture, place / "out", {**options, "accuracy": "sketch", "search": {}})
        return _build(picture, folder, options)

    return make


def _build(picture: str, folder: Path, options: Options) -> dict[str, Any]:
    plain = {key: value for key, value in options.items() if key not in ("search", "scene")}
    with temporary_folder("knotfab-tradeoff-") as place:
        if options.get("search") or "scene" in options:
            write_whole(place / "scene.toml", _scene_of(options).encode())
            plain["scene"] = place / "scene.toml"
        return dict(build(picture, folder, **plain).report)


def _scene_of(options: Options) -> str:
    """Return the text of the given scene with further keys of [search]; its pictures are not named."""
    scene: dict[str, Any] = {"schema": 1}
    if "scene" in options:
        scene = tomllib.loads(read_file(Path(options["scene"]), str(options["scene"])).decode())
        for view in scene.get("views", ()):
            view.pop("picture", None)
    scene["search"] = {**scene.get("search", {}), **options.get("search", {})}
    return tomli_w.dumps(scene)


def _keep(make: Builder, kept: dict[str, Any], out: Path) -> Builder:
    """Return a builder that remembers in a file what it built, by picture, options and version."""

    def remember(picture: str, folder: Path, options: Options) -> dict[str, Any]:
        text = picture.startswith(TEXT_PREFIX)
        content = picture.encode() if text else read_file(Path(picture), picture)
        told = {k: str(v) for k, v in options.items() if k not in ("search", "scene")}
        asked = json.dumps([told, _scene_of(options), VERSION], sort_keys=True)
        # a printer, a material or a font may be a file
        content += b"".join(read_file(Path(v), v) for v in told.values() if os.path.isfile(v))
        key = hashlib.sha256(content + asked.encode()).hexdigest()[:24]
        if key not in kept:
            report = make(picture, folder, options)
            kept[key] = {name: report.get(name) for name in _NEEDED}
            write_whole(out / _RUNS, json.dumps(kept, indent=1).encode())
        found: dict[str, Any] = kept[key]
        return found

    return remember


_NEEDED = ("status", "checks", "views", "settings", "timings", "cpu", "print")


def _read_kept(out: Path) -> dict[str, Any]:
    try:
        found = json.loads((out / _RUNS).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    sound = isinstance(found, dict)
    return (
        {k: r for k, r in found.items() if isinstance(r, dict) and _NEEDED[0] in r} if sound else {}
    )


def _list_shares(report: dict[str, Any]) -> list[tuple[str, Options]]:
    """List the ways with depths and radii other than those of the first picture's build."""
    radius, made = report["settings"]["tube_radius_mm"], report["print"]
    ways: list[tuple[str, Options]] = []
    for share in _SHARES:
        ways.append((f"tube {2 * share * radius:.1f} mm thick", {"tube_radius": share * radius}))
        # without supports the lamp's axis is upright, so the height is the depth
        if made["supports"]["way"] == "none":
            depth = share * made["pose"]["height_mm"]
            ways.append((f"depth {depth:.0f} mm", {"depth": f"{depth:.0f}"}))
    return ways


def _weigh(label: str, reports: Sequence[dict[str, Any]], printed: bool) -> Way:
    for report in reports:
        if "refused" in report:
            return Way(label, failed=report["refused"])
        if report["status"] != "pass":
            names = [c["name"] for c in report["checks"] if c["required"] and c["status"] == "fail"]
            return Way(label, failed=f"fails {', '.join(names)}")
        if printed and "filament_g" not in report["print"]:
            return Way(label, failed="the slicer gave no figures")
    iou = fmean(min(view["iou"] for view in r["views"]) for r in reports)
    seconds, cpu_s = (
        fmean((report.get(key) or {}).get("total", 0.0) for report in reports)
        for key in ("timings", "cpu")
    )
    way = Way(label, iou, seconds, cpu_s)
    if not printed:
        return way
    made = [report["print"] for report in reports]
    hours, grams, supports = (
        fmean(m[key] for m in made) for key in ("time_s", "filament_g", "support_g")
    )
    return replace(way, hours=hours / 3600, grams=grams, support_grams=supports)


def _write(out: Path, pictures: Sequence[str], found: Sequence[Way]) -> None:
    best = front_of(found)
    rows = [asdict(way) | {"front": way in best} for way in found]
    content = {"schema": 2, "pictures": list(pictures), "version": VERSION, "ways": rows}
    write_whole(out / "tradeoff.json", json.dumps(content, indent=1).encode())


def draw(ways: Sequence[Way]) -> bytes:
    """Draw 1 - IoU against the seconds of a build, and against hours to print where there are any.

    The line of a panel goes through all that nothing beats in its two costs; a mark's area is its grams.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    sound = sorted((way for way in ways if not way.failed), key=lambda way: way.seconds)
    panels = [("seconds", "seconds of a whole build"), ("hours", "hours to print")]
    panels = panels if any(way.hours for way in sound) else panels[:1]
    figure = Figure(figsize=(5.0 + 3.8 * len(panels), 5.4), dpi=130, layout="constrained")
    best = front_of(ways)
    for number, (cost, name) in enumerate(panels, start=1):
        axes = figure.add_subplot(1, len(panels), number)
        for place, way in enumerate(sound, start=1):
            at = getattr(way, cost), way.error
            colour = "#c55a11" if way in best else "#9a9a9a"
            area = 1.5 * way.grams or 60.0
            axes.scatter(*at, s=area, color=colour, label=f"{place}  {_tell(way)}")
            axes.annotate(str(place), at, fontsize=7, ha="center", va="center")
        line = front_of(ways, cost, "error")
        costs = [getattr(way, cost) for way in line]
        axes.step(costs, [w.error for w in line], where="post", color="#555555", zorder=0)
        axes.set(xlabel=name, ylabel="1 − IoU", yscale="log", xscale="log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.margins(0.1)
        axes.grid(True, which="both", linewidth=0.3, color="#cccccc")
    if sound:
        axes.legend(
            loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=7, markerscale=0.5
        )
    written = io.BytesIO()
    figure.savefig(written, format="png")
    return written.getvalue()


def _tell(way: Way) -> str:
    printed = f", {way.hours:.1f} h, {way.grams:.0f} g" if way.hours else ""
    return f"{way.label}: {way.seconds:.0f} s{printed}"


def tell_worth(ways: Sequence[Way]) -> str:
    """Say which key of [search] is worth its seconds, beside the presets."""
    names = {CHOSEN, *PRESETS}
    best = [way for way in front_of(ways) if way.label not in names]
    middle = next((way for way in ways if way.label == CHOSEN and not way.failed), None)
    if middle is None or not best:
        return "No way is worth its seconds beside the presets."
    one = min(best, key=lambda way: way.seconds / middle.seconds * way.error / middle.error)
    gain, more = one.iou - middle.iou, one.seconds - middle.seconds
    return f"Worth its seconds first of all: {one.label}, {gain:+.4f} IoU for {more:+.1f} s."


def print_ways(ways: Sequence[Way], out: Path) -> None:
    """Print a table of the ways, fastest first, and those that failed with the reason."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("", "way"):
        table.add_column(column, no_wrap=True)
    printed = any(way.hours for way in ways)
    printing = ("hours", "grams", "of it supports") if printed else ()
    columns = ("IoU", "seconds", "CPU s", *printing)
    for column in columns:
        table.add_column(column, no_wrap=True, justify="right")
    best = front_of(ways)
    for way in sorted((w for w in ways if not w.failed), key=lambda w: w.seconds):
        figures = [f"{way.iou:.4f}", f"{way.seconds:.1f}", f"{way.cpu_s:.1f}"]
        figures += [f"{way.hours:.1f}", f"{way.grams:.0f}", f"{way.support_grams:.0f}"]
        table.add_row("*" if way in best else "", escape(way.label), *figures[: len(columns)])
    console.print(table)
    for way in ways:
        if way.failed:
            console.print(f"{escape(way.label)}: {escape(way.failed)}")
    console.print(
        f"\n* no other way costs less of anything and no more of the rest. {escape(tell_worth(ways))}\n"
        f"{escape(str(out))}/tradeoff.png shows them."
    )
