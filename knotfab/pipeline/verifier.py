"""Run the validators in child processes, for builds and for `knotfab validate`."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from collections.abc import Collection, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from knotfab.base.errors import MachineError, explain_error
from knotfab.base.pool import Crash, Workers, count_jobs
from knotfab.report.summary import rank_check
from knotfab_formats.errors import InputError, KnotfabError, read_as, shown
from knotfab_formats.limits import MEASURING
from knotfab_formats.slicer_ini import PROFILE
from knotfab_formats.verdict import Verdict

LIMIT_S = 1800.0  # the longest wait for the verdict on one part
_MODULE = "knotfab_validators.service"
# a context variable, so that builds on several threads have their own
_open: ContextVar[_Validators | None] = ContextVar("validators", default=None)
_idle: list[_Validators] = []  # at most one, kept for the next build of this process


class _Validators:
    """The processes that verify `jobs` pieces in parallel.

    Args:
        graphics: whether shadows are rendered, so that VTK is loaded early.
        copied: whether they begin as copies of this process.
    """

    def __init__(self, graphics: bool, jobs: int, copied: bool = False) -> None:
        self.kind = graphics, jobs, _surroundings()
        self.jobs = jobs
        drawn = ("graphics",) if graphics else ()
        asked = ("geometry", "shadows", *drawn)
        self._workers = Workers(_MODULE, *asked, jobs=jobs, copied=copied)

    def ask(self, request: dict[str, Any]) -> Future[dict[str, Any]]:
        """Submit a piece; the future holds the validators' answer."""
        asked = {**request, "beside": count_jobs() > 1}
        return self._workers.submit(_answer, self._workers, asked)

    @property
    def idle(self) -> bool:
        """Whether all requests have been answered."""
        return self._workers.idle

    def end(self) -> None:
        self._workers.__exit__()


def _answer(workers: Workers, request: dict[str, Any]) -> dict[str, Any]:
    """Have a request answered, and ask once more if the answering process was killed."""
    try:
        return workers.answer(request)
    except Crash as crash:
        if crash.code not in (-9, -signal.SIGTERM) or workers.ended.is_set():
            raise
        return workers.answer(request)


@dataclass(frozen=True)
class Files:
    """The written files of one piece; those that are missing are None."""

    part: Path | None
    knots: Path | None = None
    scene: Path | None = None
    pictures_dir: Path | None = None  # where to draw the shadows
    failures: Path | None = None  # the PNG to mark failures in


class Verifier:
    """Verifies written files in child processes, which load VTK while their parent still searches.

        with Verifier(skip) as verifier:
            answer = verifier.submit(files)
            ...
            verdict = answer.result()

    Args:
        skip: the checks to leave out, for every piece.
        jobs: how many pieces to verify in parallel.
    """

    def __init__(self, skip: Collection[str] = (), jobs: int = 1) -> None:
        self._skip = frozenset(skip)
        self._held = _hold(skip, jobs)
        self._asked: list[Future[dict[str, Any]]] = []

    def __enter__(self) -> Verifier:
        self._validators = self._held.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        for verdict in self._asked:
            verdict.cancel()
        self._held.__exit__(None, None, None)

    def forget(self) -> None:
        """Drop the pieces that wait, and wait for those that are read, whose answers nobody wants."""
        wait([verdict for verdict in self._asked if not verdict.cancel()])
        self._asked.clear()

    def submit(self, files: Files, skip: Collection[str] = (), unit: str = "mm") -> Answer:
        """Submit the files of one piece.

        Args:
            skip: further checks to leave out.
            unit: of a part whose file has none.
        """
        # absolute, since kept validators may have started in another folder
        request = {k: None if p is None else os.path.abspath(p) for k, p in asdict(files).items()}
        every = {"skip": sorted(self._skip.union(skip)), "unit": unit}
        self._asked.append(self._validators.ask({**request, **every}))
        return Answer(self._asked[-1])


@dataclass(frozen=True)
class Answer:
    """The pending verdict on one piece."""

    verdict: Future[dict[str, Any]]

    def result(self) -> Verdict:
        """Wait for the verdict, whose checks have the order of `CHECKS`.

        Raises:
            MachineError: the child crashed, as a graphics library may make it, or took too long.
            InputError: a file could not be read, or written.
        """
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
        checks = sorted(answer["checks"], key=lambda check: rank_check(check["name"]))
        return read_as(Verdict, {**answer, "checks": checks})


@contextmanager
def load_early(skip: Collection[str] = (), keep: bool = False) -> Iterator[None]:
    """Start the validators, which load while the caller goes on; a Verifier in this context uses them.

    Args:
        keep: keep them for the next call of this process, since loading takes longer than verifying a small
            part.
    """
    with _hold(skip, 1, keep):
        yield


@contextmanager
def copy_early(skip: Collection[str] = ()) -> Iterator[None]:
    """Load what validators and caller both need, once: the validators begin as a copy of this process.

    Where this process may have run threads or drawn already, or cannot be copied, it does as `load_early`.
    """
    ran = sys.platform != "linux" or {"numba", "torch", "vtkmodules"} & sys.modules.keys()
    if not ran and not _idle:
        from knotfab_validators.service import load_common

        graphics = "shadow-render" not in skip
        load_common(graphics)
        gc.freeze()  # what both have stays, is looked through by neither, and stays one
        _idle.append(_Validators(graphics, 1, copied=True))
    with load_early(skip):
        yield


