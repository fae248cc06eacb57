"""Build many pictures on a Dask cluster, this machine's own or another, and write a page of them all."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import quote

from pydantic import BaseModel, ConfigDict, ValidationError

from knotfab.apps.batch.worker import (
    Record,
    Task,
    build_on_worker,
    end_idle,
    list_missing,
    list_tasks,
    record_of,
)
from knotfab.base.disk import at_home, locked, temporary_folder, write_whole
from knotfab.base.errors import MachineError, why_of
from knotfab.base.moves import REJECTED, mend
from knotfab.base.pool import count_jobs
from knotfab.base.progress import Progress
from knotfab.pipeline.options import ALL_OUT, BuildOptions
from knotfab.report.page import make_environment
from knotfab_formats.errors import InputError, spelled
from knotfab_formats.verdict import POOR

RECORDS, INDEX = "batch.json", "index.html"  # files beside the folders of the pictures
_HERE = "127.0.0.1:0"  # where a cluster of this machine's own tells how it is: no other can ask
_PATIENCE_S = 10  # for a scheduler to answer


class _Record(BaseModel):
    """What an earlier batch's record must hold to be read."""

    model_config = ConfigDict(extra="allow", strict=True)

    name: str
    picture: str
    exit_code: int
    seconds: float
    iou: float | None
    verdict: str | None
    rows: list[dict[str, str]]
    reported: bool
    error: str
    key: str


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
        jobs: how many builds run in parallel on this machine; by default as many as cores and memory allow.
        cluster: address of a Dask scheduler whose workers build instead of this machine.
        spare: raises if a folder holds the build of another picture (`prepare.require_same_picture`).

    Returns:
        One record per picture, in order.

    Raises:
        InputError: options or names are wrong, no scheduler answers, or `options.out` cannot be written or
            holds builds of other pictures.
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}", "it is not a positive number", "Give 1 or more")
    left_out: list[str] = []
    tasks, folder = list_tasks(pictures, options, left_out.append), at_home(options.out or ALL_OUT)
    records = _keep_records(folder, tasks)
    missing = [task for task in tasks if task.name not in records]
    if not options.force:
        _spare_other_builds(folder, missing, lambda place, name: spare(place, name, options))
    with Progress(options.mode) as progress, ExitStack() as opened:
        jobs = min(jobs or count_jobs(), len(missing))
        client: Any = opened.enter_context(_open_client(cluster, jobs)) if missing else None
        if cluster is not None and missing:
            _require_shared(client, missing, folder)
        for sentence in left_out:
            progress.say(sentence)
        if records:
            progress.say(f"{len(records)} pictures are built already")
        # a folder that cannot be written is reported before any work
        written, seconds = _write(folder, tasks, records), list[float]()
        try:
            with progress.stage("pictures"):
                for task, record in _build_all(client, missing, folder, cluster is None):
                    records[task.name] = record
                    seconds.append(record["seconds"])
                    left = -(-(len(missing) - len(seconds)) // sum(client.nthreads().values()))
                    told = f"{len(seconds)}/{len(missing)} {_tell(record)}"
                    progress.say(told + _tell_left(median(seconds) * left))
                    progress.update(len(seconds) / len(missing))
                    if time.monotonic() > written + 2.0:  # s
                        written = _write(folder, tasks, records)
        except KeyboardInterrupt:
            built = f"{len(records)} of {len(tasks)} pictures are built and stay"
            raise KeyboardInterrupt(built) from None
        finally:
            _write(folder, tasks, records)
    return [records[task.name] for task in tasks]


@contextmanager
def _open_client(address: str | None, jobs: int) -> Iterator[Any]:
    """Connect to a scheduler; without an address to one in this process, where no other machine reaches it.

    Raises:
        InputError: no scheduler answers there.
    """
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        if address is None:
            cluster = LocalCluster(
                processes=False, n_workers=1, threads_per_worker=jobs, memory_limit=0, silence_logs=50,
                dashboard_address=_HERE, worker_dashboard_address=_HERE,
                local_directory=str(stack.enter_context(temporary_folder("knotfab-batch-"))),
            )  # fmt: skip
            address = stack.enter_context(cluster)
        try:
            client = Client(address, timeout=_PATIENCE_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--cluster {address}",
                "no Dask scheduler answers there",
                "Start one (dask scheduler), and give its address, as in tcp://10.0.0.5:8786",
            ) from error
        with client:
            try:
                yield client
            finally:
                client.run(end_idle)


def _build_all(
    client: Any, tasks: Sequence[Task], folder: Path, here: bool
) -> Iterator[tuple[Task, Record]]:
    """Build tasks on the client's workers, and yield each with its record as it ends.

    Args:
        here: whether the workers are this process's own, which share this machine and its files.
    """
    if not tasks:
        return
    from distributed import as_completed

    share = max(1, count_jobs() // sum(client.nthreads().values())) if here else 1
    place = folder.absolute()
    futures = {
        # again if the worker is lost
        client.submit(build_on_worker, task, place / task.name, share, pure=False, retries=3): task
        for task in tasks
    }
    try:
        for future in as_completed(list(futures), loop=client.loop):
            task = futures[future]
            try:
                record = future.result()
            except Exception as error:  # the other tasks go on in any case
                said = f"its worker was lost ({type(error).__name__}: {error})"
                record = record_of(task, MachineError.exit_code, 0.0, said)
            yield task, record
            del futures[future]
    finally:
        client.cancel(list(futures))


def _require_shared(client: Any, tasks: Sequence[Task], folder: Path) -> None:
    """Refuse a cluster of which a worker does not see the folder or the pictures.

    Raises:
        InputError: one does not.
    """
    place = folder.absolute()
    there = next(str(path) for path in (place, *place.parents) if path.exists())
    paths = [there, *(task.source for task in tasks if os.path.exists(task.source))]
    for worker, missing in client.run(list_missing, paths).items():
        if missing:
            raise InputError(
                f"--cluster: the worker {worker}",
                f"{missing[0]} is not there",
                "Mount the folders of pictures and pieces on each worker, by the same paths.",
            )


def _read_records(folder: Path) -> dict[str, Record]:
    """Read the valid records of batch.json, by name."""
    found: dict[str, Record] = {}
    with suppress(OSError, ValueError, TypeError, RecursionError):
        for one in json.loads((folder / RECORDS).read_text("utf-8")):
            with suppress(ValidationError):
                found[one["name"]] = _Record.model_validate(one).model_dump()
    return found


def _is_there(folder: Path, record: Record) -> bool:
    """Return whether the build that a record describes still lies in its folder, if it left one."""
    place = folder / record["name"] / ("" if record["exit_code"] == 0 else REJECTED)
    left_none = record["exit_code"] not in (0, 1) or record["iou"] is None
    return left_none or (place / "report.json").is_file()


def _keep_records(folder: Path, tasks: Sequence[Task]) -> dict[str, Record]:
    """Return the records of an earlier batch whose key is unchanged and whose result is still there."""
    earlier, kept = _read_records(folder), {}
    for task in tasks:
        record = earlier.get(task.name)
        # only these exit codes would come out the same again
        if record is None or record["key"] != task.key or record["exit_code"] not in (0, 1, 2):
            continue
        mend(folder / task.name)
        if _is_there(folder, record):
            kept[task.name] = record
    return kept


def _spare_other_builds(
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
        if task.name not in earlier or earlier[task.name]["picture"] != spelled(task.picture):
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
            earlier = _read_records(folder).items()
            done += [r for n, r in earlier if n not in own and _is_there(folder, r)]
            write_whole(folder / RECORDS, (json.dumps(done, indent=1) + "\n").encode())
            write_whole(folder / INDEX, spelled(render_index(done, folder)).encode())
    except OSError as error:
        raise InputError(
            f"--out {folder}", f"it cannot be written ({why_of(error)})", "Choose another place."
        ) from error
    return time.monotonic()


def _tell(record: Record) -> str:
    said = [row["text"] for row in record["rows"]] or [record["error"]]
    return f"{record['name']} {record['seconds']:.0f} s: {'; '.join(filter(None, said)) or 'built'}"


def _tell_left(seconds: float) -> str:
    if not seconds:
        return ""
    return f" ({seconds / 60:.0f} min left)" if seconds >= 90 else f" ({seconds:.0f} s left)"


def render_index(records: Sequence[Record], folder: Path) -> str:
    """Render index.html of the records, with links relative to `folder`."""
    template = make_environment(Path(__file__).parent).get_template("index.html.j2")
    passed = sum(record["exit_code"] == 0 for record in records)
    page: str = template.render(cards=[_card(r, folder) for r in records], passed=passed)
    return page


def _card(record: Record, folder: Path) -> dict[str, Any]:
    place = folder / record["name"] / (REJECTED if record["exit_code"] == 1 else "")
    built = record["exit_code"] in (0, 1) and record["reported"]
    word, passed = record["verdict"], record["exit_code"] == 0
    poor = word in POOR or any(row["status"] == "warn" for row in record["rows"])
    files = sorted(place.glob("compare-*.png"))[:3] if built else []
    shown = [quote(path.relative_to(folder).as_posix()) for path in (*files, place / "report.html")]
    return {
        **record,
        "colour": "fail" if not passed else "warn" if poor else "pass",
        "ended": ", ".join(filter(None, ["passed" if passed else "failed", word])),
        "pictures": shown[:-1],
        "report": shown[-1] if built and (place / "report.html").is_file() else None,
    }
