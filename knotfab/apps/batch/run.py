"""Build many pictures in parallel, skipping what is built and unchanged, and write a page of them all."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import quote

from knotfab.apps.batch.worker import (
    INDEX,
    RECORDS,
    Record,
    Task,
    build_apart,
    list_tasks,
    open_builders,
)
from knotfab.base.disk import at_home, locked, write_whole
from knotfab.base.errors import why_of
from knotfab.base.moves import REJECTED, mend
from knotfab.base.pool import Workers, count_jobs
from knotfab.base.progress import Progress
from knotfab.pipeline.options import ALL_OUT, BuildOptions
from knotfab.report.page import make_environment
from knotfab.report.summary import tell_share
from knotfab_formats.errors import InputError, spelled

POOR = ("coarse", "not recognisable")  # words of a verdict that no green "passed" may hide
_Builder = Callable[[Sequence[Task], Path], Iterator[tuple[Task, Record]]]


def batch(
    pictures: Sequence[str],
    options: BuildOptions,
    jobs: int | None = None,
    cluster: str | None = None,
    spare: Callable[[Path, str, BuildOptions], None] = lambda folder, picture, options: None,
) -> list[Record]:
    """Build each picture into a folder of its name in `options.out`, unless it is built already.

    `batch.json` and `index.html` are kept up to date as builds end. A failed build does not stop the others.

    Args:
        pictures: files, folders of files, or `text:…`.
        jobs: how many builds run in parallel; by default as many as cores and memory allow.
        cluster: address of a Dask scheduler whose workers build instead of this machine.
        spare: raises if a folder holds the build of another picture (`prepare.require_same_picture`).

    Returns:
        One record per picture, in order.

    Raises:
        InputError: options or names are wrong, no scheduler answers, or `options.out` cannot be written or
            holds builds of other pictures.
        MachineError: Dask is not installed.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}", "it is not a positive number", "Give 1 or more")
    left_out: list[str] = []
    tasks, folder = list_tasks(pictures, options, left_out.append), at_home(options.out or ALL_OUT)
    kept = _keep_records(folder, tasks)
    missing = [task for task in tasks if task.name not in kept]
    if not options.force:
        _keep_other_builds(folder, missing, lambda place, name: spare(place, name, options))
    records = dict(kept)
    side_by_side = min(jobs or count_jobs(), len(missing))
    tally = _Tally(len(missing), side_by_side if cluster is None else None)
    with (
        Progress(options.mode) as progress,
        _open_builder(cluster, side_by_side, progress) as build,
    ):
        for sentence in left_out:
            progress.say(sentence)
        if kept:
            progress.say(f"{len(kept)} pictures are built already")
        # a folder that cannot be written is reported before any work
        written = _write(folder, tasks, records)
        try:
            with progress.stage("pictures"):
                for task, record in build(missing, folder):
                    records[task.name] = record
                    progress.say(tally.tell(record))
                    progress.update(tally.done / len(missing))
                    if time.monotonic() > written + 2.0:  # s
                        written = _write(folder, tasks, records)
        except KeyboardInterrupt:
            built = f"{len(records)} of {len(tasks)} pictures are built and stay"
            raise KeyboardInterrupt(built) from None
        finally:
            _write(folder, tasks, records)
    return [records[task.name] for task in tasks]


@contextmanager
def _open_builder(cluster: str | None, jobs: int, progress: Progress) -> Iterator[_Builder]:
    if cluster is None and jobs == 0:  # all is built
        yield lambda tasks, folder: iter(())
        return
    if cluster is None:
        with open_builders(jobs) as builders:
            yield partial(_build_here, builders, progress)
        return
    from knotfab.apps.batch.cluster import open_cluster

    with open_cluster(cluster, progress) as build:
        yield build


def _build_here(
    builders: Workers, progress: Progress, tasks: Sequence[Task], folder: Path
) -> Iterator[tuple[Task, Record]]:

    def build(task: Task) -> Record:
        with progress.line(task.name):
            return build_apart(task, folder / task.name, builders)

    futures: dict[Future[Record], Task] = {builders.submit(build, task): task for task in tasks}
    for future in as_completed(futures):
        yield futures[future], future.result()


def _read_records(folder: Path) -> dict[str, Record]:
    """Read the valid records of batch.json, by name."""
    try:
        found = json.loads((folder / RECORDS).read_text("utf-8"))
        return {r["name"]: r for r in found if _is_record(r)}
    except (OSError, ValueError, TypeError, RecursionError):
        return {}


def _is_record(found: Any) -> bool:
    kinds = {
        "name": str,
        "picture": str,
        "exit_code": int,
        "seconds": float | int,
        "error": str,
        "key": str,
    }
    kinds |= {"iou": float | int | None, "verdict": str | None}
    return isinstance(found, dict) and all(
        key in found and isinstance(found[key], kind) for key, kind in kinds.items()
    )


