"""`knotfab tradeoff --print`: what each way to print a piece costs in hours, grams and likeness."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from knotfab.api import build
from knotfab.apps.tradeoff.bench import make_writable
from knotfab.apps.tradeoff.points import list_unbeaten
from knotfab.base.apps import VERSION
from knotfab.base.disk import write_whole
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.progress import Progress
from knotfab.part.slicer_process import REMEDY, find_slicer
from knotfab.picture.source import plain_name
from knotfab_formats.errors import InputError

Options = dict[str, Any]
Builder = Callable[[str, Path, Options], dict[str, Any]]  # picture, folder, options: the report

CHOSEN = "as a build chooses"
WAYS: tuple[tuple[str, Options], ...] = (
    (CHOSEN, {}),
    ("draft", {"accuracy": "draft"}),
    ("fine", {"accuracy": "fine"}),
    ("full plate", {"supports": "none", "mount": "wall", "plate": "full"}),
    ("pegs on a plate", {"mount": "wall", "plate": "pegs"}),
    ("bare, without supports", {"supports": "none", "mount": "none"}),
    ("bare, with supports", {"supports": "slicer", "mount": "none"}),
)
_SHARES = (0.75, 1.3)  # of the depth and the radius that a build chooses


@dataclass(frozen=True)
class Way:
    """One way to print, with means over the pictures; `failed` says why it does not count."""

    label: str
    iou: float = 0.0
    hours: float = 0.0
    grams: float = 0.0
    support_grams: float = 0.0
    seconds: float = 0.0
    failed: str = ""

    @property
    def error(self) -> float:
        return max(1.0 - self.iou, 1e-4)


def front_of(ways: Iterable[Way]) -> list[Way]:
    """List the ways that no other beats in both hours and likeness, fewest hours first."""
    return list_unbeaten((w for w in ways if not w.failed), lambda w: (w.hours, w.error))


def weigh_prints(
    pictures: Sequence[str],
    out: Path,
    given: Options,
    progress: Progress,
    limit_s: float | None = None,
    builder: Builder | None = None,
) -> list[Way]:
    """Build every picture in every way, each as `knotfab build --print` does, and write the figures.

    Returns:
        The ways that there was time for, that of a plain build first.

    Raises:
        MachineError: PrusaSlicer, whose hours and grams these are, is not installed.
        InputError: the folder cannot be written.
    """
    if builder is None and find_slicer() is None:
        raise MachineError("--print", "hours and grams are PrusaSlicer's, which is missing", REMEDY)
    make_writable(out)
    make, began = builder or _build, time.monotonic()
    found: list[Way] = []
    todo = list(WAYS)
    try:
        with progress.stage("measure"):
            while todo and (limit_s is None or time.monotonic() - began < limit_s):
                label, options = todo.pop(0)
                place = out / "prints" / plain_name(label, "way")
                folders = [place / f"{n + 1}" for n in range(len(pictures))]
                reports = []
                for picture, folder in zip(pictures, folders, strict=True):
                    try:
                        reports.append(make(picture, folder, {**given, **options}))
                    except (InputError, SceneError) as error:
                        reports.append({"refused": str(error)})
                found.append(_weigh(label, reports))
                if label == CHOSEN and not found[0].failed:
                    todo += _list_shares(reports)
                _write(out, pictures, found)
                progress.update(len(found) / (len(found) + len(todo)), found[-1].iou)
    except KeyboardInterrupt:
        if not found:
            raise
        raise KeyboardInterrupt(f"{len(found)} ways are kept in {out}") from None
    return found


def _write(out: Path, pictures: Sequence[str], found: Sequence[Way]) -> None:
    best = front_of(found)
    rows = [asdict(way) | {"front": way in best} for way in found]
    content = {"schema": 1, "pictures": list(pictures), "version": VERSION, "ways": rows}
    write_whole(out / "tradeoff-prints.json", json.dumps(content, indent=1).encode())
    write_whole(out / "tradeoff-prints.png", draw_prints(found))


def _build(picture: str, folder: Path, options: Options) -> dict[str, Any]:
    outcome = build(picture, folder, print_=True, **options)
    return dict(outcome.report)


def _list_shares(reports: Sequence[dict[str, Any]]) -> list[tuple[str, Options]]:
    """List the ways with depths and radii other than those of the first picture's build."""
    first = reports[0]
    radius, made = first["settings"]["tube_radius_mm"], first["print"]
    ways: list[tuple[str, Options]] = []
    for share in _SHARES:
        ways.append((f"tube {2 * share * radius:.1f} mm thick", {"tube_radius": share * radius}))
        if (
            made["supports"]["way"] == "none"
        ):  # the lamp's axis is upright, so the height is the depth
            depth = share * made["pose"]["height_mm"]
            ways.append((f"depth {depth:.0f} mm", {"depth": f"{depth:.0f}"}))
    return ways


