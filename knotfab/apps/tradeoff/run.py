"""`knotfab tradeoff`: measure pictures, write tradeoff.json, .png and .html, and print a table."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotfab.apps.tradeoff.bench import (
    Bench,
    Explored,
    Journal,
    Runner,
    WantedRun,
    explore,
    list_rungs,
    make_writable,
    run_all,
)
from knotfab.apps.tradeoff.measure import Study
from knotfab.apps.tradeoff.page import draw, render_page
from knotfab.apps.tradeoff.points import (
    PRESET,
    Measured,
    Point,
    Step,
    list_changes,
    list_points,
    list_steps,
)
from knotfab.base.apps import VERSION
from knotfab.base.disk import write_whole
from knotfab.base.progress import Progress
from knotfab.design.question import ask
from knotfab.picture.read import read_target
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedScene

COMBINATIONS = 16  # combined points tried in addition to those that turn one knob
JOURNAL = "tradeoff-runs.jsonl"


@dataclass(frozen=True)
class Tradeoff:
    """The measured points, and the folder with the files.

    `left_out` lists the runs that there was no time for, `steps` what the next value of each knob buys.
    """

    explored: Explored
    steps: list[Step]
    pictures: tuple[str, ...]
    jobs: int
    left_out: tuple[WantedRun, ...]
    folder: Path

    @property
    def radii_mm(self) -> list[float]:
        """The tube radius of the middle settings on each picture."""
        return [run.radius_mm for run in self.explored.middle.runs]

    @property
    def title(self) -> str:
        """A title of one line."""
        few = self.pictures[0] if len(self.pictures) == 1 else f"{len(self.pictures)} pictures"
        side = f", {self.jobs} runs side by side" if self.jobs > 1 else ""
        return f"{few}: what accuracy costs{side}"

    def said_left_out(self) -> str:
        """Describe the points that there was no time for; empty if there was time for all."""
        if not self.left_out:
            return ""
        missing = Counter(request.settings for request in self.left_out)
        known = {m.point.settings: m.point for m in self.explored.measured}
        never = sum(settings not in known for settings in missing)
        few = [known[s].label for s in missing if s in known]
        said = f"There was no time for {len(self.left_out)} runs"
        if never:
            said += f"; {never} points were not measured at all"
        if few:
            named = ", ".join(few[:4]) + (f" and {len(few) - 4} more" if len(few) > 4 else "")
            said += f"; {named}: not on all pictures"
        return said + ". The same call goes on from here."


def tradeoff(
    scene: ResolvedScene,
    sources: Sequence[str],
    out: Path,
    base: Path | None = None,
    repeats: int = 1,
    progress: Progress | None = None,
    chosen: Sequence[Point] | None = None,
    jobs: int = 1,
    limit_s: float | None = None,
    combinations: int = COMBINATIONS,
) -> Tradeoff:
    """Measure the frontier of accuracy and time on this machine, for each picture by itself.

    Every finished run is kept in the folder, so the same call measures only what is missing.

    Args:
        chosen: the points to begin with; by default the presets and one knob at a time.
        limit_s: seconds after which no run is started.
        combinations: how many combined points to try in addition.

    Raises:
        InputError: a picture or the folder cannot be used.
        SceneError: no tube can draw a picture.
    """
    scene = scene.but(views=scene.views[:1])
    targets = [read_target(source, scene.views[0], base=base) for source in sources]
    studies = [Study(t.name, ask(scene, [t])) for t in targets]
    run = run_all(studies, jobs)
    return measure_tradeoff(
        studies, scene, out, run, repeats, progress, chosen, jobs, limit_s, combinations
    )


def measure_tradeoff(
    studies: Sequence[Study],
    scene: ResolvedScene,
    out: Path,
    run: Runner,
    repeats: int = 1,
    progress: Progress | None = None,
    chosen: Sequence[Point] | None = None,
    jobs: int = 1,
    limit_s: float | None = None,
    combinations: int = COMBINATIONS,
    clock: Callable[[], float] = time.monotonic,
) -> Tradeoff:
    """Do the work of `tradeoff` on pictures already read, with a given runner and clock."""
    progress = progress or Progress("quiet")
    if not studies:
        raise InputError("tradeoff", "no picture is named", "Name one or several")
    make_writable(out)
    settings = scene.settings
    asked = list(chosen) if chosen is not None else list_points(settings)
    if all(point.settings != settings for point in asked):
        settings = asked[0].settings
    expected, alive, before = 0, len(asked) + combinations, 0
    for rung in list_rungs(len(studies)):
        expected, before = expected + repeats * alive * (rung - before), rung
        alive = -(-alive // 2)
    with closing(Journal(out / JOURNAL)) as journal, progress.stage("measure"):
        bench = Bench(
            studies,
            run,
            journal,
            repeats,
            limit_s,
            clock,
            lambda done, iou: progress.update(done / expected, iou),
        )
        try:
            explored = explore(bench, asked, settings, combinations)
        except KeyboardInterrupt:
            kept = f"{len(journal.runs)} runs are kept in {journal.path}, and the same call goes on"
            raise KeyboardInterrupt(kept) from None
        if journal.unused:
            progress.say(
                f"{journal.path} holds {journal.unused} runs of other pictures, settings or versions: "
                "they stay there and are not used."
            )
    if explored is None:
        raise InputError(
            f"--time-limit {limit_s:g}s",
            "it is over before the settings that knobs are turned around were measured once",
            "Give more; what was measured is kept",
        )
    steps = list_steps(explored.measured, explored.middle.point.settings)
    found = Tradeoff(
        explored, steps, tuple(study.name for study in studies), jobs, tuple(bench.left_out), out
    )
    content = to_dict(found, repeats)
    write_whole(out / "tradeoff.json", json.dumps(content, indent=1).encode())
    write_whole(out / "tradeoff.png", draw(explored, found.title))
    write_whole(out / "tradeoff.html", render_page(explored, steps, found).encode())
    return found


def to_dict(found: Tradeoff, repeats: int) -> dict[str, Any]:
    """Return the content of tradeoff.json."""
    explored = found.explored
    return {
        "schema": 1,
        "picture": found.pictures[0],
        "pictures": list(found.pictures),
        "tube_radius_mm": found.radii_mm[0],
        "tube_radii_mm": found.radii_mm,
        "repeats": repeats,
        "jobs": found.jobs,
        "version": VERSION,
        "seconds": explored.middle.clock,
        "compared_over": explored.compared,
        "points": list_rows(explored),
        "steps": [vars(step) for step in found.steps],
        "left_out": len(found.left_out),
    }


def list_rows(explored: Explored) -> list[dict[str, Any]]:
    """List one row of figures per point, presets first, over those compared pictures that it saw."""
    on = {m.point.settings for m in explored.front}
    middle = explored.middle.point.settings

    def row(m: Measured) -> dict[str, Any]:
        m = m.over(explored.compared)
        means = {key: m.mean(key) for key in ("radius_s", "search_s", "sweep_s", "cpu_s")}
        return {
            "knob": m.point.knob,
            "point": m.point.label,
            "iou": m.iou,
            "iou_least": m.least_iou,
            "outline_px": m.outline_px,
            "facet_error_px": m.facet_px,
            "curvature_radii": m.curvature,
            "legibility_45": m.legible,
            **means,
            "seconds": m.seconds,
            "feasible": m.feasible,
            "repairs": m.repairs,
            "faces": round(m.mean("faces")),
            "pictures": len(m.runs),
            "eligible": m.keeps(explored.middle.over(len(m.runs))),
            "frontier": m.point.settings in on,
            "changed": {k: new for k, (_, new) in list_changes(m.point.settings, middle).items()},
            "settings": m.point.settings.model_dump(),
        }

    rows = [row(m) for m in explored.measured]
    return sorted(rows, key=lambda r: r["knob"] != PRESET)


def print_tradeoff(found: Tradeoff) -> None:
    """Print a table of the points, fastest first, and what each step of a knob buys."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    explored = found.explored
    console = Console(highlight=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="dim")
    seconds = "CPU s" if found.explored.middle.clock == "cpu" else "s"
    table.add_column("")
    table.add_column("point", no_wrap=True, max_width=max(20, console.width - 60))
    for column in ("IoU", "least", "px", "bend", "at 45°", seconds, "on"):
        table.add_column(column, no_wrap=True, justify="right")
    best = {m.point.settings for m in explored.front}
    for m in sorted(explored.measured, key=lambda m: m.seconds):
        one = m.over(explored.compared)
        table.add_row(
            "*" if m.point.settings in best else "",
            escape(m.point.label),
            f"{one.iou:.4f}" if one.feasible else "infeasible",
            f"{one.least_iou:.4f}",
            f"{one.outline_px:.2f}",
            f"{one.curvature:.3f}",
            "–" if one.legible is None else f"{one.legible:.2f}",
            f"{one.seconds:.2f}",
            str(len(one.runs)),
        )
    console.print(table)
    if found.steps:
        console.print("\nWhat the next step of each setting buys and costs:")
    for step in found.steps:
        console.print(f"  {escape(str(step))}")
    radii = " to ".join(f"{r:.2f}" for r in sorted({min(found.radii_mm), max(found.radii_mm)}))
    console.print(
        "\n* nothing measured is both faster and better. px: 95 % of the outlines are no farther apart; "
        "bend: mean curvature × tube radius; at 45°: how well it is read from there; "
        "on: how many pictures.\n"
        f"Tube radius {radii} mm; {escape(str(found.folder))}/tradeoff.html shows all of it"
    )
    if found.left_out:
        console.print(escape(found.said_left_out()))
