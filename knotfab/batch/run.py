"""Build many pictures: those that are missing or have changed, some at a time, and a page of them all."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from knotfab.batch.page import render_index
from knotfab.batch.tasks import Task, list_tasks
from knotfab.batch.worker import Record, build_apart
from knotfab.errors import InputError
from knotfab.files.folder import REJECTED
from knotfab.files.whole import write_whole
from knotfab.options import BuildOptions

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

__all__ = ["batch", "count_jobs"]

_BUILD_GB = 2.0  # memory of a build
_WRITTEN_EVERY_S = 2.0
_FINAL = (0, 1, 2)  # exit codes that the same picture and options end with again
_Builder = Callable[[Sequence[Task], Path], Iterator[tuple[Task, Record]]]


def batch(
    pictures: Sequence[str],
    options: BuildOptions,
    jobs: int | None = None,
    cluster: str | None = None,
) -> list[Record]:
    """Build each picture into a folder of its name in `options.out`, but those that are there already.

    `batch.json` and `index.html` are written anew as builds end; one that fails does not stop the others.

    Args:
        pictures: files, folders of files, or `text:…`.
        jobs: builds side by side; None: as many as cores and memory allow.
        cluster: address of a Dask scheduler that builds instead of this machine.

    Returns:
        A record a picture, in their order.

    Raises:
        InputError: wrong options or names; MachineError: no Dask, or nobody at its address.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}", "it is not a positive number", "Give 1 or more")
    tasks, folder = list_tasks(pictures, options), options.out.expanduser()
    kept = _keep_records(folder, tasks)
    missing = [task for task in tasks if task.name not in kept]
    records = dict(kept)
    side_by_side = jobs or count_jobs()
    written = 0.0
    with _opened(cluster, side_by_side) as build, _Account(len(missing), options.quiet) as account:
        account.begin(len(kept), side_by_side if cluster is None else None)
        try:
            for task, record in build(missing, folder):
                records[task.name] = record
                account.tell(record)
                if time.monotonic() > written + _WRITTEN_EVERY_S:
                    _write(folder, tasks, records)
                    written = time.monotonic()
        finally:
            _write(folder, tasks, records)
    return [records[task.name] for task in tasks]


def count_jobs() -> int:
    """Builds that this machine holds side by side: as many as it has cores, and memory for."""
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else (os.cpu_count() or 1)
    try:
        memory_gb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, OSError, ValueError):
        return cores
    return max(1, min(cores, int(memory_gb / _BUILD_GB)))


@contextmanager
def _opened(cluster: str | None, jobs: int) -> Iterator[_Builder]:
    """Whoever builds: this machine, or a cluster."""
    if cluster is None:
        yield lambda tasks, folder: _build_here(tasks, folder, jobs)
        return
    from knotfab.batch.cluster import open_cluster

    with open_cluster(cluster) as build:
        yield build


def _build_here(tasks: Sequence[Task], folder: Path, jobs: int) -> Iterator[tuple[Task, Record]]:
    """Each task in a process of its own, `jobs` at a time; an interrupted batch ends them all."""
    running: set[subprocess.Popen[str]] = set()
    stopped = threading.Event()

    def started(child: subprocess.Popen[str]) -> None:
        running.add(child)
        if stopped.is_set():
            child.terminate()

    with ThreadPoolExecutor(jobs) as pool:
        futures: dict[Future[Record], Task] = {
            pool.submit(build_apart, task, folder / task.name, started): task for task in tasks
        }
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            stopped.set()
            for future in futures:
                future.cancel()
            for child in list(running):
                child.terminate()
            raise


def _keep_records(folder: Path, tasks: Sequence[Task]) -> dict[str, Record]:
    """The records of an earlier batch that still hold: same key, and what was built is there."""
    try:
        earlier = {r["name"]: r for r in json.loads((folder / "batch.json").read_text())}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    kept = {}
    for task in tasks:
        record = earlier.get(task.name)
        if record is None or record.get("key") != task.key or record["exit_code"] not in _FINAL:
            continue
        place = folder / task.name / ("" if record["exit_code"] == 0 else REJECTED)
        if record["exit_code"] == 2 or (place / "report.json").is_file() or record["iou"] is None:
            kept[task.name] = record
    return kept


def _write(folder: Path, tasks: Sequence[Task], records: dict[str, Record]) -> None:
    """batch.json and index.html of what is done, in the order of the tasks."""
    done = [records[task.name] for task in tasks if task.name in records]
    write_whole(folder / "batch.json", (json.dumps(done, indent=1) + "\n").encode())
    write_whole(folder / "index.html", render_index(done, folder).encode())


class _Account(AbstractContextManager["_Account"]):
    """What a person is told while it runs: a line for each that is done, and the time left."""

    def __init__(self, missing: int, quiet: bool) -> None:
        self._missing, self._quiet = missing, quiet
        self._seconds: list[float] = []
        self._bars: Bars | None = None
        self._jobs: int | None = 1
        self._begun = time.perf_counter()

    def __enter__(self) -> _Account:
        if not self._quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
            from rich.progress import Progress as Bars

            left = TextColumn("{task.fields[left]}")
            columns = (TextColumn("pictures"), BarColumn(), MofNCompleteColumn(), left)
            self._bars = Bars(*columns, console=Console(stderr=True), transient=True)
            self._bars.start()
            self._bar = self._bars.add_task("", total=self._missing, left="")
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def begin(self, kept: int, jobs: int | None) -> None:
        """Say what is to be done; `jobs` side by side, None: as many as a cluster has."""
        if kept:
            self._say(f"{kept} pictures are built already")
        self._jobs = jobs

    def tell(self, record: Record) -> None:
        """Say how one ended."""
        self._seconds.append(record["seconds"])
        done = len(self._seconds)
        rest = (time.perf_counter() - self._begun) / done * (self._missing - done)
        if (
            self._jobs is not None and done < self._jobs
        ):  # none of the first has paid for its turn yet
            rest = median(self._seconds) * -(-(self._missing - done) // self._jobs)
        left = f"{rest / 60:.0f} min left" if rest >= 90 else f"{rest:.0f} s left"
        iou = "" if record["iou"] is None else f" IoU {record['iou']:.3f},"
        end = "" if record["exit_code"] == 0 else f": {record['error']}"
        self._say(
            f"{done}/{self._missing} {record['name']}{iou} {record['seconds']:.0f} s"
            f"{end}{'' if self._bars or done == self._missing else f' ({left})'}"
        )
        if self._bars is not None:
            self._bars.update(self._bar, completed=done, left=left)

    def _say(self, line: str) -> None:
        if self._quiet:
            return
        if self._bars is not None:
            self._bars.console.print(line, markup=False, highlight=False)
        else:
            print(line, file=sys.stderr, flush=True)