def _weigh(label: str, reports: Sequence[dict[str, Any]]) -> Way:
    for report in reports:
        if "refused" in report:
            return Way(label, failed=report["refused"])
        if report["status"] != "pass":
            names = [c["name"] for c in report["checks"] if c["required"] and c["status"] == "fail"]
            return Way(label, failed=f"fails {', '.join(names)}")
        if "filament_g" not in report["print"]:
            return Way(label, failed="the slicer gave no figures")
    return Way(
        label,
        fmean(min(view["iou"] for view in r["views"]) for r in reports),
        fmean(r["print"]["time_s"] / 3600 for r in reports),
        fmean(r["print"]["filament_g"] for r in reports),
        fmean(r["print"]["support_g"] for r in reports),
        fmean(r["timings"]["total"] for r in reports),
    )


def draw_prints(ways: Sequence[Way]) -> bytes:
    """Draw 1 - IoU against hours as a PNG: the front, and each way by its number in the list beside it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.4, 5.4), dpi=130, layout="constrained")
    axes = figure.add_subplot()
    best = front_of(ways)
    drawn = sorted((way for way in ways if not way.failed), key=lambda way: way.hours)
    for number, way in enumerate(drawn, start=1):
        at, told = (way.hours, way.error), f"{way.grams:.0f} g, built in {way.seconds:.0f} s"
        axes.scatter(
            *at,
            s=1.5 * way.grams,
            color="#c55a11" if way in best else "#9a9a9a",
            label=f"{number}  {way.label}: {told}",
        )
        axes.annotate(str(number), at, fontsize=7.5, ha="center", va="center")
    if drawn:
        axes.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            fontsize=7.5,
            markerscale=0.5,
        )
    axes.step(
        [w.hours for w in best], [w.error for w in best], where="post", color="#555555", zorder=0
    )
    axes.set(xlabel="hours to print", ylabel="1 − IoU", yscale="log")
    axes.set_title("What each way to print costs (a mark's area: grams)", fontsize=10)
    axes.margins(0.1)
    axes.grid(True, which="both", linewidth=0.3, color="#cccccc")
    written = io.BytesIO()
    figure.savefig(written, format="png")
    return written.getvalue()


def print_ways(ways: Sequence[Way], out: Path) -> None:
    """Print a table of the ways, fewest hours first, and those that failed with the reason."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("", "way"):
        table.add_column(column, no_wrap=True)
    for column in ("IoU", "hours", "grams", "of it supports", "s to build"):
        table.add_column(column, no_wrap=True, justify="right")
    best = front_of(ways)
    for way in sorted((w for w in ways if not w.failed), key=lambda w: w.hours):
        figures = (way.hours, way.grams, way.support_grams, way.seconds)
        told = (f"{value:.{1 if n == 0 else 0}f}" for n, value in enumerate(figures))
        table.add_row("*" if way in best else "", escape(way.label), f"{way.iou:.4f}", *told)
    console.print(table)
    for way in ways:
        if way.failed:
            console.print(f"{escape(way.label)}: {escape(way.failed)}")
    console.print(
        "\n* no other way is both faster to print and nearer to the picture. "
        f"{escape(str(out))}/tradeoff-prints.png shows them"
    )
