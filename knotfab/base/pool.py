"""Parallel work in processes: how many of them this machine has room for, and the workers."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any, ParamSpec, Self, TypeVar

from knotfab_formats.libraries import add_parts

JOB_GB = 2.0  # memory of one build
# A process beside others runs one thread: threads that wait for each other cost more than they bring.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

_GRACE_S = 15.0  # grace period for a process that is asked to end; a build tidies up
_PYTHON = sys.executable
_SERVE = str(Path(__file__).with_name("serve.py"))  # the child's side
# This program runs a command in its own place; the system asks the command to end when the parent has ended.
_TIE = (
    "import ctypes, os, sys; number, parent, *command = sys.argv[1:];"
    "ctypes.CDLL(None).prctl(1, int(number)); os.getppid() == int(parent) and os.execvp(command[0], command)"
)

Hear = Callable[[dict[str, Any]], None]
_P = ParamSpec("_P")
_T = TypeVar("_T")


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else (os.cpu_count() or 1)


def measure_memory_gb() -> float | None:
    """Return this machine's memory, GiB; None where it cannot be read."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, OSError, ValueError):  # Windows
        with contextlib.suppress(ImportError):
            import psutil

            return float(psutil.virtual_memory().total) / 2**30
        return None


def count_jobs() -> int:
    """Return how many processes to run in parallel: one per core, given 2 GB of memory each.

    The environment's `KNOTFAB_JOBS` overrides this; a batch sets it to a build's share.
    """
    told = os.environ.get("KNOTFAB_JOBS", "")
    if told.isdigit() and int(told) > 0:
        return int(told)
    memory_gb = measure_memory_gb()
    fit = count_cores() if memory_gb is None else int(memory_gb / JOB_GB)
    return max(1, min(count_cores(), fit))


def tie(command: Sequence[str], number: int = signal.SIGTERM) -> list[str]:
    """Wrap a command so that it never outlives this process; only on Linux.

    The thread that starts the command must outlive it.

    Args:
        number: number of the signal that ends the command.
    """
    if sys.platform != "linux":
        return list(command)
    return [_PYTHON, "-I", "-S", "-c", _TIE, str(int(number)), str(os.getpid()), *command]


class Crash(Exception):
    """A worker ended instead of answering: its exit code (negative: a signal), and what it said last."""

    def __init__(self, code: int, said: str) -> None:
        self.code, self.said = code, said
        super().__init__(f"exit code {code}: {said}")


