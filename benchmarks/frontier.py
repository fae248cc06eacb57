"""What accuracy costs in time on the project's own pictures: the fronts that the presets are points of.

`python -m benchmarks.frontier [NAME ...] [--kept DIR] [--write DIR] [--time-limit T]` (`make frontier`)
measures as `knotfab tradeoff` does, first with `--print` for the first picture, then without for all. Of the
time limit the first takes up to two fifths. What is built is kept in DIR, and an interrupted study goes on.
It prints the tables and writes frontier-print and frontier, each as .json and .png.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.measurement import run_study, save_pictures
from examples.pictures import pictures
from knotfab.apps.tradeoff.run import print_ways, tradeoff
from knotfab.base.disk import write_whole
from knotfab.base.progress import Progress
from knotfab.pipeline.values import read_seconds
from knotfab_formats.search import PRESETS

NAMES = ("knight", "cat")


def main(
    *names: str,
    kept: Path = Path("out/frontier"),
    write: Path | None = None,
    time_limit: str | None = None,
) -> None:
    """Build, write and print."""
    drawn = pictures()
    (kept / "drawn").mkdir(parents=True, exist_ok=True)
    files = save_pictures({name: drawn[name] for name in (names or NAMES)}, kept / "drawn")
    limit_s = None if time_limit is None else read_seconds(time_limit, "--time-limit")
    sources = [str(file) for file in files.values()]
    with Progress("verbose") as progress:
        for name, printed, share in (("frontier-print", True, 0.4), ("frontier", False, 1.0)):
            left = None if limit_s is None else share * (limit_s - progress.total)
            ways = tradeoff(
                sources[:1] if printed else sources,
                kept / name,
                {},
                PRESETS["standard"],
                "standard",
                progress,
                printed,
                left,
            )
            print_ways(ways, kept / name)
            if write is not None:
                for suffix in ("json", "png"):
                    found = (kept / name / f"tradeoff.{suffix}").read_bytes()
                    write_whole(write / f"{name}.{suffix}", found)


if __name__ == "__main__":
    run_study(main)
