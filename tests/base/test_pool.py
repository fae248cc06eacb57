"""Workers: each request gets its answer, one that dies says how, and all end with whoever started them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import CancelledError
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import psutil
import pytest

from knotfab.base import pool
from knotfab.base.pool import Crash, Workers, count_cores, count_jobs, measure_memory_gb
from knotfab_formats.libraries import list_parts, recording, took_part

# It answers with what was wanted and who it is; "die", "wait", "refuse" and "tell" are commands.
ECHO = """
import os, sys, time
def prepare(*words):
    for word in words:
        time.sleep(float(word))
        yield
def answer(request, told):
    print("a library's own words")
    if request.get("die"):
        print("no more memory", file=sys.stderr)
        sys.stderr.flush()
        os._exit(7)
    for k in range(request.get("tell", 0)):
        print('{"event": %d}' % k, file=told)
    time.sleep(request.get("wait", 0))
    refused = 1 / (1 - request.get("refuse", 0))
    return {"wanted": request, "pid": os.getpid(), "refused": refused, "copy": "colorsys" in sys.modules}
"""
Start = Callable[..., Workers]


def finding(folder: Path) -> dict[str, str]:
    """The environment of a process that finds a folder's modules beside all others."""
    paths = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": paths}


@pytest.fixture
def echo(tmp_path: Path) -> Start:
    """Workers that answer with the module above."""
    (tmp_path / "echo.py").write_text(ECHO)

    def start(*words: str, **more: Any) -> Workers:
        return Workers("echo", *words, env=finding(tmp_path), **more)

    return start


def ended(process: int, within_s: float = 20.0) -> bool:
    """Tell whether a process of no matter whose is gone, or soon is."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        try:
            if psutil.Process(process).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.02)
    return False


def test_workers_share_the_requests_and_each_gets_its_own_answer(echo: Start) -> None:
    with echo(jobs=2) as workers:
        answers = [workers.ask({"k": k, "wait": 0.05}) for k in range(6)]
        found = [answer.result() for answer in answers]
        assert workers.idle
    assert [one["wanted"]["k"] for one in found] == list(range(6))
    assert len({one["pid"] for one in found}) == 2


def test_what_is_told_before_the_answer_is_heard_in_order(echo: Start) -> None:
    told: list[dict[str, Any]] = []
    with echo() as workers:
        workers.answer({"tell": 3}, told.append)
        workers.answer({"tell": 1})  # nobody listens
    assert told == [{"event": k} for k in range(3)]


@pytest.mark.parametrize(
    ("request_", "code", "said"),
    [({"die": True}, 7, "no more memory"), ({"refuse": 1}, 1, "ZeroDivisionError")],
)
def test_a_worker_that_dies_says_how_and_is_replaced(
    echo: Start, request_: dict[str, Any], code: int, said: str
) -> None:
    with echo(early=False) as workers:
        assert not workers.processes
        with pytest.raises(Crash, match=said) as caught:
            workers.answer(request_)
        assert caught.value.code == code
        assert workers.answer({"k": 1})["wanted"] == {"k": 1}


def test_a_module_that_is_missing_is_a_crash() -> None:
    with Workers("no_such_module") as workers, pytest.raises(Crash, match="no_such_module"):
        workers.answer({})


def test_a_request_is_answered_before_the_rest_is_loaded(echo: Start) -> None:
    with echo("0", "0.2", *["5"] * 9, early=False) as workers:
        began = time.monotonic()
        assert workers.answer({"k": 1})["wanted"] == {"k": 1}
        assert time.monotonic() - began < 45  # all steps together


def test_leaving_ends_what_runs_and_drops_what_waits(echo: Start) -> None:
    with echo() as workers:
        first, waiting = workers.ask({"wait": 60}), workers.ask({"wait": 60})
        while workers.idle:
            time.sleep(0.01)
        (process,) = workers.processes
    with pytest.raises(Crash):
        first.result()
    with pytest.raises(CancelledError):
        waiting.result()
    assert process.poll() is not None


def test_leaving_ends_a_worker_that_was_stopped(
    monkeypatch: pytest.MonkeyPatch, echo: Start
) -> None:
    """It hears no request to end; nobody waits for it for ever."""
    monkeypatch.setattr(pool, "_GRACE_S", 0.2)
    with echo() as workers:
        process = int(workers.answer({})["pid"])
        os.kill(process, signal.SIGSTOP)
        waiting = workers.ask({"k": 1})
        time.sleep(0.1)
    assert ended(process)
    with pytest.raises(Crash):
        waiting.result()


def test_as_many_as_cores_and_memory_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KNOTFAB_JOBS", raising=False)
    monkeypatch.setattr(pool, "count_cores", lambda: 8)
    for memory_gb, jobs in ((None, 8), (64.0, 8), (7.0, 3), (1.0, 1)):
        monkeypatch.setattr(pool, "measure_memory_gb", lambda gb=memory_gb: gb)
        assert count_jobs() == jobs
    monkeypatch.setenv("KNOTFAB_JOBS", "1")  # as a batch tells its builds
    assert count_jobs() == 1


def test_a_system_without_sysconf_or_affinity(monkeypatch: pytest.MonkeyPatch) -> None:
    """On Windows psutil tells the memory; where psutil is not installed the memory is unknown."""
    told = ModuleType("psutil")
    told.virtual_memory = lambda: SimpleNamespace(total=3 * 2**30)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "psutil", told)
    for name in ("sysconf", "sched_getaffinity"):
        monkeypatch.delattr(os, name, raising=False)
    assert count_cores() == os.cpu_count()
    assert measure_memory_gb() == 3.0
    monkeypatch.setitem(sys.modules, "psutil", None)
    assert measure_memory_gb() is None


COPY = """
import colorsys
from knotfab.base.pool import Crash, Workers
print("a line that only its writer flushes", end=" ")
with Workers("echo", copied=True) as workers:
    print(workers.answer({"tell": 1})["copy"])
    try:
        workers.answer({"die": True})
    except Crash as crash:
        print(crash)
    print(workers.answer({})["copy"])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only there a process is copied")