def _is_there(folder: Path, record: Record) -> bool:
    """Return whether the build that a record describes still lies in its folder, if it left one."""
    place = folder / record["name"] / ("" if record["exit_code"] == 0 else REJECTED)
    left_none = record["exit_code"] not in (0, 1) or record["iou"] is None
    return left_none or (place / "report.json").is_file()


def _keep_records(folder: Path, tasks: Sequence[Task]) -> dict[str, Record]:
    """Return the records of an earlier batch whose key is unchanged and whose result is still there."""
    earlier = _read_records(folder)
    kept = {}
    for task in tasks:
        record = earlier.get(task.name)
        # only these exit codes would come out the same again
        if record is None or record["key"] != task.key or record["exit_code"] not in (0, 1, 2):
            continue
        mend(folder / task.name)
        if _is_there(folder, record):
            kept[task.name] = record
    return kept


def _keep_other_builds(
    folder: Path, tasks: Sequence[Task], spare: Callable[[Path, str], None]
) -> None:
    """Refuse to replace builds of other pictures, whether from a batch or a single build.

    Raises:
        InputError: there is such a build.
    """
    if (folder / "report.json").is_file():
        raise InputError(
            f"--out {folder}",
            "it holds one build itself, and those of a batch lie in folders of their own",
            "Choose another place, or add --force.",
        )
    earlier = _read_records(folder)
    for task in tasks:
        record = earlier.get(task.name)
        if record is None or record["picture"] != spelled(task.picture):
            spare(folder / task.name, task.picture)


def _write(folder: Path, tasks: Sequence[Task], records: dict[str, Record]) -> float:
    """Write batch.json and index.html for the finished builds, and return when that was (`time.monotonic()`).

    Entries of other batches in the same folder are kept.

    Raises:
        InputError: they cannot be written.
    """
    own = {task.name for task in tasks}
    done = [records[task.name] for task in tasks if task.name in records]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            others = [
                r for n, r in _read_records(folder).items() if n not in own and _is_there(folder, r)
            ]
            write_whole(folder / RECORDS, (json.dumps(done + others, indent=1) + "\n").encode())
            write_whole(folder / INDEX, spelled(render_index(done + others, folder)).encode())
    except OSError as error:
        raise InputError(
            f"--out {folder}", f"it cannot be written ({why_of(error)})", "Choose another place."
        ) from error
    return time.monotonic()


@dataclass
class _Tally:
    """Counts finished builds of `missing`, of which `jobs` run in parallel (None: on a cluster)."""

    missing: int
    jobs: int | None
    seconds: list[float] = field(default_factory=list)
    begun: float = field(default_factory=time.perf_counter)

    @property
    def done(self) -> int:
        return len(self.seconds)

    def tell(self, record: Record) -> str:
        """Count one more build, and describe how it ended and how long the others will take."""
        self.seconds.append(record["seconds"])
        left = self.missing - self.done
        if self.jobs is not None and self.done < self.jobs:  # too early to measure the throughput
            rest = median(self.seconds) * -(-left // self.jobs)
        else:
            rest = (time.perf_counter() - self.begun) / self.done * left
        share = _alike(record)
        alike = f" {share}," if share else ""
        text = f"{self.done}/{self.missing} {record['name']}{alike} {record['seconds']:.0f} s"
        if record.get("verdict") in POOR:
            text += f", {record['verdict']}"
        text += "".join(f"; warning: {one}" for one in record.get("warnings", ()))
        if record["exit_code"] != 0:
            text += f": {record['error']}"
        if not left:
            return text
        return text + (f" ({rest / 60:.0f} min left)" if rest >= 90 else f" ({rest:.0f} s left)")


def render_index(records: Sequence[Record], folder: Path) -> str:
    """Render index.html of the records, with links relative to `folder`."""
    cards = [_card(record, folder) for record in records]
    passed = sum(record["exit_code"] == 0 for record in records)
    template = make_environment(Path(__file__).parent).get_template("index.html.j2")
    page: str = template.render(cards=cards, passed=passed)
    return page


def _alike(record: Record) -> str:
    """Say how alike a record's shadow and picture are, as its report does; "" if it has none."""
    share = record.get("alike", record["iou"])
    return "" if share is None else f"{tell_share(share)} alike"


def _card(record: Record, folder: Path) -> dict[str, Any]:
    place = folder / record["name"]
    if record["exit_code"] == 1:
        place = place / REJECTED
    built = record["exit_code"] in (0, 1) and record.get("reported", True)
    shown = sorted(place.glob("compare-*.png"))[:3] if built else []
    word, warnings = record["verdict"], record.get("warnings", ())
    passed, poor = record["exit_code"] == 0, word in POOR
    ended = "passed" if passed else "failed"
    if word:
        ended += f", but {word}" if passed and poor else f", {word}"
    report = place / "report.html"
    return {
        **record,
        "warnings": warnings,
        "alike": _alike(record),
        "colour": "fail" if not passed else "warn" if poor or warnings else "pass",
        "ended": ended,
        "pictures": [quote(path.relative_to(folder).as_posix()) for path in shown],
        "report": quote(report.relative_to(folder).as_posix())
        if built and report.is_file()
        else None,
    }
