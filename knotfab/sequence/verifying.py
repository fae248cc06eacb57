"""Verifying many frames: children that load the validators once and answer one request a line.

`python -m knotfab.sequence.verifying` is such a child; it does what `python -m knotfab_validators` does,
again and again. A graphics library that crashes takes the child down, not the build.
"""

from __future__ import annotations

import contextlib
import json
import queue
import subprocess
import sys
from collections.abc import Collection
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotfab.errors import InputError, MachineError

__all__ = ["FrameFiles", "FrameVerifier"]

_WORKERS = 2


@dataclass(frozen=True)
class FrameFiles:
    """The written files of one frame, and the folder for its pictures; a part may be alone."""

    part: Path
    knots: Path | None = None
    scene: Path | None = None
    pictures: Path | None = None


class FrameVerifier:
    """Verifies frames as they are written, beside the search of those that follow.

        with FrameVerifier(skip) as verifier:
            answer = verifier.submit(files)
            ...
            verdict = answer.result()

    A verdict is the validators': {"status", "exit_code", "checks", "views", "seconds"}.

    Raises (from `result`):
        MachineError: a child crashed. InputError: it could not read a file.
    """

    def __init__(self, skip: Collection[str] = (), workers: int = _WORKERS) -> None:
        self._skip = frozenset(skip)
        self._count = workers
        self._idle: queue.SimpleQueue[subprocess.Popen[str]] = queue.SimpleQueue()
        self._children: list[subprocess.Popen[str]] = []

    def __enter__(self) -> FrameVerifier:
        for _ in range(self._count):
            self._children.append(
                subprocess.Popen(
                    # -P: modules come from the installation, never from the working folder
                    [sys.executable, "-P", "-m", "knotfab.sequence.verifying"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    encoding="utf-8",
                    errors="replace",
                    start_new_session=True,  # Ctrl-C is for the parent, which then ends the child
                )
            )
            self._idle.put(self._children[-1])
        self._threads = ThreadPoolExecutor(self._count)
        return self

    def __exit__(self, *_: object) -> None:
        for child in self._children:
            child.kill()
        self._threads.shutdown(wait=True, cancel_futures=True)
        for child in self._children:
            child.communicate()
        self._children = []

    def submit(self, files: FrameFiles, skip: Collection[str] = ()) -> Future[dict[str, Any]]:
        """Hand over one frame's written files; the answer comes when a child is free."""
        return self._threads.submit(self._ask, files, self._skip.union(skip))

    def _ask(self, files: FrameFiles, skip: frozenset[str]) -> dict[str, Any]:
        paths = {
            "part": files.part,
            "knots": files.knots,
            "scene": files.scene,
            "pictures_dir": files.pictures,
        }
        request: dict[str, Any] = {k: None if p is None else str(p) for k, p in paths.items()}
        request["skip"] = sorted(skip)
        child = self._idle.get()
        try:
            line = ""
            assert child.stdin is not None and child.stdout is not None
            with contextlib.suppress(BrokenPipeError, ValueError):
                child.stdin.write(json.dumps(request) + "\n")
                child.stdin.flush()
                line = child.stdout.readline()
        finally:
            self._idle.put(child)
        if not line:
            raise MachineError(
                "verification",
                f"its process ended with exit code {child.poll()}",
                "If graphics are the cause, install them (apt-get install libegl1 libgl1) or go on "
                "without rendering (--skip shadow-render).",
            )
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            name, _, reason = str(answer["error"]).partition(": ")
            raise InputError(name, reason.rstrip("."), "Correct that file, or name another.")
        return answer


def _serve() -> None:
    """Answer requests until there are no more."""
    from knotfab_validators.validate import validate

    # libraries in C++ write to standard output as they like: the answers have one of their own
    answers, sys.stdout = sys.stdout, sys.stderr
    for line in sys.stdin:
        request = json.loads(line)
        try:
            found = validate(**request)
            answer = {**found.to_dict(), "exit_code": found.exit_code, "seconds": found.seconds}
        except ValueError as error:
            answer = {"error": str(error)}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    _serve()
