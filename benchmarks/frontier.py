"""What accuracy costs in time on the project's own pictures: the front that the presets are points of.

`python -m benchmarks.frontier [--kept DIR] [--write DIR] [--time-limit T] [NAME ...]` (`make frontier`)
measures as `knotfab tradeoff` does. What is built is kept in DIR, and an interrupted study goes on. It
prints the table and writes frontier.json and frontier.png.
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

NAMES = ("knight", "cat", "heart", "teapot", "anchor", "wheel")


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
        ways = tradeoff(
            sources, kept, {}, PRESETS["standard"], "standard", progress, limit_s=limit_s
        )
    print_ways(ways, kept)
    if write is not None:
        for suffix in ("json", "png"):
            write_whole(write / f"frontier.{suffix}", (kept / f"tradeoff.{suffix}").read_bytes())


if __name__ == "__main__":
    run_study(main)
