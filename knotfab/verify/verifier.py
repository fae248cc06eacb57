"""The validators as a build and the command line call them: children that answer as they can."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, Literal, NoReturn

from knotfab.errors import InputError, MachineError
from knotfab.verify.checks import exit_code

__all__ = ["Answer", "Files", "Verifier", "explain_unreadable"]

NO_GRAPHICS = "--no-graphics"
Half = Literal["geometry", "shadows"]


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

    Two share the work where there are shadows to verify, as geometry and shadows take about as long; of
    several pieces each child takes its half one after the other. A verdict is the validators':
    {"status", "exit_code", "checks", "views", "picture", "seconds"}.

    Args:
        skip: the checks to leave out, of every piece.
        shadows: whether there will be any to verify.

    Raises (from `result`):
        MachineError: a child crashed: a graphics library takes its child down, not the build.
        InputError: it could not read a file.
    """

    def __init__(self, skip: Collection[str] = (), shadows: bool = True) -> None:
        self._skip = frozenset(skip)
        graphics = [] if "shadow-render" not in self._skip else [NO_GRAPHICS]
        self._arguments: dict[Half, list[str]] = {"geometry": [NO_GRAPHICS]}
        if shadows:
            self._arguments["shadows"] = graphics
        self._children: dict[Half, _Child] = {}

    def __enter__(self) -> Verifier:
        # the shadows' first: it has more to load
        for half in sorted(self._arguments, reverse=True):
            self._children[half] = _Child(self._arguments[half])
        return self

    def __exit__(self, *_: object) -> None:
        for child in self._children.values():
            child.end()
        self._children = {}

    def submit(self, files: Files, skip: Collection[str] = ()) -> Answer:
        """Hand over one piece's written files; `result` of what is returned waits for the verdict."""
        whole = files.part is None or files.scene is None or len(self._children) == 1
        halves: list[Half | None] = [None] if whole else ["geometry", "shadows"]
        request = {k: None if p is None else str(p) for k, p in asdict(files).items()}
        every = {"skip": sorted(self._skip.union(skip))}
        answers = [
            self._children[half or "geometry"].ask(
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
        answers = [half.result() for half in self.halves]
        checks = [check for answer in answers for check in answer["checks"]]
        code = exit_code(checks)
        return {
            "status": "fail" if code else "pass",
            "exit_code": code,
            "checks": checks,
            "views": [view for answer in answers for view in answer["views"]],
            "seconds": {k: v for answer in answers for k, v in answer["seconds"].items()},
            "picture": _draw_failures(self.files, checks),
        }


class _Child:
    """One child process, and the requests that wait for it."""

    def __init__(self, arguments: list[str]) -> None:
        self._said: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  (`end` closes it)
        self._process = subprocess.Popen(
            # -P: modules come from the installation, never from the folder one happens to be in
            [sys.executable, "-P", "-m", "knotfab_validators", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C is for the parent, which then ends the child
        )
        self._waiting = ThreadPoolExecutor(1)

    def ask(self, request: dict[str, Any]) -> Future[dict[str, Any]]:
        return self._waiting.submit(self._answer, request)

    def end(self) -> None:
        self._process.kill()
        self._waiting.shutdown(wait=True, cancel_futures=True)
        with contextlib.suppress(BrokenPipeError):  # what it did not read any more
            self._process.communicate()
        self._said.close()

    def _answer(self, request: dict[str, Any]) -> dict[str, Any]:
        line, (to, back) = "", (self._process.stdin, self._process.stdout)
        assert to is not None and back is not None
        with contextlib.suppress(BrokenPipeError):
            to.write(json.dumps(request) + "\n")
            to.flush()
            line = back.readline()
        try:
            answer: dict[str, Any] = json.loads(line)
        except ValueError:
            self._crashed()
        if "error" in answer:
            raise explain_unreadable(str(answer["error"]))
        return answer

    def _crashed(self) -> NoReturn:
        code = self._process.wait()
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        self._said.seek(0)
        said = self._said.read().decode("utf-8", "replace").strip().splitlines()
        last = (said or [""])[-1].strip().rstrip(".")
        raise MachineError(
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
