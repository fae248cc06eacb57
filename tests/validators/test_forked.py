"""A call that a copy of the process makes: its value, its error, its death."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from knotfab_validators.forked import Baton, Forked, may_fork
from knotfab_validators.validate import _measure_apart

pytestmark = pytest.mark.skipif(not may_fork(), reason="this system makes no copies of a process")


def _refuse() -> None:
    raise ValueError("part.stl: is no mesh")


def test_the_value_comes_whole_however_large_while_this_process_goes_on() -> None:
    field = np.arange(1_000_000.0)
    with Forked(lambda: (os.getpid(), 2 * field)) as other:
        here = field.sum()  # the pipe is full meanwhile
        pid, doubled = other.result()
    assert pid != os.getpid() and doubled.sum() == 2 * here


def test_what_the_call_refuses_is_refused_here() -> None:
    with Forked(_refuse) as other, pytest.raises(ValueError, match="is no mesh"):
        other.result()


def test_two_processes_take_each_number_once() -> None:
    before = os.listdir("/proc/self/fd")
    with Baton(200) as baton, Forked(lambda: list(baton)) as other:
        here = list(baton)
        there = other.result()
        assert sorted(here + there) == list(range(200)) and list(baton) == []
    assert len(os.listdir("/proc/self/fd")) == len(before)


def test_one_that_nobody_waits_for_is_ended() -> None:
    began = time.monotonic()
    with Forked(lambda: time.sleep(60)) as other:
        pid = other._pid
    assert time.monotonic() - began < 30
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_without_room_for_a_copy_nothing_is_left_open_and_one_process_measures_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse() -> int:
        raise BlockingIOError("no room for another process")

    monkeypatch.setattr(os, "fork", refuse)
    before = os.listdir("/proc/self/fd")
    with pytest.raises(OSError, match="no room"):
        Forked(lambda: 1)
    assert len(os.listdir("/proc/self/fd")) == len(before)
    with _measure_apart(lambda: 1) as copy:
        assert copy is None


def test_a_machine_may_forbid_copies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KNOTFAB_NO_FORK", "1")
    assert not may_fork()


@pytest.mark.parametrize(
    ("call", "code", "said"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", -signal.SIGSEGV, ""),
        ("os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL, ""),
        ("1 / 0", 1, "ZeroDivisionError"),
    ],
)
def test_where_the_copy_dies_so_does_the_process(call: str, code: int, said: str) -> None:
    program = f"""
        import os, resource, signal
        from knotfab_validators.forked import Forked
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with Forked(lambda: {call}) as other:
            other.result()
        print("went on")
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (code, "") and said in done.stderr
