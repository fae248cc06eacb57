"""What builds cost, stage by stage, beside those of another checkout, or by themselves.

`python -m benchmarks.seconds [BEFORE] [--only NAME ...] [--runs 5] [--options="WORDS"] [--out DIR]` builds
pictures with the packages of the checkout BEFORE (whose loops the first run compiles) and with those here, in
turn, and prints the medians: CPU seconds of all processes, seconds, memory, and the stages of report.json.
Then come all checks whose figure moved by more than its tolerance. The options are "--print --skip slicer"
unless others are given.

`python -m benchmarks.seconds --reports OLD NEW` compares two folders of builds that were made already.
`python -m benchmarks.seconds --searches DIR` counts the full searches of the builds in a folder.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.lines import ROOT
from benchmarks.measurement import build_apart, make_folder, read_report, run_study, save_pictures
from examples.pictures import pictures

PRINTED = "--print --skip slicer"
# how far apart a figure of two runs of one design may be, by its unit; or this share of it, if that is more
TOLERANCE = {"mm": 0.02, "px": 0.5, "%": 1.0, "deg": 1.0, "°": 1.0, "g": 1.0}
_OWN = 0.05
_IOU = 0.002  # how far apart one picture's IoU may be

Reports = dict[str, dict[str, Any]]


def build(checkout: Path, picture: Path, out: Path, options: str) -> dict[str, float]:
    """Build a picture by a checkout's packages; return what it took by stage."""
    built = build_apart(picture, out, *options.split(), printing=False, checkout=checkout)
    took = {"exit code": float(built.code), "CPU": built.cpu_s, "wall": built.wall_s}
    took["peak MB"] = built.peak_mb
    for key, told in (("timings", "wall"), ("cpu", "CPU")):
        for stage, seconds in ((built.report or {}).get(key) or {}).items():
            if stage != "total":
                took[f"{stage} {told}"] = seconds
    return took


def read_reports(folder: Path) -> Reports:
    """Read all reports in the folders of a folder, by name."""
    found = {path.name: read_report(path) for path in sorted(folder.iterdir()) if path.is_dir()}
    return {name: report for name, report in found.items() if report is not None}


def compare(before: Reports, after: Reports) -> Iterator[str]:
    """Yield what differs by more than its tolerance: checks, words and likeness; then the mean IoU."""
    shared = [name for name in before if name in after]
    looked = 0
    for name in shared:
        old, new = before[name], after[name]
        checks = {check["name"]: check for check in old["checks"]}
        for check in new["checks"]:
            was = checks.pop(check["name"], None)
            looked += 1
            if was is None or was["status"] != check["status"] or _moved(was, check):
                told = [_figure(one) for one in (was, check)]
                yield f"{name}  {check['name']}: {' -> '.join(told)} {check['unit'] or ''}"
        for lost in checks:
            yield f"{name}  {lost}: it is not made any more"
        words = [(report.get("verdict") or {}).get("word") for report in (old, new)]
        if words[0] != words[1]:
            yield f"{name}  word: {words[0]} -> {words[1]}"
        ious = [_iou(report) for report in (old, new)]
        if abs(ious[1] - ious[0]) > _IOU:
            yield f"{name}  IoU: {ious[0]:.4f} -> {ious[1]:.4f}"
    if shared:
        means = [statistics.mean(_iou(of[name]) for name in shared) for of in (before, after)]
        yield (
            f"{len(shared)} builds, {looked} checks; mean IoU {means[0]:.4f} -> {means[1]:.4f} "
            f"({means[1] - means[0]:+.4f})"
        )


def _iou(report: Mapping[str, Any]) -> float:
    return min((float(view["iou"]) for view in report["views"]), default=0.0)


def _figure(check: Mapping[str, Any] | None) -> str:
    return "none" if check is None else f"{check['status']} {check['measured']}"


def _moved(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    a, b = one["measured"], other["measured"]
    if not isinstance(a, float | int) or not isinstance(b, float | int):
        return bool(a != b)
    return abs(a - b) > max(TOLERANCE.get(other["unit"] or "", 0.0), _OWN * abs(a))


def count_searches(reports: Reports) -> Iterator[str]:
    """Yield the full searches of each build by its `attempts`, then their mean; short ones do not count."""
    counts = {}
    for name, report in reports.items():
        whats = [attempt["what"] for attempt in report["attempts"]]
        counts[name] = sum(what.startswith("search") for what in whats)
        yield f"{name}  {counts[name]}"
    if counts:
        yield f"mean {statistics.mean(counts.values()):.2f} of {len(counts)} builds"


def main(
    *folders: Path,
    only: tuple[str, ...] = ("knight", "cat", "heart"),
    runs: int = 5,
    options: str = PRINTED,
    out: Path | None = None,
    reports: bool = False,
    searches: bool = False,
) -> int:
    """Print what was asked for; 1 if a build failed."""
    if searches:
        print(*count_searches(read_reports(folders[0])), sep="\n")
        return 0
    if reports:
        print(*compare(*map(read_reports, folders[:2])), sep="\n")
        return 0
    place = make_folder(out, "seconds").resolve()
    files = save_pictures(pictures(), place, only)
    sides = {"here": ROOT}
    if folders:
        sides = {"before": folders[0].resolve(), **sides}
    failed = False
    for name, file in files.items():
        took: dict[str, list[dict[str, float]]] = {side: [] for side in sides}
        for run in range(runs):
            for side, checkout in sides.items():
                kept = place / side / (name if run == 0 else f"run-{run}-{name}")
                kept.parent.mkdir(exist_ok=True)
                took[side].append(build(checkout, file, kept, options))
        print(f"\n{name}, medians of {runs}", *sides, "ratio", sep="  ", flush=True)
        for key in dict.fromkeys(k for all_ in took.values() for one in all_ for k in one):
            medians = [statistics.median(one.get(key, 0.0) for one in took[s]) for s in sides]
            ratio = f"  {medians[-1] / medians[0]:.2f}" if len(medians) > 1 and medians[0] else ""
            print(f"{key}  {'  '.join(f'{m:.2f}' for m in medians)}{ratio}", flush=True)
        failed |= any(one["exit code"] != 0 for all_ in took.values() for one in all_)
    if len(sides) > 1:
        print("", *compare(*(read_reports(place / side) for side in sides)), sep="\n")
    return int(failed)


if __name__ == "__main__":
    run_study(main)
