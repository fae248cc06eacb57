"""Work side by side in processes: how many this machine holds, and pools that end what they started."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import IO, Any, ParamSpec, Self, TypeVar

__all__ = [
    "ONE_THREAD",
    "Crash",
    "Pool",
    "Workers",
    "count_cores",
    "count_jobs",
    "may_fork",
    "measure_memory_gb",
    "tie",
]

JOB_GB = 2.0  # memory of a build
# of a process that has others beside it: threads that wait for each other cost more than they bring
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

_GRACE_S = 15.0  # for a process that is asked to end; a build tidies up
_PYTHON = sys.executable
# runs a command in its own place, which the system asks to end when the parent has ended
_TIE = (
    "import ctypes, os, sys; number, parent, *command = sys.argv[1:];"
    "ctypes.CDLL(None).prctl(1, int(number)); os.getppid() == int(parent) and os.execvp(command[0], command)"
)

_P = ParamSpec("_P")
_T = TypeVar("_T")


def count_cores() -> int:
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else (os.cpu_count() or 1)


def measure_memory_gb() -> float | None:
    """Memory of this machine, in GiB; None where that cannot be read."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, OSError, ValueError):  # Windows
        with contextlib.suppress(ImportError):
            import psutil

            return float(psutil.virtual_memory().total) / 2**30
        return None


def may_fork() -> bool:
    """Whether a process that has loaded libraries may fork; `KNOTFAB_NO_FORK` in the environment says no."""
    # what Apple's frameworks start when they are loaded does not live on in a child
    return hasattr(os, "fork") and sys.platform != "darwin" and "KNOTFAB_NO_FORK" not in os.environ


def count_jobs() -> int:
    """Processes to run side by side: as many as this machine has cores, and 2 GB for each.

    `KNOTFAB_JOBS` in the environment answers for it; a batch sets it to a build's share.
    """
    told = os.environ.get("KNOTFAB_JOBS", "")
    if told.isdigit() and int(told) > 0:
        return int(told)
    memory_gb = measure_memory_gb()
    fit = count_cores() if memory_gb is None else int(memory_gb / JOB_GB)
    return max(1, min(count_cores(), fit))


def tie(command: Sequence[str], number: int = signal.SIGTERM) -> list[str]:
    """The command as one that does not outlive this process, whatever ends it, where the system is Linux.

    The thread that starts it must live as long as it.

    Args:
        number: of the signal that it gets.
    """
    if sys.platform != "linux":
        return list(command)
    return [_PYTHON, "-I", "-S", "-c", _TIE, str(int(number)), str(os.getpid()), *command]


