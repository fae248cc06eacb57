"""The pool: what is left is ended, what waits is dropped, and a worker that dies says how."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import CancelledError
from types import ModuleType, SimpleNamespace

import pytest

from knotfab import pool
from knotfab.pool import Crash, Pool, Workers, count_cores, count_jobs, measure_memory_gb

SLEEP = [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
# answers with what was asked and who it is; "die" and "wait" are commands
ECHO = """
import json, os, sys, time
for line in sys.stdin:
    asked = json.loads(line)
    if asked.get("die"):
        print("no more memory", file=sys.stderr)
        os._exit(7)
    time.sleep(asked.get("wait", 0))
    print(json.dumps({"asked": asked, "pid": os.getpid()}), flush=True)
"""
ANSWER = [sys.executable, "-S", "-c", ECHO]


def test_leaving_ends_what_runs_and_drops_what_waits() -> None:
    with Pool(1) as running:
        started: list[subprocess.Popen[str]] = []

        def mind() -> int:
            started.append(running.start(SLEEP))
            return started[-1].wait()

        first, waiting = running.submit(mind), running.submit(mind)
        while not started:
            time.sleep(0.01)
    assert first.result() != 0 and len(started) == 1
    with pytest.raises(CancelledError):
        waiting.result()
    late = running.start(SLEEP)  # by a thread that had not noticed
    assert late.wait(10) != 0


def test_workers_share_the_requests_and_each_gets_its_own_answer() -> None:
    with Workers(ANSWER, 2) as workers:
        answers = [workers.ask({"k": k, "wait": 0.05}) for k in range(6)]
        found = [answer.result() for answer in answers]
    assert [one["asked"]["k"] for one in found] == list(range(6))
    assert len({one["pid"] for one in found}) == 2


def test_a_worker_that_dies_says_how_and_is_replaced() -> None:
    with Workers(ANSWER) as workers:
        for _ in range(2):
            with pytest.raises(Crash, match="no more memory") as caught:
                workers.ask({"die": True}).result()
            assert caught.value.code == 7
            assert workers.ask({"k": 1}).result()["asked"] == {"k": 1}


def test_as_many_as_cores_and_memory_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KNOTFAB_JOBS", raising=False)
    monkeypatch.setattr(pool, "count_cores", lambda: 8)
    for memory_gb, jobs in ((None, 8), (64.0, 8), (7.0, 3), (1.0, 1)):
        monkeypatch.setattr(pool, "measure_memory_gb", lambda gb=memory_gb: gb)
        assert count_jobs() == jobs
    monkeypatch.setenv("KNOTFAB_JOBS", "1")  # as a batch tells its builds
    assert count_jobs() == 1


def test_a_system_without_sysconf_or_affinity(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Windows has it: psutil knows the memory, where it is installed; else it is unknown."""
    told = ModuleType("psutil")
    told.virtual_memory = lambda: SimpleNamespace(total=3 * 2**30)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "psutil", told)
    for name in ("sysconf", "sched_getaffinity"):
        monkeypatch.delattr(os, name, raising=False)
    assert count_cores() == os.cpu_count()
    assert measure_memory_gb() == 3.0
    monkeypatch.setitem(sys.modules, "psutil", None)
    assert measure_memory_gb() is None
