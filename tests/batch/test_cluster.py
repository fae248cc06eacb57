"""A batch on a real Dask scheduler and workers: whatever is killed, nothing is lost and nothing is twice."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path

import pytest
from played_builds import count, draw, write_player

from knotfab.batch.run import batch
from knotfab.errors import InputError
from knotfab.options import BuildOptions

distributed = pytest.importorskip("distributed")

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


def test_an_address_where_nobody_listens_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("knotfab.batch.cluster._PATIENCE_S", 0.5)
    pictures = draw(tmp_path / "pictures", a="pass")
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        batch([str(pictures)], BuildOptions(out=tmp_path / "out"), cluster="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()


def test_a_worker_that_is_killed_loses_no_picture(tmp_path: Path) -> None:
    script, runs = write_player(tmp_path)
    preload = tmp_path / "preload.py"
    preload.write_text(f"import sys\nsys.executable = {str(script)!r}\n")
    pictures = draw(tmp_path / "pictures", a="pass", b="once", c="fail", d="kill", e="pass")
    options = BuildOptions(out=tmp_path / "out", quiet=True)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, preload=[str(preload)], dashboard_address=None
    ) as cluster:

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