class Pool:
    """`jobs` threads that each mind a process; leaving it ends what still runs, and drops what waits.

    with Pool(2) as pool:
        futures = [pool.submit(mind, task, pool) for task in tasks]

    Args:
        share: the processes that each of them may run side by side; by default its share of this
            machine.
    """

    def __init__(self, jobs: int, share: int | None = None) -> None:
        self.ended = threading.Event()
        self.share = share or max(1, count_jobs() // jobs)
        self._threads = ThreadPoolExecutor(jobs)
        self._processes: set[subprocess.Popen[str]] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in list(self._processes):
            process.terminate()
        # one that was stopped, or hangs, hears no such request
        killer = threading.Timer(_GRACE_S, self._kill)
        killer.daemon = True
        killer.start()
        self._threads.shutdown(wait=True)
        for process in list(self._processes):
            process.wait()
        killer.cancel()

    def _kill(self) -> None:
        for process in list(self._processes):
            process.kill()

    def submit(self, call: Callable[_P, _T], *arguments: _P.args, **named: _P.kwargs) -> Future[_T]:
        """Call it on a thread, when one is free."""
        return self._threads.submit(call, *arguments, **named)

    def start(self, command: Sequence[str], **settings: Any) -> subprocess.Popen[str]:
        """Start a process, as `subprocess.Popen` does, that ends with the pool, and with this process."""
        process: subprocess.Popen[str] = subprocess.Popen(
            tie(command), encoding="utf-8", errors="replace", **settings
        )
        self._processes.add(process)
        if self.ended.is_set():
            process.terminate()
        return process


class Crash(Exception):
    """A worker ended instead of answering: its exit code (negative: a signal), and what it said last."""

    def __init__(self, code: int, said: str) -> None:
        self.code, self.said = code, said
        super().__init__(f"exit code {code}: {said}")


class Workers(Pool):
    """`jobs` processes that answer a line of JSON with a line of JSON; a request goes to one that is free.

    They are started at once, so that they load what they need while nobody asks yet. One that ended is
    replaced when it is asked again. An answer repeats what the request says under "asked".

    Args:
        lent: a process of the parent's that answers such requests (`lend`), instead of the first; it stays
            the parent's to end. One that ends instead of answering is replaced by one of their own.

    Raises (from `answer`, and from `result` of what `ask` returns):
        Crash: the process ended without an answer.
    """

    def __init__(
        self,
        command: Sequence[str],
        jobs: int = 1,
        env: Mapping[str, str] | None = None,
        share: int | None = None,
        lent: subprocess.Popen[str] | None = None,
    ) -> None:
        super().__init__(jobs, share)
        self._command, self._env, self._lent = command, env, lent
        self._count = jobs
        self._free: SimpleQueue[tuple[subprocess.Popen[str], IO[bytes] | None]] = SimpleQueue()
        self._said: list[IO[bytes]] = []
        if lent is not None:
            self._free.put((lent, None))
        for _ in range(jobs - (lent is not None)):
            self._free.put(self._begin())

    def lend(self) -> subprocess.Popen[str]:
        """A process for the `Workers` of one that is forked now; this one asks it nothing meanwhile."""
        taken = self._take()
        self._free.put(taken)
        return taken[0]

    def _take(self) -> tuple[subprocess.Popen[str], IO[bytes] | None]:
        """One that is free; an own one that ended is replaced, unless all of them are to end."""
        process, said = self._free.get()
        try:
            if said is not None and process.poll() is not None and not self.ended.is_set():
                return self._begin()
        except OSError:
            self._free.put((process, said))
            raise
        return process, said

    def _begin(self) -> tuple[subprocess.Popen[str], IO[bytes]]:
        """Start a process; what it writes to standard error is in the file beside it."""
        said: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  (`__exit__` closes it)
        self._said.append(said)
        process = self.start(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            env=self._env,
            start_new_session=True,  # Ctrl-C is for the parent, which then ends them
        )
        return process, said

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        if self._lent is not None and self._free.qsize() < self._count:
            # nobody waits for it any more; the parent will replace it
            with contextlib.suppress(OSError):
                os.kill(self._lent.pid, signal.SIGTERM)
        super().__exit__()
        for process in self._processes:
            with contextlib.suppress(OSError):  # what it did not read any more; EINVAL on Windows
                process.communicate()
        for said in self._said:
            said.close()

    def _kill(self) -> None:
        super()._kill()
        if self._lent is not None and self._free.qsize() < self._count:
            with contextlib.suppress(OSError):
                os.kill(self._lent.pid, signal.SIGKILL)

    def ask(self, request: dict[str, Any]) -> Future[dict[str, Any]]:
        """Hand over a request; `result` of what is returned waits for the answer."""
        return self.submit(self.answer, request)

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Hand over a request, and wait for a free process and its answer."""
        process, said = self._take()
        try:
            answer = _ask(process, request)
            if answer is None and said is None and not self.ended.is_set():
                process, said = self._begin()
                answer = _ask(process, request)
            if answer is not None:
                return answer
            if said is None:  # `__exit__` ended it
                raise Crash(-signal.SIGTERM, "")
            code = process.wait()
            said.seek(0)
            lines = said.read().decode("utf-8", "replace").strip().splitlines()
            raise Crash(code, (lines or [""])[-1].strip())
        finally:
            self._free.put((process, said))


def _ask(process: subprocess.Popen[str], request: dict[str, Any]) -> dict[str, Any] | None:
    """Its answer; None where it ended instead. What it still says to somebody who is gone is passed over."""
    assert process.stdin is not None and process.stdout is not None
    asked = f"{os.getpid()}-{threading.get_ident()}-{time.monotonic_ns()}"
    with contextlib.suppress(OSError):
        process.stdin.write(json.dumps({**request, "asked": asked}) + "\n")
        process.stdin.flush()
        for line in iter(process.stdout.readline, ""):
            try:
                answer: Any = json.loads(line)
            except ValueError:
                continue
            if not isinstance(answer, dict):
                continue
            if "asked" not in answer:
                raise Crash(0, f"it answered {line.strip()[:80]}, and not what it was asked")
            if answer.pop("asked") == asked:
                return answer
    return None
