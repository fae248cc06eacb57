"""The catalogue of hard cases searched for worse ones: how near to its bound can an error be brought?

    python -m benchmarks.worst_cases [--minutes 60] [--only WORD] [--seed 0] [--write docs]

For every renderer, loss, term, certificate and bound of an effect CMA-ES turns the numbers that a case is
made of (points, radius, depth, sharpness; a step; a wall; a lamp) so that the share of its bound that the
error comes to grows, from new random starts until its part of the time is over. Kinds take turns of equal
length. What it finds is kept in benchmarks/hard/worst.json, where it is worse than what is kept there,
and a test holds every kept case to its bound. Ends with 1 where a share is above 1.
"""

from __future__ import annotations

import datetime
import json
import warnings
from pathlib import Path

import numpy as np

from benchmarks.hard.climb import Worst, climb
from benchmarks.hard.worst import HUNTS, KEPT
from benchmarks.measurement import run_study
from knotfab.files.whole import write_whole

_OPENING = """# The worst that could be found

Made by `python -m benchmarks.worst_cases --minutes {minutes:g} --seed {seed} --write docs` on {date}.
An optimiser (CMA-ES) varies all numbers of a case (points, radius, depth, sharpness; a polygon's corners; a
step; a wall; a lamp) to make its error as large a share of its bound as it can. The bounds are those of
[hard-cases.md](hard-cases.md). For values the bound is 16 machine epsilons times the condition number. For a
certificate the share is how far along a step it lets strands go, over how far it is until edges meet; for a
lamp, its true blur over the claimed one. A share above 1, or a number that is not finite, is a fault. The
optimiser only visits what a scene can ask for: strands in front of the light, walls as wide as light
reaches.
"""


def describe(found: dict[str, Worst], ever: dict[str, float], minutes: float, seed: int) -> str:
    """The page of the documentation: a run, and the largest share of each that any run found."""
    lines = [
        _OPENING.format(minutes=minutes, seed=seed, date=datetime.date.today()),
        "| what | numbers | cases tried | climbs | share at a random start | largest share | of all runs |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {HUNTS[name].size} | {w.cases:,} | {w.climbs} | {w.begun:.2g} | {w.share:.3g} "
        f"| {ever[name]:.3g} |"
        for name, w in found.items()
    ]
    lines += [
        "",
        "`benchmarks/hard/worst.json` keeps the worst of each, and a test checks it against its bound.",
    ]
    return "\n".join(lines) + "\n"


def keep(name: str, worst: Worst, path: Path) -> float:
    """Keep the numbers where they are worse than what is kept; the share of those that are kept then."""
    kept = json.loads(path.read_text("utf-8")) if path.exists() else {}
    old = np.array(kept.get(name, []))
    share = HUNTS[name].share(old) if len(old) == len(worst.numbers) else -1.0
    if not share >= worst.share:
        share, kept[name] = worst.share, [float(x) for x in worst.numbers]  # to the last digit
    rows = [f"{json.dumps(name)}: {json.dumps(kept[name])}" for name in HUNTS if name in kept]
    write_whole(path, ("{\n" + ",\n".join(rows) + "\n}\n").encode())
    return share


def main(
    *,
    minutes: float = 60.0,
    only: str = "",
    seed: int = 0,
    kept: Path = KEPT,
    write: Path | None = None,
) -> int:
    """Print a line a kind; 1 where a share is above 1."""
    hunts = [hunt for name, hunt in HUNTS.items() if only in name]
    warnings.simplefilter("ignore")  # what is not finite is found out by its share
    found, ever = {}, {}
    print(f"{'what':<24} {'cases':>8} {'climbs':>6} {'random':>9} {'worst':>9}", flush=True)
    for k, hunt in enumerate(hunts):
        worst = climb(hunt, 60 * minutes / len(hunts), 1000 * seed + k)
        found[hunt.name] = worst
        said = "  OUTSIDE" if not worst.share <= 1 else ""
        print(
            f"{hunt.name:<24} {worst.cases:>8} {worst.climbs:>6} "
            f"{worst.begun:>9.2g} {worst.share:>9.3g}{said}",
            flush=True,
        )
        ever[hunt.name] = keep(hunt.name, worst, kept)
    if write is not None:
        page = describe(found, ever, minutes, seed)
        write_whole(write / "worst-cases.md", page.encode())
    return int(any(not worst.share <= 1 for worst in found.values()))


if __name__ == "__main__":
    run_study(main)
