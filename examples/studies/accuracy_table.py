"""Build the project's own pictures with default settings and print what they reach.

`python -m examples.studies.accuracy_table [--flat] [--skip-slicer] [--out DIR] [NAME ...]`: IoU, radius,
depth, legibility (with --flat also that of each picture's own flat build), violations, seconds and peak
memory of whole builds.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from examples.pictures import pictures

__all__ = ["main", "measure"]


def _resident_mb(session: int) -> float:
    """Resident memory of all processes of a build and its children, MB."""
    total = 0.0
    parents: dict[int, int] = {}
    sizes: dict[int, float] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
                parents[int(entry.name)] = int(fields[1])
                sizes[int(entry.name)] = int(fields[21]) * 4096 / 2**20
            except OSError:
                continue
    for process in parents:
        ancestor = process
        while ancestor in parents and ancestor != session:
            ancestor = parents[ancestor]
        if ancestor == session:
            total += sizes[process]
    return total


def measure(picture: Path, out: Path, *options: str) -> dict[str, Any]:
    """One whole build in a process of its own: exit code, seconds, peak memory and the report."""
    begun = time.perf_counter()
    child = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "knotfab",
            "build",
            str(picture),
            "--print",
            "--out",
            str(out),
            "--quiet",
            *options,
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    peak = 0.0
    while child.poll() is None:
        peak = max(peak, _resident_mb(child.pid))
        time.sleep(0.1)
    seconds = time.perf_counter() - begun
    _, error = child.communicate()
    folder = out if child.returncode == 0 else out / "rejected"
    written = folder / "report.json"
    report = json.loads(written.read_text()) if written.is_file() else None
    return {
        "code": child.returncode,
        "seconds": seconds,
        "peak_mb": peak,
        "report": report,
        "error": error.strip(),
    }


def main() -> None:
    """Print the table and its summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--flat", action="store_true", help="build flat as well, for legibility")
    parser.add_argument("--skip-slicer", action="store_true")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    folder = asked.out or Path(tempfile.mkdtemp(prefix="knotfab-table-"))
    folder.mkdir(parents=True, exist_ok=True)
    skipped = ["--skip", "slicer"] if asked.skip_slicer else []
    rows: list[dict[str, float]] = []
    print(f"{'picture':<10} code    IoU  r/width%  depth  leg45  flat45  failed  seconds  peak MB")
    for name, image in pictures().items():
        if asked.names and name not in asked.names:
            continue
        path = folder / f"{name}.png"
        image.save(path)
        got = measure(path, folder / name, *skipped)
        if got["report"] is None:
            print(f"{name:<10} {got['code']:>4}  {got['error']}", flush=True)
            rows.append({"iou": 0.0, "seconds": got["seconds"], "failed": 1.0, "code": got["code"]})
            continue
        report = got["report"]
        view = report["views"][0]
        frame = max(view["width"], view["height"])
        radius = 100 * report["settings"]["tube_radius_mm"] / (180.0 * view["width"] / frame)
        failed = [c["name"] for c in report["checks"] if c["status"] == "fail"]
        flat = None
        if asked.flat:
            other = measure(path, folder / f"{name}-flat", "--depth", "flat", *skipped)["report"]
            flat = other["views"][0]["legibility"]["45"] if other else None
        row = {
            "iou": view["iou_tube"],
            "radius": radius,
            "depth": report["print"]["depth_ratio"],
            "leg": view["legibility"]["45"],
            "failed": len(failed),
            "seconds": got["seconds"],
            "peak": got["peak_mb"],
            "code": got["code"],
        }
        if flat is not None:
            row["drop"] = flat - row["leg"]
        rows.append(row)
        print(
            f"{name:<10} {got['code']:>4}  {row['iou']:.4f}  {radius:7.2f}  {row['depth']:.3f}  "
            f"{row['leg']:.3f}  {'' if flat is None else f'{flat:.3f}':>6}  {len(failed):>6}  "
            f"{row['seconds']:7.1f}  {row['peak']:7.0f}  {' '.join(failed)}",
            flush=True,
        )

    def all_of(key: str) -> list[float]:
        return [row[key] for row in rows if key in row]

    print(
        f"\n{len(rows)} pictures: IoU mean {statistics.mean(all_of('iou')):.4f}, "
        f"least {min(all_of('iou')):.4f}; "
        f"legibility at 45 deg mean {statistics.mean(all_of('leg')):.3f}; depth ratio least "
        f"{min(all_of('depth')):.3f}; failed checks {int(sum(all_of('failed')))}; "
        f"exit codes other than 0: {sum(code != 0 for code in all_of('code'))}"
    )
    print(
        f"seconds median {statistics.median(all_of('seconds')):.1f}, worst {max(all_of('seconds')):.1f}; "
        f"peak memory {max(all_of('peak')):.0f} MB"
    )
    if asked.flat:
        print(f"legibility below the flat build's: least {min(all_of('drop')):.3f}")


if __name__ == "__main__":
    main()
