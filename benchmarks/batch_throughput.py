"""Pictures an hour: single builds, `knotfab batch`, and a cluster that loses a worker, side by side.

`python -m benchmarks.batch_throughput [--pictures 40] [--jobs 2] [--kept FILE] [OPTION ...]` builds the
project's own pictures, mirrored and turned where more are asked for, with the OPTIONs of `knotfab build`, and
prints for each way the pictures an hour, whether the files are those of the single builds, byte for byte, and
the pool's overhead: what a batch of one job takes a picture beside its build, from start to end.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from PIL import Image, ImageOps

from benchmarks.measurement import Stopwatch, run_study, save_pictures
from examples.pictures import pictures

# files of a build without times and commands
SAME = ("part.stl", "part.3mf", "knots.json", "scene.toml", "slicer.ini")
FEW = 2  # pictures of the batch of one job


def draw_pictures(count: int) -> dict[str, Image.Image]:
    """Draw so many different pictures: the project's own, then mirrored, then turned."""
    own = pictures()
    drawn = dict(own)
    drawn |= {f"{name}-mirrored": ImageOps.mirror(image) for name, image in own.items()}
    drawn |= {f"{name}-turned": ImageOps.flip(image) for name, image in own.items()}
    return dict(islice(drawn.items(), count))


def read_files(folder: Path) -> dict[str, bytes]:
    """Read what a build wrote, of the files that it writes the same each time; of a rejected one its own."""
    places = [folder / name for name in SAME] + [folder / "rejected" / name for name in SAME]
    return {str(p.relative_to(folder)): p.read_bytes() for p in places if p.is_file()}


def count_same(names: Sequence[str], one: Path, other: Path) -> int:
    """Return the pictures of which both ways wrote the same files, and wrote any."""
    return sum(bool(a := read_files(one / n)) and a == read_files(other / n) for n in names)


def run(*arguments: str | Path) -> float:
    """Return seconds that `knotfab ARGUMENTS` takes, from the start of its process to the end."""
    watch = Stopwatch()
    command = [sys.executable, "-P", "-m", "knotfab", *map(str, arguments), "--quiet"]
    subprocess.run(command, check=False)
    return watch.wall_s


def run_cluster(files: Sequence[Path], out: Path, options: Sequence[str], workers: int) -> float:
    """Return seconds of a batch on a cluster of this machine, one of whose workers is killed as it builds."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        victim = next(iter(cluster.workers.values()))

        def kill() -> None:
            """Wait until the first picture is there, so that each worker builds its second or third."""
            while not list(out.glob("*/report.json")):
                time.sleep(0.1)
            os.kill(victim.pid, signal.SIGKILL)

        threading.Thread(target=kill, daemon=True).start()
        address = ("--cluster", cluster.scheduler_address)
        return run("batch", *files, "--out", out, *address, *options)


def main(
    *options: Annotated[str, Parameter(allow_leading_hyphen=True)],
    pictures: int = 40,
    jobs: int = 2,
    kept: Path | None = None,
) -> None:
    """Build, and print the table; the figures into the JSON file `kept`."""
    found: dict[str, Any] = {"pictures": pictures, "jobs": jobs, "options": options}
    with tempfile.TemporaryDirectory(prefix="knotfab-throughput-") as place:
        here = Path(place)
        (here / "drawn").mkdir()
        drawn = save_pictures(draw_pictures(pictures), here / "drawn")
        names, files = list(drawn), list(drawn.values())
        ways = {name: here / name for name in ("single", "batch", "cluster")}
        seconds = {
            "single": sum(
                run("build", f, "--out", ways["single"] / f.stem, *options) for f in files
            ),
            "batch": run("batch", *files, "--out", ways["batch"], "--jobs", str(jobs), *options),
            "cluster": run_cluster(files, ways["cluster"], options, jobs),
        }
        for way, folder in ways.items():
            hourly = 3600 * len(names) / seconds[way]
            found[way] = {"seconds": seconds[way], "an_hour": hourly}
            line = f"{way:<8} {seconds[way]:8.1f} s  {hourly:7.1f} pictures an hour"
            if way != "single":
                same = count_same(names, ways["single"], folder)
                records = json.loads((folder / "batch.json").read_text())
                found[way] |= {"times": seconds["single"] / seconds[way], "same": same}
                line += f"  {found[way]['times']:.2f} times as many  {same} of {len(names)} the same files"
                line += f"  {len(records)} records"
            print(line, flush=True)
        few = here / "few"
        alone = run("batch", *files[:FEW], "--out", few, "--jobs", "1", *options)
        records = json.loads((few / "batch.json").read_text())
        overhead = (alone - sum(r["seconds"] for r in records)) / len(records)
        found["overhead_s"] = overhead
        print(f"The pool takes {overhead:.2f} s a picture, of {len(records)} one after the other")
    if kept is not None:
        kept.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    run_study(main)