@contextmanager
def _hold(skip: Collection[str], jobs: int, keep: bool = False) -> Iterator[_Validators]:
    """Yield the validators that this context has already if they can do `jobs`, or else new ones."""
    held = _open.get()
    if held is not None and held.jobs >= jobs:
        yield held
        return
    graphics = "shadow-render" not in skip
    validators = _take_idle((graphics, jobs, _surroundings())) or _Validators(graphics, jobs)
    _open.set(validators)
    try:
        yield validators
    finally:
        _open.set(held)
        if keep and validators.idle and not _idle:
            _idle.append(validators)
        else:
            validators.end()


def _take_idle(kind: object) -> _Validators | None:
    """Take the kept validators if they are of this kind; others end."""
    while _idle:
        validators = _idle.pop()
        if validators.kind == kind:
            return validators
        validators.end()
    return None


def _surroundings() -> dict[str, str]:
    return dict(os.environ)


@atexit.register
def _end_idle() -> None:
    _take_idle(None)


if hasattr(os, "register_at_fork"):  # a forked child must not use its parent's validators
    os.register_at_fork(after_in_child=lambda: _idle.clear())


def _crashed(crash: Crash) -> KnotfabError:
    if lacks := explain_error(RuntimeError(crash.said)):  # memory
        return lacks
    if crash.code == -getattr(signal, "SIGXCPU", 0):
        why = f"measuring it takes more than {MEASURING[0]} s on each core"
        return InputError("the part", why, "Simplify it, or leave out checks (--skip NAME).")
    how = signal.Signals(-crash.code).name if crash.code < 0 else f"exit code {crash.code}"
    last = crash.said.rstrip(".")
    return MachineError(
        "verification",
        f"its process ended with {how}" + (f" ({last})" if last else ""),
        "If graphics are the cause, install them (apt-get install libegl1 libgl1) or go on without "
        "rendering (--skip shadow-render); knotfab doctor says what this machine lacks.",
    )


def explain_unreadable(sentence: str) -> InputError:
    """Make an error of the validators' `NAME: reason` about a file they cannot use."""
    name, _, reason = sentence.partition(": ")
    if not reason:
        name, reason = "the files", sentence
    reason, again, how = reason.partition(": build it again")
    written = reason.startswith("cannot be written")
    remedy = "Choose another place for it." if written else "Correct that file, or name another."
    return InputError(name, reason.rstrip("."), f"Build it again{how}" if again else remedy)


_READ = {"part.stl", "part.3mf", "part-colours.3mf", "knots.json", "scene.toml", PROFILE}
_MOST_UNREAD = 20  # files that are named


def files_to_validate(
    part: Path | None, knots: Path | None, scene: Path | None, failures: Path | None = None
) -> Files:
    """Return the files of a call to `knotfab validate`; a folder stands for the files of its build.

    Raises:
        InputError: nothing is given, or a file is missing.
    """
    if part is not None and part.is_dir():
        folder = part
        part = folder / "part.stl"
        knots = knots or _if_there(folder / "knots.json")
        scene = scene or _if_there(folder / "scene.toml")
        if (folder / "part-01.stl").is_file() and not part.is_file():
            raise InputError(
                str(folder),
                "it holds a sequence, a part for each frame",
                f"Name one: knotfab validate {folder / 'part-01.stl'} --knots "
                f"{folder / 'knots-01.json'} --scene {folder / 'scene-01.toml'}",
            )
        if not part.is_file():
            raise InputError(
                str(folder), "it holds no part.stl", "Name a folder that a build wrote"
            )
    if part is None and knots is None:
        raise InputError(
            "", "there is nothing to validate", "Name a folder, a part, or --knots knots.json"
        )
    for path in (part, knots, scene):
        if path is not None and not path.is_file():
            raise InputError(str(path), "there is no such file", "Check the path.")
    if failures is not None and failures.suffix.lower() != ".png":
        raise InputError(
            f"--failures {failures}", "failures are drawn as PNG", "Name a file in .png."
        )
    return Files(part, knots, scene, failures=failures)


def list_unread(files: Files) -> list[str]:
    """Name the files of a build's folder that validators do not read, in one sentence; none: nothing."""
    if files.part is None or files.part.name != "part.stl" or files.scene is None:
        return []
    named = files.scene.read_text(encoding="utf-8", errors="replace")
    beside = sorted(p.name for p in files.part.parent.iterdir() if not p.name.startswith("."))
    left = [shown(n) for n in beside if n not in _READ and n not in named]
    more = f" and {len(left) - _MOST_UNREAD} more" if len(left) > _MOST_UNREAD else ""
    return [f"not checked: {', '.join(left[:_MOST_UNREAD])}{more}"] if left else []


def _if_there(path: Path) -> Path | None:
    return path if path.is_file() else None