class Workers:
    """`jobs` processes that answer requests by a module's `answer` (`serve.py`); a free one gets the next.

        with Workers("knotfab_fixtures.service") as workers:
            future = workers.ask({"module": …})

    A process that died is replaced at the next request. All end when the context is left, or when this
    process ends for any reason, since their standard input closes.

    Args:
        words: arguments of the module's `prepare`.
        early: start all now, so that they load before the first request; else each at its first request.
        copied: each is a copy of this process at first, and has what was loaded here (Linux).

    Raises (from `answer`, and from `result` of what `ask` returns):
        Crash: the process ended without an answer.
        OSError: the process cannot be started.
    """

    def __init__(
        self,
        module: str,
        *words: str,
        jobs: int = 1,
        env: Mapping[str, str] | None = None,
        early: bool = True,
        copied: bool = False,
    ) -> None:
        self.ended = threading.Event()
        self._threads = ThreadPoolExecutor(jobs)
        self._all = [_Worker([module, *words], env, copied) for _ in range(jobs)]
        self._free: SimpleQueue[_Worker] = SimpleQueue()
        for worker in self._all:
            if early:
                worker.start()
            self._free.put(worker)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Ask all to end, drop waiting requests, and kill those that do not end."""
        self.ended.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
        self.interrupt()
        # a stopped or hanging process does not react
        killer = threading.Timer(_GRACE_S, self.interrupt, (signal.Signals(9),))
        killer.daemon = True
        killer.start()
        self._threads.shutdown(wait=True)
        for worker in self._all:
            worker.close()
        killer.cancel()

    @property
    def idle(self) -> bool:
        """True if no request is waiting or running."""
        return self._free.qsize() == len(self._all)

    @property
    def processes(self) -> list[subprocess.Popen[str]]:
        """The running processes."""
        return [w.process for w in self._all if w.process is not None and w.process.poll() is None]

    def start(self) -> None:
        """Start the processes that are not running, so that they load their libraries early."""
        for worker in self._all:
            worker.start()

    def interrupt(self, number: int = signal.SIGTERM) -> None:
        """Send all a signal: running answers end early, and idle processes end."""
        for process in self.processes:
            process.send_signal(number)

    def submit(self, call: Callable[_P, _T], *arguments: _P.args, **named: _P.kwargs) -> Future[_T]:
        """Call a function on a thread of the pool, which has one for each process."""
        context = copy_context()
        return self._threads.submit(lambda: context.run(call, *arguments, **named))

    def ask(self, request: dict[str, Any], hear: Hear | None = None) -> Future[dict[str, Any]]:
        """Queue a request; `result` of the returned future waits for the answer."""
        return self.submit(self.answer, request, hear)

    def answer(self, request: dict[str, Any], hear: Hear | None = None) -> dict[str, Any]:
        """Wait for a free process, hand it a request, and return its answer.

        Args:
            hear: called with each message that the process sends before its answer.
        """
        worker = self._free.get()
        try:
            if self.ended.is_set():
                raise Crash(-signal.SIGTERM, "")
            worker.start()
            return worker.answer(request, hear)
        finally:
            self._free.put(worker)


def _serve_as_copy(words: Sequence[str]) -> None:
    """Serve in a copy of the process that starts a worker; it never returns."""
    _held = sys.stdout, sys.stderr  # what they have not written yet is the parent's to write
    try:
        # among them the pipe at whose end Popen knows that the copy runs
        os.closerange(3, 1 + max(map(int, os.listdir("/proc/self/fd"))))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        gc.enable()  # which Popen has stopped
        if not sys.flags.safe_path:
            del sys.path[0]  # as -P has it
        sys.stdout, sys.stderr = (open(n, "w", 1, "utf-8", closefd=False) for n in (1, 2))  # noqa: SIM115
        sys.argv = [_SERVE, *words]
        runpy.run_path(_SERVE, run_name="__main__")
        os._exit(0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


class _Worker:
    """One process, and its last output on standard error."""

    def __init__(self, words: Sequence[str], env: Mapping[str, str] | None, copied: bool) -> None:
        self._words, self._env, self._copied = words, env, copied
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start the process, or a replacement for one that ended."""
        if self.process is not None and self.process.poll() is None:
            return
        self.close()
        copied, self._copied = self._copied, False  # by then threads may run here: it starts afresh
        with contextlib.ExitStack() as failed:
            self._said = failed.enter_context(tempfile.TemporaryFile())
            self.process = subprocess.Popen(
                # -P: import modules from the installation, never from the working folder
                [sys.executable, "-P", _SERVE, *self._words],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                encoding="utf-8",
                errors="replace",
                env=self._env,
                start_new_session=True,  # Ctrl-C is for the parent, which then ends them
                restore_signals=not copied,
                preexec_fn=partial(_serve_as_copy, self._words) if copied else None,
            )
            failed.pop_all()  # it started

    def answer(self, request: dict[str, Any], hear: Hear | None) -> dict[str, Any]:
        assert self.process is not None and self.process.stdin and self.process.stdout
        with contextlib.suppress(OSError):
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
        for line in self.process.stdout:
            told: Any = None
            with contextlib.suppress(ValueError):
                told = json.loads(line)
            if isinstance(told, dict) and "answer" in told:
                add_parts(told.get("parts", {}))
                answer: dict[str, Any] = told["answer"]
                return answer
            if isinstance(told, dict) and hear is not None:
                hear(told)
        code = self.process.wait()
        self._said.seek(0)
        lines = self._said.read().decode("utf-8", "replace").strip().splitlines()
        raise Crash(code, (lines or [""])[-1].strip())

    def close(self) -> None:
        """Close its input, which makes it end, and wait."""
        if self.process is not None:
            with contextlib.suppress(OSError):  # it did not read all; EINVAL on Windows
                self.process.communicate()
            self._said.close()
