"""What accuracy costs in time on the project's own pictures: the study that the presets are points of.

`python -m benchmarks.frontier [--kept DIR] [--write DIR] [--time-limit T] [--jobs N] [NAME ...]`
(`make frontier`) measures as `knotfab tradeoff` does: presets, single knobs and combinations, the better
half on ever more pictures. What is measured is kept in DIR, and an interrupted study goes on. It prints the
front and the presets as a table and writes frontier.json, its figures alone, and frontier.png.
"""

from __future__ import annotations

import datetime
import json
from pathlib import Path

from benchmarks.measurement import read_question, run_study
from examples.pictures import pictures
from knotfab.apps.tradeoff.bench import run_all
from knotfab.apps.tradeoff.measure import Study
from knotfab.apps.tradeoff.page import draw
from knotfab.apps.tradeoff.points import PRESET, Measured
from knotfab.apps.tradeoff.run import Tradeoff, measure_tradeoff, to_dict
from knotfab.base.disk import write_whole
from knotfab.base.progress import Progress
from knotfab.pipeline.values import read_seconds
from knotfab_formats.scene import Scene

COMMAND = "python -m benchmarks.frontier"
NAMES = (
    "knight", "smiley", "anchor", "ampersand", "cat", "wheel",
    "bird", "eight", "notes", "plane", "teapot", "r",
)  # fmt: skip
COMBINATIONS = 16
_DIGITS = 5
_LEFT_OUT = ("settings", "faces", "radius_s", "search_s", "sweep_s")


def main(
    *names: str,
    kept: Path = Path("out/frontier"),
    write: Path | None = None,
    time_limit: str | None = None,
    combinations: int = COMBINATIONS,
    jobs: int = 1,
) -> None:
    """Measure, write and print."""
    drawn = pictures()
    studies = [Study(name, read_question(drawn[name])) for name in (names or NAMES)]
    limit_s = None if time_limit is None else read_seconds(time_limit, "--time-limit")
    with Progress("verbose") as progress:
        found = measure_tradeoff(
            studies,
            Scene(),
            kept,
            run_all(studies, jobs),
            progress=progress,
            jobs=jobs,
            limit_s=limit_s,
            combinations=combinations,
        )
    print(describe(found))
    if write is not None:
        write_whole(write / "frontier.json", dump_study(found).encode())
        write_whole(write / "frontier.png", draw(found.explored, found.title))


def dump_study(found: Tradeoff) -> str:
    """Return its figures alone, a point a line."""
    content = to_dict(found, 1, "cpu")
    rows = [
        {
            key: round(value, _DIGITS) if isinstance(value, float) else value
            for key, value in row.items()
            if key not in _LEFT_OUT
        }
        for row in content.pop("points")
    ]
    steps = [
        {k: round(v, _DIGITS) if isinstance(v, float) else v for k, v in step.items()}
        for step in content.pop("steps")
    ]
    kept = ("schema", "pictures", "version", "seconds", "compared_over", "left_out")
    date = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    head = {"date": date, "command": COMMAND, **{key: content[key] for key in kept}}
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    for name, entries in (("points", rows), ("steps", steps)):
        listed = ",\n".join(f"  {json.dumps(entry)}" for entry in entries)
        lines.append(f"{json.dumps(name)}: [\n{listed}\n ]")
    return "{\n " + ",\n ".join(lines) + "\n}\n"


def describe(found: Tradeoff) -> str:
    """Describe the front and the presets as a table in Markdown, and what each step buys."""
    explored = found.explored
    front = {m.point.settings for m in explored.front}
    shown = [m for m in explored.whole if m.point.settings in front or m.point.knob == PRESET]
    lines = [
        "| point | IoU mean | least | outline, px | curvature × r | at 45° | CPU seconds |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_row(m, m.point.settings in front) for m in sorted(shown, key=lambda m: m.seconds)]
    return "\n".join([*lines, "", *(f"- {step}" for step in found.steps)])


def _row(m: Measured, on_front: bool) -> str:
    name = f"`{m.point.label}`" if m.point.knob == PRESET else f"{m.point.knob}: {m.point.label}"
    legible = "–" if m.legible is None else f"{m.legible:.2f}"
    return (
        f"| {'' if on_front else '('}{name}{'' if on_front else ')'} | {m.iou:.4f} | {m.least_iou:.4f} | "
        f"{m.outline_px:.2f} | {m.curvature:.3f} | {legible} | {m.seconds:.2f} |"
    )


if __name__ == "__main__":
    run_study(main)
