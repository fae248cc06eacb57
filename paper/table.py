"""All figures that compare with the paper, one after the other, into one folder.

`python -m paper.table [--only NAME ...] [--out DIR]`: every section is a command of its own that
prints its table and draws its figures; what it printed is kept as DIR/NAME.txt, and a section that ended
well is not run again. All take about an hour on two quiet cores.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchmarks.measurement import Stopwatch, run_study

OUT = ("--out", "{out}")


@dataclass(frozen=True)
class Section:
    """One command: `python -m MODULE ARGUMENTS`, and about how long it takes."""

    title: str
    module: str
    minutes: float
    arguments: tuple[str, ...] = OUT


SECTIONS: dict[str, Section] = {
    "kind": Section(
        "pictures of the paper's kind beside its published IoU",
        "benchmarks.build_table",
        4,
        ("paper", *OUT),
    ),
    "searches": Section("inn, flow and both: IoU against seconds", "paper.search_compare", 6),
    "knots": Section(
        "knots of the table tied into one picture", "benchmarks.build_table", 5, ("knots", *OUT)
    ),
    "views": Section(
        "two and three views of one part", "benchmarks.build_table", 15, ("several", *OUT)
    ),
    "viviani": Section("Viviani's curve from three sides", "paper.viviani", 3),
    "walk": Section("a sequence of twelve frames", "examples.walk_cycle", 3),
    "film": Section("the film of a search", "examples.search_film", 1, ("text:♞", "{out}.gif")),
    "free": Section("the view as an unknown", "paper.free_view", 3, ()),
    "ablations": Section("the paper's ablations, scaled down", "paper.ablations", 25),
}


def _ran(name: str, section: Section, out: Path) -> bool:
    """Run one section, its output to the console and to a file; whether it ended well."""
    arguments = [a.format(out=out / name) for a in section.arguments]
    command = [sys.executable, "-u", "-m", section.module, *arguments]
    unfinished = out / f"{name}.unfinished"
    print(f"\n== {section.title} (about {section.minutes:g} min)", flush=True)
    watch = Stopwatch()
    with (
        unfinished.open("w") as kept,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child,
    ):
        assert child.stdout is not None
        for line in child.stdout:
            print(line, end="", flush=True)
            kept.write(line)
    print(f"   {watch.wall_s:.0f} s, exit code {child.returncode}", flush=True)
    if child.returncode == 0:
        unfinished.replace(out / f"{name}.txt")
    return child.returncode == 0


def main(*, only: tuple[Literal[*SECTIONS], ...] = (), out: Path = Path("paper-table")) -> int:
    """Run the sections; 1 where one failed."""
    out.mkdir(parents=True, exist_ok=True)
    failed = []
    for name in only or SECTIONS:
        done = out / f"{name}.txt"
        if done.is_file():
            print(f"\n== {SECTIONS[name].title}\n{done.read_text()}", end="", flush=True)
        elif not _ran(name, SECTIONS[name], out):
            failed.append(name)
    if failed:
        print(f"\nDid not end well: {', '.join(failed)}", flush=True)
    return int(bool(failed))


if __name__ == "__main__":
    run_study(main)
