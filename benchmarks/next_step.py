"""What each accuracy takes and reaches as a whole build: the data of the report's `next_step`.

`python -m benchmarks.next_step [NAME ...] [--write FILE]` builds the pictures with every accuracy, one
after the other so that what else the machine does falls on all alike, and prints the mean error, 1 - IoU, and
the mean seconds of each stage. `--write knotfab/report/next_step.json` keeps them where reports look.
"""

from __future__ import annotations

import json
import statistics
import tempfile
from collections import defaultdict
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.measurement import build_apart, run_study, save_pictures
from examples.pictures import pictures
from knotfab_formats.search import PRESETS

NAMES = ("knight", "anchor", "cat", "teapot")
LEAST_S = 0.05  # a stage below this says nothing


def measure(names: tuple[str, ...], folder: Path) -> list[dict[str, Any]]:
    """List the steps from accuracy to accuracy, by their mean seconds; what is beaten in both is none."""
    reports = defaultdict[str, list[dict[str, Any]]](list)
    for path in save_pictures(pictures(), folder, names).values():
        for accuracy in PRESETS:
            built = build_apart(
                path, folder / f"{path.stem}-{accuracy}", "--accuracy", accuracy, "--skip", "slicer"
            )
            if built.report is None:
                raise SystemExit(f"{path.stem}, {accuracy}: {built.said}")
            reports[accuracy].append(built.report)
    steps = []
    for accuracy, found in reports.items():
        stages = {
            stage: round(statistics.mean(r["timings"].get(stage, 0.0) for r in found), 2)
            for stage in found[0]["timings"]
        }
        error = statistics.mean(1 - r["views"][0]["iou"] for r in found)
        total = stages.pop("total")
        kept = {stage: s for stage, s in stages.items() if s > LEAST_S}
        print(f"{accuracy:10} error {error:.4f}, {total:.1f} s: {kept}", flush=True)
        steps.append({"accuracy": accuracy, "error": round(error, 5), "seconds": kept})
    steps.sort(key=lambda step: sum(step["seconds"].values()))
    return [
        step
        for number, step in enumerate(steps)
        if all(step["error"] < faster["error"] for faster in steps[:number])
    ]


def main(*names: str, write: Path | None = None) -> None:
    """Print the table, and keep it where that is asked."""
    with tempfile.TemporaryDirectory() as folder:
        steps = measure(tuple(names or NAMES), Path(folder))
    content = {
        "measured": date.today().isoformat(),
        "pictures": len(names or NAMES),
        "by": "python -m benchmarks.next_step",
        "steps": steps,
    }
    if write is not None:
        write.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run_study(main)
