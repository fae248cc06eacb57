"""Builds on a Dask cluster: whole builds as tasks, pictures sent and folders fetched by content."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from knotfab.batch.tasks import Task
from knotfab.batch.worker import (
    Record,
    build_parcel,
    pack_task,
    record_of,
    unpack_result,
)
from knotfab.errors import InputError, MachineError, needs_extra

__all__ = ["open_cluster"]

_MEMORY = "MEMORY"  # a worker started with --resources MEMORY=8e9 is given as many builds as fit
_BUILD_BYTES = 2e9
_RETRIES = 3  # of a build whose worker was lost
_PATIENCE_S = 10  # for the scheduler to answer


@contextmanager
def open_cluster(
    address: str,
) -> Iterator[Callable[[Sequence[Task], Path], Iterator[tuple[Task, Record]]]]:
    """A function that builds tasks on the workers of the scheduler at `address`.

    Raises:
        InputError: nobody answers there; MachineError: Dask is not installed.
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
        resources: dict[str, Any] = {"resources": {_MEMORY: _BUILD_BYTES}} if tagged else {}
        futures = {
            client.submit(build_parcel, pack_task(t), pure=False, retries=_RETRIES, **resources): t
            for t in tasks
        }
        for future in as_completed(list(futures), loop=client.loop):
            task = futures.pop(future)
            try:
                record, result = future.result()
                unpack_result(record, result, folder / task.name)
            except Exception as error:  # whatever a cluster may do to a task, the others go on
                said = f"its worker was lost ({type(error).__name__}: {error})"
                record = record_of(task, MachineError.exit_code, 0.0, said)
            yield task, record
            future.release()

    with client:
        yield build
