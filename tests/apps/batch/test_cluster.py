"""A batch on a real Dask scheduler and workers: whatever is killed, nothing is lost and nothing is twice."""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import distributed
import psutil
import pytest
from command import knotfab
from played_runs import count, draw, write_player

from knotfab.apps.batch import run
from knotfab.apps.batch.run import batch
from knotfab.pipeline.options import BuildOptions
from knotfab_formats.errors import InputError

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


@contextmanager
def play_cluster(tmp_path: Path, **more: Any) -> Iterator[tuple[Any, Path]]:
    """A cluster whose builds are played, and the folder in which a line a run is kept."""
    script, runs = write_player(tmp_path)
    preload = tmp_path / "preload.py"
    preload.write_text(f"import sys\nsys.executable = {str(script)!r}\n")
    with distributed.LocalCluster(
        preload=[str(preload)], dashboard_address=None, **more
    ) as cluster:
        yield cluster, runs


def test_an_address_where_nobody_listens_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("knotfab.apps.batch.run._PATIENCE_S", 0.5)
    pictures = draw(tmp_path / "pictures", a="pass")
    cluster = ("--cluster", "tcp://127.0.0.1:1")
    done = knotfab("batch", pictures, "--out", tmp_path / "out", *cluster)
    assert done.code == 2 and done.err.count("\n") == 1
    assert "--cluster tcp://127.0.0.1:1: no Dask scheduler answers there. Start one" in done.err
    assert not (tmp_path / "out").exists()


def test_a_cluster_that_does_not_see_the_pictures_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = draw(tmp_path / "pictures", a="pass")
    monkeypatch.setattr(sys, "executable", sys.executable)  # which a worker in this process plays
    with play_cluster(tmp_path, n_workers=1, processes=False) as (cluster, runs):
        monkeypatch.setattr("knotfab.apps.batch.run.list_missing", lambda paths: paths[:1])
        options = BuildOptions(out=tmp_path / "out", quiet=True)
        with pytest.raises(InputError, match=r"is not there\. Mount the folders"):
            batch([str(pictures)], options, cluster=cluster.scheduler_address)
    assert not count(runs) and not (tmp_path / "out").exists()


def test_this_machines_own_cluster_is_heard_by_no_other(tmp_path: Path) -> None:
    with run._open_client(None, 2):
        heard = [c.laddr.ip for c in psutil.Process().net_connections() if c.status == "LISTEN"]
    assert set(heard) <= {"127.0.0.1", "::1"}


def test_a_worker_that_is_killed_loses_no_picture(tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="once", c="fail", d="kill", e="pass")
    options = BuildOptions(out=tmp_path / "out", quiet=True)
    with play_cluster(tmp_path, n_workers=2, threads_per_worker=1) as (cluster, runs):

        def kill_the_builder() -> None:
            """Kill the worker that builds b, while it waits."""
            began = runs / "b.runs"
            patience = time.monotonic() + 60
            while not began.exists() and time.monotonic() < patience:
                time.sleep(0.05)
            os.kill(int((runs / "b.parent").read_text()), signal.SIGKILL)

        killer = threading.Thread(target=kill_the_builder)
        killer.start()
        records = batch([str(pictures)], options, cluster=cluster.scheduler_address)
        killer.join()
        assert [r["exit_code"] for r in records] == [0, 0, 1, 128 + signal.SIGKILL, 0]
        assert count(runs) == {"a": 1, "b": 2, "c": 1, "d": 2, "e": 1}
        assert json.loads((tmp_path / "out" / "batch.json").read_text()) == records
        assert (tmp_path / "out" / "b" / "report.json").is_file()
        (pictures / "d.png").write_text("pass")
        again = batch([str(pictures)], options, cluster=cluster.scheduler_address)
    assert [r["exit_code"] for r in again] == [0, 0, 1, 0, 0]
    assert count(runs) == {"a": 1, "b": 2, "c": 1, "d": 3, "e": 1}


def test_an_interrupted_client_ends_its_builds_and_goes_on_later(tmp_path: Path) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="wait", c="wait")
    out = tmp_path / "out"
    options = BuildOptions(out=out, quiet=True)
    with play_cluster(tmp_path, n_workers=1, threads_per_worker=1) as (cluster, runs):

        def waits() -> set[str]:
            return set(count(runs)) & {"b", "c"}

        def interrupt() -> None:
            """Interrupt the client as soon as one picture waits and those before it have come back."""
            patience = time.monotonic() + 150
            while time.monotonic() < patience:
                time.sleep(0.2)
                home = {path.parent.name for path in out.glob("*/report.json")}
                if waits() and home == set(count(runs)) - waits():
                    time.sleep(1.0)  # its record comes after its files
                    break
            os.kill(os.getpid(), signal.SIGINT)

        interrupter = threading.Thread(target=interrupt)
        interrupter.start()
        with pytest.raises(KeyboardInterrupt, match="of 3 pictures are built and stay"):
            batch([str(pictures)], options, cluster=cluster.scheduler_address)
        interrupter.join()
        (waited,) = waits()  # one at a time
        written = json.loads((out / "batch.json").read_text())
        assert {r["name"] for r in written} == set(count(runs)) - {waited}
        (process,) = (worker.pid for worker in cluster.workers.values())
        patience = time.monotonic() + 120
        while left := psutil.Process(process).children():
            assert time.monotonic() < patience, left
            time.sleep(0.05)
        draw(pictures, b="pass", c="pass")
        records = batch([str(pictures)], options, cluster=cluster.scheduler_address)
    assert [r["exit_code"] for r in records] == [0, 0, 0]
    assert count(runs) == {"a": 1, "b": 1, "c": 1, waited: 2}
    assert all((out / name / "report.json").is_file() for name in "abc")
    assert not list(out.glob(".*"))