def test_a_copy_has_what_was_loaded_and_is_replaced_by_a_fresh_process(tmp_path: Path) -> None:
    (tmp_path / "echo.py").write_text(ECHO)
    call = [sys.executable, "-c", COPY]
    done = subprocess.run(call, capture_output=True, text=True, env=finding(tmp_path), check=True)
    assert done.stdout.splitlines() == [
        *("a line that only its writer flushes True", "exit code 7: no more memory", "False")
    ]


HOLD = """
import sys, time
from knotfab.base.pool import Workers
with Workers("echo", copied=len(sys.argv) > 2) as workers:
    print(workers.answer({})["pid"], flush=True)
    workers.answer({"wait": float(sys.argv[1])})
    time.sleep(60)
"""


@pytest.mark.parametrize("words", ["0", "60", "0 copied", "60 copied"])
def test_children_end_when_their_parent_is_killed(tmp_path: Path, words: str) -> None:
    """They end whether they wait for a request, or answer one."""
    (tmp_path / "echo.py").write_text(ECHO)
    parent = subprocess.Popen(
        [sys.executable, "-c", HOLD, *words.split()],
        stdout=subprocess.PIPE,
        text=True,
        env=finding(tmp_path),
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert not ended(child, 0.1)
    parent.kill()
    parent.communicate()
    assert ended(child)


@pytest.mark.skipif(sys.platform != "linux", reason="the system must tell the command")
def test_a_tied_command_ends_with_its_parent() -> None:
    sleep = [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
    code = (
        "import subprocess; from knotfab.base.pool import tie;"
        f"print(subprocess.Popen(tie({sleep})).pid, flush=True); input()"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    assert not ended(child, 0.0)
    parent.kill()
    parent.communicate()
    assert ended(child)


def test_what_libraries_did_in_a_process_comes_back_with_its_answer(tmp_path: Path) -> None:
    told = "from knotfab_formats.libraries import took_part\n"
    told += "def answer(request, told):\n    took_part('fcl', request['did'])\n    return {}\n"
    (tmp_path / "teller.py").write_text(told)
    with Workers("teller", env=finding(tmp_path)) as workers:
        for deeds in (["measured"], ["measured", "cut"]):
            with recording():
                for did in (*deeds, deeds[0]):
                    workers.ask({"did": did}).result()
                assert list_parts() == {"fcl": ", ".join(deeds)}  # nothing is left of the last time
        assert list_parts() == {}


def test_a_record_within_another_is_one_record() -> None:
    with recording():
        took_part("torch", "moved")
        with recording():
            took_part("fcl", "measured")
        took_part("torch", "moved", "drew")
        assert list_parts() == {"fcl": "measured", "torch": "moved, drew"}
    took_part("torch", "moved")  # nobody records
    assert list_parts() == {}
