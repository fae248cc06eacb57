"""The pool: what is left is ended, what waits is dropped, and a worker that dies says how."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from knotfab.base import pool
from knotfab.base.pool import Crash, Pool, Workers, count_cores, count_jobs, measure_memory_gb

SLEEP = [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
# answers with what was wanted and who it is; "die" and "wait" are commands
ECHO = """
import json, os, sys, time
for line in sys.stdin:
    asked = json.loads(line)
    if asked.get("die"):
        print("no more memory", file=sys.stderr)
        os._exit(7)
    time.sleep(asked.get("wait", 0))
    token = asked.pop("asked")
    print(json.dumps({"wanted": asked, "pid": os.getpid(), "asked": token}), flush=True)
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
    assert [one["wanted"]["k"] for one in found] == list(range(6))
    assert len({one["pid"] for one in found}) == 2


def test_a_worker_that_dies_says_how_and_is_replaced() -> None:
    with Workers(ANSWER) as workers:
        for _ in range(2):
            with pytest.raises(Crash, match="no more memory") as caught:
                workers.ask({"die": True}).result()
            assert caught.value.code == 7
            assert workers.ask({"k": 1}).result()["wanted"] == {"k": 1}


def test_a_worker_that_does_not_say_what_it_answers_is_not_waited_for() -> None:
    silent = [*ANSWER[:-1], ECHO.replace('"asked": token', '"k": 1')]
    with Workers(silent) as workers, pytest.raises(Crash, match="not what it was asked"):
        workers.answer({})


def test_a_lent_worker_answers_and_stays_its_owners() -> None:
    with Workers(ANSWER) as owner:
        lent = owner.lend()
        for k in range(2):
            with Workers(ANSWER, lent=lent) as workers:
                assert workers.ask({"k": k}).result()["pid"] == lent.pid
        assert lent.poll() is None and owner.answer({"k": 2})["pid"] == lent.pid


def test_what_a_lent_worker_says_to_somebody_who_is_gone_is_nobody_elses() -> None:
    """A verdict on another's files would be a false one."""
    with Workers(ANSWER) as owner:
        lent = owner.lend()
        assert lent.stdin is not None
        for stale in ({"k": "stale", "asked": "by one that was killed"}, {"asked": None}):
            lent.stdin.write(json.dumps(stale) + "\n")
        lent.stdin.flush()
        with Workers(ANSWER, lent=lent) as workers:
            assert workers.answer({"k": 1})["wanted"] == {"k": 1}


def test_a_lent_worker_that_dies_is_replaced_by_one_of_their_own() -> None:
    with Workers(ANSWER) as owner:
        lent = owner.lend()
        with Workers(ANSWER, lent=lent) as workers:
            with pytest.raises(Crash, match="no more memory") as caught:
                workers.answer({"die": True})  # the lent one, and then their own
            assert caught.value.code == 7 and lent.wait(10) == 7
            assert workers.answer({"k": 1})["wanted"] == {"k": 1}
        assert owner.lend().pid != lent.pid


def test_leaving_ends_a_lent_worker_that_nobody_waits_for_any_more() -> None:
    with Workers(ANSWER) as owner:
        lent = owner.lend()
        with Workers(ANSWER, lent=lent) as workers:
            waiting = workers.ask({"wait": 60})
            while workers._free.qsize():
                time.sleep(0.01)
        with pytest.raises(Crash):
            waiting.result()
        assert lent.wait(10) == -signal.SIGTERM
        assert owner.answer({"k": 1})["wanted"] == {"k": 1}


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


HOLD = f"""
import sys, time
from knotfab.base.pool import Pool
with Pool(1) as pool:
    child = pool.start({SLEEP!r})
    print(child.pid, flush=True)
    time.sleep(60)
"""


def ended(process: int, within_s: float = 20.0) -> bool:
    """Whether a process of no matter whose is gone, or soon is."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        try:
            if Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.02)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="the system must tell children")
def test_children_end_when_their_parent_is_killed() -> None:
    parent = subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert not ended(child, 0.0)
    parent.kill()
    parent.communicate()
    assert ended(child)


@pytest.mark.parametrize("lent", [False, True])
def test_leaving_ends_a_worker_that_was_stopped(
    monkeypatch: pytest.MonkeyPatch, lent: bool
) -> None:
    """It hears no request to end; nobody waits for it for ever."""
    monkeypatch.setattr(pool, "_GRACE_S", 0.2)
    with Workers(ANSWER) as owner:
        with Workers(ANSWER, lent=owner.lend() if lent else None) as workers:
            process = int(workers.answer({})["pid"])
            os.kill(process, signal.SIGSTOP)
            waiting = workers.ask({"k": 1})
            time.sleep(0.1)
        assert ended(process)
        with pytest.raises(Crash):
            waiting.result()
