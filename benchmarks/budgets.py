"""Whether a time budget is kept, and what it buys: seconds and IoU of whole builds against --time-budget.

    python -m benchmarks.budgets [--seconds 5 10 20 40 80] [--runs 5] [--figure PNG] [NAME ...]

Each build is a process of its own, from its start to its end, without the slicer; of several runs the median
second counts. A build is late that ends later than 1.15 times its budget. What is measured is kept in
--kept, and not measured again.
"""

from __future__ import annotations

import json
import statistics
from pathlib import Path
from typing import Any

from benchmarks.measurement import build_apart, make_folder, run_study, save_pictures
from examples.pictures import pictures

NAMES = ("knight", "smiley", "anchor", "cat", "wheel", "bicycle")
SECONDS = (5.0, 10.0, 20.0, 40.0, 80.0)
LATE = 1.15  # times the budget

Record = dict[str, Any]  # seconds of each run, exit code, IoU, verdict


def measure(path: Path, seconds: float, runs: int, folder: Path) -> Record:
    """Build a picture so many times in a budget of so many seconds."""
    built = [
        build_apart(
            path,
            folder / f"{path.stem}-{seconds:g}",
            f"--time-budget={seconds:g}",
            "--skip=slicer",
            printing=False,
        )
        for _ in range(runs)
    ]
    report = built[-1].report or {}
    views = report.get("views") or [{}]
    return {
        "seconds": [round(one.wall_s, 2) for one in built],
        "codes": [one.code for one in built],
        "iou": views[0].get("iou"),
        "verdict": (report.get("verdict") or {}).get("word"),
        "said": built[-1].said if built[-1].code else "",
    }


def draw(found: dict[str, dict[str, Record]], path: Path) -> None:
    """Draw the IoU and seconds against the budget, a line a picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, records in found.items():
        budgets = sorted(float(t) for t in records)
        kept = [records[f"{t:g}"] for t in budgets]
        good = [(t, r["iou"]) for t, r in zip(budgets, kept, strict=True) if r["iou"]]
        left.plot(*zip(*good, strict=True), "o-", label=name)
        right.plot(budgets, [statistics.median(r["seconds"]) for r in kept], "o-", label=name)
    budgets = sorted({float(t) for records in found.values() for t in records})
    right.fill_between(budgets, 0, [LATE * t for t in budgets], color="0.9")
    right.plot(budgets, budgets, color="0.5", linewidth=1)
    left.set(xscale="log", xlabel="--time-budget, s", ylabel="IoU of the verified part")
    right.set(xscale="log", yscale="log", xlabel="--time-budget, s", ylabel="seconds of the build")
    for axes in (left, right):
        axes.set_xticks(budgets, [f"{t:g}" for t in budgets])
        axes.minorticks_off()
    left.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=120)


def main(
    *names: str,
    seconds: tuple[float, ...] = SECONDS,
    runs: int = 5,
    kept: Path | None = None,
    figure: Path | None = None,
    out: Path | None = None,
) -> None:
    """Print a line a build, what it comes to, and draw it."""
    folder = make_folder(out, "budgets")
    found: dict[str, dict[str, Record]] = {}
    if kept is not None and kept.is_file():
        found = json.loads(kept.read_text("utf-8"))
    late = unverified = 0
    print(
        f"{'picture':<10} {'budget':>6} {'median':>7} {'worst':>7}  share  codes  IoU     verdict"
    )
    for name, path in save_pictures(pictures(), folder, (names or NAMES)).items():
        own = found.setdefault(name, {})
        for budget in seconds:
            key = f"{budget:g}"
            if key not in own:
                own[key] = measure(path, budget, runs, folder)
                if kept is not None:
                    kept.parent.mkdir(parents=True, exist_ok=True)
                    kept.write_text(json.dumps(found, indent=1), encoding="utf-8")
            record = own[key]
            middle = statistics.median(record["seconds"])
            late += middle > LATE * budget
            unverified += any(record["codes"])
            codes = ",".join(str(code) for code in sorted(set(record["codes"])))
            iou = "" if record["iou"] is None else f"{record['iou']:.4f}"
            print(
                f"{name:<10} {budget:>6g} {middle:>7.2f} {max(record['seconds']):>7.2f}  "
                f"{middle / budget:.2f}  {codes:<6} {iou:<7} {record['verdict'] or record['said']}",
                flush=True,
            )
    print(
        f"{late} budgets overrun by more than 15 %, {unverified} with a run that was not verified"
    )
    if figure is not None:
        draw(found, figure)


if __name__ == "__main__":
    run_study(main)
