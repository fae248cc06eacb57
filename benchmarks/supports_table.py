"""Print the project's own pictures without supports and with the slicer's, and compare what it takes.

`python -m benchmarks.supports_table [--mount none|wall] [--accuracy NAME] [--out DIR] [NAME ...]`: filament
and, of it, supports, hours, IoU, mean curvature × radius, how legible the piece is from 45 degrees (z), CPU
seconds, and what failed. With the same settings else: both ways bare (`none`), or on a plate of the outline
beside the wall mount of pegs (`wall`). Pictures that are done are not built again.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.measurement import (
    build_once,
    failed_checks,
    make_folder,
    mean_bend,
    run_study,
    save_pictures,
)
from examples.pictures import pictures

WAYS = ("none", "slicer")
# what stands between wall and piece, for a way with a wall mount
_PLATES = {"none": "outline", "slicer": "pegs"}
_HEAD = "picture    supports code  total g  supp. g      h     IoU   bend   z 45   CPU s  failed"


def row_of(built: Mapping[str, Any]) -> dict[str, float] | None:
    """Return the figures of one build (`build_once`); None where nothing could be sliced."""
    report = built["report"]
    if report is None or "filament_g" not in report["print"]:
        return None
    view, printed = report["views"][0], report["print"]
    return {
        "grams": printed["filament_g"],
        "supports": printed["support_g"],
        "hours": printed["time_s"] / 3600,
        "iou": view["iou"],
        "bend": mean_bend(report),
        "z": view["recognition"]["45"]["z"],
        "cpu": built["cpu_s"],
        "passed": float(built["code"] == 0),
    }


def _line(name: str, way: str, code: int, row: Mapping[str, float], failed: list[str]) -> str:
    return (
        f"{name:<10} {way:<8} {code:>4}  {row['grams']:7.1f}  {row['supports']:7.1f}  "
        f"{row['hours']:5.2f}  {row['iou']:.4f}  {row['bend']:.3f}  {row['z']:5.2f}  "
        f"{row['cpu']:6.0f}  {' '.join(failed)}"
    )


def summarize(pairs: list[dict[str, dict[str, float]]]) -> list[str]:
    """Compare the two ways over all pictures of which both were sliced, in sentences."""
    alone, with_ = ([pair[way] for pair in pairs] for way in WAYS)

    def ratio(key: str) -> str:
        found = [a[key] / b[key] for a, b in zip(alone, with_, strict=True)]
        return f"{statistics.mean(found):.2f} (at most {max(found):.2f})"

    def mean(rows: list[dict[str, float]], key: str) -> float:
        return statistics.mean(row[key] for row in rows)

    lost = [b["iou"] - a["iou"] for a, b in zip(alone, with_, strict=True)]
    free = sum(row["passed"] > 0 and row["supports"] == 0 for row in alone)
    return [
        f"{len(pairs)} pictures; without a gram of supports, and every check passed: {free}",
        f"without supports against with them: filament {ratio('grams')}, hours {ratio('hours')}, "
        f"CPU seconds {ratio('cpu')}",
        f"IoU lower by {statistics.mean(lost):.4f} on average, by {max(lost):.4f} at worst",
        f"mean curvature × radius {mean(alone, 'bend'):.3f} and {mean(with_, 'bend'):.3f}, "
        f"z from 45° {mean(alone, 'z'):.2f} and {mean(with_, 'z'):.2f}",
    ]


def main(
    *names: str, mount: str = "none", accuracy: str = "standard", out: Path | None = None
) -> None:
    """Print the table and its summary."""
    folder = make_folder(out, "supports")
    print(_HEAD)
    pairs = []
    for name, path in save_pictures(pictures(), folder, names).items():
        pair = {}
        for way in WAYS:
            options = ["--mount", mount, "--supports", way, "--accuracy", accuracy]
            if mount == "wall":
                options += ["--plate", _PLATES[way]]
            built = build_once(path, folder / f"{name}-{mount}-{way}", *options, printing=True)
            row = row_of(built)
            if row is None:
                notes = (built["report"] or {}).get("notes", [built["said"]])
                print(f"{name:<10} {way:<8} {built['code']:>4}  {' '.join(notes)}", flush=True)
                continue
            pair[way] = row
            print(_line(name, way, built["code"], row, failed_checks(built["report"])), flush=True)
        if len(pair) == len(WAYS):
            pairs.append(pair)
    if pairs:
        print("", *summarize(pairs), sep="\n", flush=True)


if __name__ == "__main__":
    run_study(main)
