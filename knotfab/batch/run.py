"""Build many pictures: those that are missing or have changed, some at a time, and a page of them all."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from knotfab.batch.page import render_index
from knotfab.batch.tasks import Task, list_tasks
from knotfab.batch.worker import Record, build_apart
from knotfab.doctor import count_cores, measure_memory_gb
from knotfab.errors import InputError
from knotfab.files.folder import REJECTED
from knotfab.files.whole import write_whole
from knotfab.options import BuildOptions
from knotfab.progress import Mode, Progress

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
    tally = _Tally(len(missing), side_by_side if cluster is None else None)
    written = 0.0
    mode: Mode = "quiet" if options.quiet else "auto"
    with _open_builder(cluster, side_by_side) as build, Progress(mode) as progress:
        if kept:
            progress.say(f"{len(kept)} pictures are built already")
        try:
            with progress.stage("pictures"):
                for task, record in build(missing, folder):
                    records[task.name] = record
                    progress.say(tally.tell(record))
                    progress.update(tally.done / len(missing))
                    if time.monotonic() > written + _WRITTEN_EVERY_S:
                        _write(folder, tasks, records)
                        written = time.monotonic()
        finally:
            _write(folder, tasks, records)
    return [records[task.name] for task in tasks]


def count_jobs() -> int:
    """Builds that this machine holds side by side: as many as it has cores, and memory for."""
    memory_gb = measure_memory_gb()
    fit = count_cores() if memory_gb is None else int(memory_gb / _BUILD_GB)
    return max(1, min(count_cores(), fit))


@contextmanager
def _open_builder(cluster: str | None, jobs: int) -> Iterator[_Builder]:
    """A function that builds tasks: on this machine, or on a cluster."""
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


@dataclass
class _Tally:
    """Builds that are done of `missing`, `jobs` side by side (None: as many as a cluster has)."""

    missing: int
    jobs: int | None
    seconds: list[float] = field(default_factory=list)
    begun: float = field(default_factory=time.perf_counter)

    @property
    def done(self) -> int:
        return len(self.seconds)

    def tell(self, record: Record) -> str:
        """Count one more, and say how it ended, and how long the others will take."""
        self.seconds.append(record["seconds"])
        left = self.missing - self.done
        if self.jobs is not None and self.done < self.jobs:  # the first ones took no turns yet
            rest = median(self.seconds) * -(-left // self.jobs)
        else:
            rest = (time.perf_counter() - self.begun) / self.done * left
        iou = "" if record["iou"] is None else f" IoU {record['iou']:.3f},"
        text = f"{self.done}/{self.missing} {record['name']}{iou} {record['seconds']:.0f} s"
        if record["exit_code"] != 0:
            text += f": {record['error']}"
        if not left:
            return text
        return text + (f" ({rest / 60:.0f} min left)" if rest >= 90 else f" ({rest:.0f} s left)")
