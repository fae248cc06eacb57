"""Run whole builds on a Dask cluster. Files travel by path if the disk is shared, else by content."""

from __future__ import annotations

import contextlib
import tempfile
import threading
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from knotfab.apps.batch.worker import (
    Record,
    Task,
    build_parcel,
    open_builders,
    pack_task,
    record_of,
    unpack_result,
)
from knotfab.base.errors import MachineError, needs_extra
from knotfab.base.pool import JOB_GB, Workers
from knotfab.base.progress import Progress
from knotfab_formats.errors import InputError

_MEMORY = "MEMORY"  # with --resources MEMORY=8e9 a worker gets as many builds as fit into that
_PATIENCE_S = 10  # for the scheduler to answer
_KEPT_S = 20.0  # for which an idle build process, about a GB, is kept for the next build
_idle: list[tuple[Workers, threading.Timer]] = []  # idle processes, with the timers that end them


@contextmanager
def open_cluster(
    address: str, progress: Progress
) -> Iterator[Callable[[Sequence[Task], Path], Iterator[tuple[Task, Record]]]]:
    """Yield a function that builds tasks on the workers of the scheduler at `address`.

    Raises:
        InputError: no scheduler answers there.
        MachineError: Dask is not installed.
    """
    with needs_extra(f"--cluster {address}", "dask"):
        from distributed import Client, as_completed
    try:
        client = Client(address, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--cluster {address}",
            "no Dask scheduler answers there",
            "Start one (dask scheduler), and give its address, as in tcp://10.0.0.5:8786",
        ) from error

    def build(tasks: Sequence[Task], folder: Path) -> Iterator[tuple[Task, Record]]:
        workers = client.scheduler_info(n_workers=-1)["workers"].values()
        tagged = bool(workers) and all(_MEMORY in w["resources"] for w in workers)
        resources: dict[str, Any] = {"resources": {_MEMORY: JOB_GB * 1e9}} if tagged else {}
        # retried if the worker is lost
        named: dict[str, Any] = {"pure": False, "retries": 3, **resources}
        lines: dict[str, contextlib.ExitStack] = {}

        def begun(event: tuple[Any, str]) -> None:
            name = event[1]
            lines.setdefault(name, contextlib.ExitStack()).enter_context(progress.line(name))

        topic = f"knotfab-{uuid.uuid4().hex}"
        client.subscribe_topic(topic, begun)
        with tempfile.TemporaryDirectory(
            prefix=".cluster-", dir=folder, ignore_cleanup_errors=True
        ) as shared:
            here = Path(shared)
            futures = {
                client.submit(_build_on_worker, pack_task(t, here), t.name, topic, **named): t
                for t in tasks
            }
            for future in as_completed(list(futures), loop=client.loop):
                task = futures.pop(future)
                try:
                    record, result = future.result()
                    unpack_result(record, result, folder / task.name)
                except Exception as error:  # the other tasks go on in any case
                    said = f"its worker was lost ({type(error).__name__}: {error})"
                    record = record_of(task, MachineError.exit_code, 0.0, said)
                lines.pop(task.name, contextlib.ExitStack()).close()
                yield task, record
                future.release()

    with client:
        yield build


@contextmanager
def _keep_builders() -> Iterator[Workers]:
    """Reuse this worker's last build process if it is still there, and keep it for the next build."""
    try:
        pool, leaving = _idle.pop()
        leaving.cancel()
    except IndexError:
        pool = open_builders(1, share=1)
    try:
        yield pool
    except BaseException:
        pool.__exit__()
        raise
    leaving = threading.Timer(_KEPT_S, _end_idle, (pool,))
    leaving.daemon = True
    _idle.append((pool, leaving))
    leaving.start()


def _end_idle(builders: Workers) -> None:
    """End an idle process, unless it has been taken again."""
    for held in list(_idle):
        if held[0] is builders:
            with contextlib.suppress(ValueError):  # taken this moment
                _idle.remove(held)
                builders.__exit__()


def _build_on_worker(parcel: bytes, name: str, topic: str) -> tuple[Record, bytes]:
    """Build a parcel on this worker, and stop if nobody waits for the result any more."""
    from distributed import get_worker

    worker = get_worker()
    worker.log_event(topic, name)
    key = worker.get_current_task()
    with _keep_builders() as pool:
        building = pool.submit(build_parcel, parcel, pool)
        while not wait([building], 0.5).done:
            task = worker.state.tasks.get(key)
            if task is None or task.state not in ("executing", "long-running"):
                raise RuntimeError("nobody waits for it")
        return building.result()
