"""The validators as a build and the command line call them: children that answer as they can."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Collection
from concurrent.futures import Future
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from knotfab.errors import InputError, MachineError
from knotfab.pool import Crash, Workers, count_jobs
from knotfab.verify.checks import exit_code, place_of

__all__ = ["Answer", "Files", "Verifier", "borrow", "explain_unreadable", "stand_by"]

NO_GRAPHICS = "--no-graphics"
# -P: modules come from the installation, never from the folder one happens to be in
_COMMAND = [sys.executable, "-P", "-m", "knotfab_validators"]
Half = Literal["geometry", "shadows"]
_lent: subprocess.Popen[str] | None = None


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
    """`python -m knotfab_validators` as children, which load VTK while their parent still searches.

        with Verifier(skip) as verifier:
            answer = verifier.submit(files)
            ...
            verdict = answer.result()

    Two share the work where there are shadows to verify and this process may have two: one measures the mesh
    and its printing, the other the shadows and, of a part to be printed, the strands. Of several pieces each
    child takes its half of whichever is next. The second begins when the parent says that it has loaded what
    it needs itself (`start_second`), or asks: three that load at once hold each other up on two cores. A
    verdict is the validators': {"status", "exit_code", "checks", "views", "picture", "seconds"}, its checks
    in the order of `CHECKS`.

    Args:
        skip: the checks to leave out, of every piece.
        shadows: whether there will be any to verify.
        jobs: pieces that are verified side by side, by two children each.

    Raises (from `result`):
        MachineError: a child crashed: a graphics library takes its child down, not the build.
        InputError: it could not read a file.
    """

    def __init__(self, skip: Collection[str] = (), shadows: bool = True, jobs: int = 1) -> None:
        self._skip, self._jobs = frozenset(skip), jobs
        graphics = [] if "shadow-render" not in self._skip else [NO_GRAPHICS]
        self._arguments: dict[Half, list[str]] = {"geometry": [NO_GRAPHICS]}
        if shadows and count_jobs() > 1:
            self._arguments["shadows"] = graphics
        elif shadows:
            self._arguments["geometry"] = graphics
        self._workers: dict[Half, Workers] = {}

    def __enter__(self) -> Verifier:
        # the shadows' first: they have more to load
        self._start(max(self._arguments), _lent)
        return self

    def start_second(self) -> None:
        """Start the child of the other half, where there is one: it loads while the parent goes on."""
        for half in self._arguments.keys() - self._workers.keys():
            self._start(half)

    def _start(self, half: Half, lent: subprocess.Popen[str] | None = None) -> None:
        command = [*_COMMAND, *self._arguments[half]]
        self._workers[half] = Workers(command, self._jobs, lent=lent)

    def __exit__(self, *_: object) -> None:
        for workers in self._workers.values():
            workers.__exit__()
        self._workers = {}

    def submit(self, files: Files, skip: Collection[str] = ()) -> Answer:
        """Hand over one piece's written files; `result` of what is returned waits for the verdict."""
        self.start_second()
        whole = files.part is None or files.scene is None or len(self._workers) == 1
        halves: list[Half | None] = [None] if whole else ["geometry", "shadows"]
        request = {k: None if p is None else str(p) for k, p in asdict(files).items()}
        every = {"skip": sorted(self._skip.union(skip))}
        answers = [
            self._workers[half or "geometry"].ask(
                {**request, **every, "failures": None, "only": half}
            )
            for half in halves
        ]
        return Answer(answers, files)


@dataclass(frozen=True)
class Answer:
    """The verdict to come on the files of one piece, from the halves of the work."""

    halves: list[Future[dict[str, Any]]]
    files: Files

    def result(self) -> dict[str, Any]:
        """Wait for the halves, put them together, and draw what failed."""
        answers = [_take(half) for half in self.halves]
        found = [check for answer in answers for check in answer["checks"]]
        checks = sorted(found, key=place_of)  # whichever process measured them
        code = exit_code(checks)
        return {
            "status": "fail" if code else "pass",
            "exit_code": code,
            "checks": checks,
            "views": [view for answer in answers for view in answer["views"]],
            "seconds": {k: v for answer in answers for k, v in answer["seconds"].items()},
            "picture": _draw_failures(self.files, checks),
        }


def stand_by() -> Workers:
    """Validators that outlive the builds of forked processes, which are lent them (`borrow`)."""
    return Workers([*_COMMAND, NO_GRAPHICS])  # those come when a shadow is to be rendered


def borrow(validators: subprocess.Popen[str]) -> None:
    """Ask these, which are the parent's, instead of starting own ones."""
    global _lent
    _lent = validators


def _take(half: Future[dict[str, Any]]) -> dict[str, Any]:
    try:
        answer = half.result()
    except Crash as crash:
        raise _crashed(crash) from None
    if "error" in answer:
        raise explain_unreadable(str(answer["error"]))
    return answer


def _crashed(crash: Crash) -> MachineError:
    how = signal.Signals(-crash.code).name if crash.code < 0 else f"exit code {crash.code}"
    last = crash.said.rstrip(".")
    return MachineError(
        "verification",
        f"its process ended with {how}" + (f" ({last})" if last else ""),
        "If graphics are the cause, install them (apt-get install libegl1 libgl1) or go on without "
        "rendering (--skip shadow-render); knotfab doctor says what this machine lacks.",
    )


def _draw_failures(files: Files, checks: list[dict[str, Any]]) -> str | None:
    """The picture of what failed; None where nothing did, or it could not be drawn."""
    if files.failures is None or not any(c["status"] == "fail" and c["required"] for c in checks):
        return None
    from knotfab_validators.check import Check
    from knotfab_validators.failure_picture import draw_failures
    from knotfab_validators.files.knots import read_knots
    from knotfab_validators.files.mesh import read_mesh

    found = [Check(**{**c, "at": tuple(map(tuple, c["at"]))}) for c in checks]
    try:
        mesh = None if files.part is None else read_mesh(files.part)
        curves = None if files.knots is None else read_knots(files.knots)
        drawn = draw_failures(files.failures, found, mesh, curves)
    except OSError as error:
        raise InputError(
            str(files.failures),
            f"it cannot be written ({error.strerror or error})",
            "Choose another place for --failures",
        ) from error
    return str(files.failures) if drawn else None


def explain_unreadable(sentence: str) -> InputError:
    """The error of the validators' `NAME: reason` about a file that they cannot read."""
    name, _, reason = sentence.partition(": ")
    if not reason:
        name, reason = "the files", sentence
    return InputError(name, reason.rstrip("."), "Correct that file, or name another.")
