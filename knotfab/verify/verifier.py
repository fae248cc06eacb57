"""The validators as a build and the command line call them: a child that answers as it can."""

from __future__ import annotations

import atexit
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from knotfab.base.errors import InputError, MachineError
from knotfab.base.pool import Crash, Workers, count_jobs

__all__ = [
    "VERDICT_KEYS",
    "Answer",
    "Files",
    "Verifier",
    "borrow",
    "explain_unreadable",
    "load_early",
    "stand_by",
]

VERDICT_KEYS = (
    "status",
    "conclusion",
    "size_mm",
    "notes",
    "checks",
    "views",
    "colours",
    "picture",
)  # for readers
LIMIT_S = 1800.0  # of one part, from when its verdict is waited for
NO_GRAPHICS = "--no-graphics"
# -P: modules come from the installation, never from the folder one happens to be in
_COMMAND = [sys.executable, "-P", "-m", "knotfab_validators"]
# of a thread: two builds side by side do not read each other's answers
_lent: ContextVar[subprocess.Popen[str] | None] = ContextVar("validators", default=None)
_idle: list[_Kept] = []  # one at most


@dataclass(frozen=True)
class _Kept:
    """Validators that wait for the next build of the process that keeps them."""

    process: int
    command: list[str]
    environment: dict[str, str]  # it says where graphics are, and how many may run
    workers: Workers


@dataclass(frozen=True)
class Files:
    """The written files of one piece, None for what there is not.

    `pictures_dir` is where its shadows are drawn, `failures` the PNG that marks what failed.
    """

    part: Path | None
    knots: Path | None = None
    scene: Path | None = None
    pictures_dir: Path | None = None
    failures: Path | None = None


class Verifier:
    """`python -m knotfab_validators` as a child, which loads VTK while its parent still searches.

        with Verifier(skip) as verifier:
            answer = verifier.submit(files)
            ...
            verdict = answer.result()

    Where this process may have two, the child has a copy of itself do half of the work. A verdict is the
    validators': {"status", "exit_code", "checks", "views", "picture", "seconds"}, its checks in the order of
    `CHECKS`.

    Args:
        skip: the checks to leave out, of every piece.
        jobs: pieces that are verified side by side, by a child each.

    Raises (from `result`):
        MachineError: a child crashed: a graphics library takes its child down, not the build.
        InputError: it could not read a file, or write one.
    """

    def __init__(self, skip: Collection[str] = (), jobs: int = 1) -> None:
        self._skip, self._jobs = frozenset(skip), jobs
        self._command = _command(self._skip)

    def __enter__(self) -> Verifier:
        self._lent = _lent.get()
        self._workers = Workers(self._command, self._jobs, lent=self._lent)
        return self

    def __exit__(self, *_: object) -> None:
        self._workers.__exit__()

    def submit(self, files: Files, skip: Collection[str] = (), unit: str = "mm") -> Answer:
        """Hand over one piece's written files; `result` of what is returned waits for the verdict.

        Args:
            unit: of a part whose file knows none.
        """
        # lent ones may have begun in another folder
        name = str if self._lent is None else os.path.abspath
        request = {k: None if p is None else name(p) for k, p in asdict(files).items()}
        every = {
            "skip": sorted(self._skip.union(skip)),
            "processes": min(2, count_jobs()),
            "unit": unit,
        }
        return Answer(self._workers.ask({**request, **every}))


@dataclass(frozen=True)
class Answer:
    """The verdict to come on the files of one piece."""

    verdict: Future[dict[str, Any]]

    def result(self) -> dict[str, Any]:
        """Wait for it."""
        try:
            answer = self.verdict.result(LIMIT_S)
        except Crash as crash:
            raise _crashed(crash) from None
        except TimeoutError as late:
            raise MachineError(
                "verification",
                f"it did not end in {LIMIT_S / 60:g} minutes",
                "Give it a part of fewer triangles, or leave out a check (--skip NAME).",
            ) from late
        if "error" in answer:
            raise explain_unreadable(str(answer["error"]))
        from knotfab.verify.checks import place_of  # with numpy, not before the child has begun

        return {**answer, "checks": sorted(answer["checks"], key=place_of)}


def stand_by() -> Workers:
    """Validators that outlive the builds of forked processes, which are lent them (`borrow`)."""
    return Workers([*_COMMAND, NO_GRAPHICS])  # those come when a shadow is to be rendered


@contextmanager
def load_early(skip: Collection[str] = (), keep: bool = False) -> Iterator[None]:
    """Validators for the build of a call that is still to be read: they load meanwhile.

    Those that a parent has lent load nothing any more, and serve.

    Args:
        keep: let them stay for the next call of this process, and end with it: loading takes longer than
            verifying a small part.
    """
    if _lent.get() is not None:
        yield
        return
    command = _command(skip)
    workers = _take_idle(command) or Workers(command)
    try:
        borrow(workers.lend())
        yield
    finally:
        borrow(None)
        if keep and not _idle:
            _idle.append(_Kept(os.getpid(), command, dict(os.environ), workers))
        else:
            workers.__exit__()


def _take_idle(command: list[str]) -> Workers | None:
    """Kept validators of this command; those of the process that this one was forked from stay its own."""
    while _idle:
        kept = _idle.pop()
        if kept.process == os.getpid():
            if (kept.command, kept.environment) == (command, dict(os.environ)):
                return kept.workers
            kept.workers.__exit__()
    return None


@atexit.register
def _end_idle() -> None:
    _take_idle([])


def borrow(validators: subprocess.Popen[str] | None) -> None:
    """Ask these, which are somebody else's to end, instead of starting own ones."""
    _lent.set(validators)


def _command(skip: Collection[str]) -> list[str]:
    return [*_COMMAND, NO_GRAPHICS] if "shadow-render" in skip else _COMMAND


def _crashed(crash: Crash) -> MachineError:
    how = signal.Signals(-crash.code).name if crash.code < 0 else f"exit code {crash.code}"
    last = crash.said.rstrip(".")
    return MachineError(
        "verification",
        f"its process ended with {how}" + (f" ({last})" if last else ""),
        "If graphics are the cause, install them (apt-get install libegl1 libgl1) or go on without "
        "rendering (--skip shadow-render); knotfab doctor says what this machine lacks.",
    )


def explain_unreadable(sentence: str) -> InputError:
    """The error of the validators' `NAME: reason` about a file that they cannot read, or write."""
    name, _, reason = sentence.partition(": ")
    if not reason:
        name, reason = "the files", sentence
    written = reason.startswith("cannot be written")
    remedy = "Choose another place for it." if written else "Correct that file, or name another."
    return InputError(name, reason.rstrip("."), remedy)
