"""A call that a copy of this process makes meanwhile: what is loaded and read already need not be again."""

from __future__ import annotations

import contextlib
import ctypes
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

__all__ = ["Baton", "Forked", "may_fork"]

T = TypeVar("T")

_ENDS_WITH_PARENT = 1  # Linux, prctl: the signal that is sent when the parent ends


class Forked(Generic[T]):
    """`call()` on another core.

        with Forked(call) as other:
            ...
            found = other.result()

    Leaving it early ends the copy. Of the copy's libraries none may have started threads that it needs.

    Raises:
        OSError: the system has no room for a copy.
        ValueError: from `result`, what `call` raised. Where it raised anything else, or the copy dies of
            a signal, so does this process: whoever asked it is told the truth.
    """

    def __init__(self, call: Callable[[], T]) -> None:
        out, into = os.pipe()
        parent = os.getpid()
        try:
            self._pid = os.fork()
        except OSError:
            os.close(out)
            os.close(into)
            raise
        if self._pid == 0:
            _answer(call, into, parent)
        os.close(into)
        self._out = os.fdopen(out, "rb")
        self._ended = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._out.close()
        if not self._ended:
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)

    def result(self) -> T:
        """Wait for what the call gives."""
        said = self._out.read()
        _, status = os.waitpid(self._pid, 0)
        self._ended = True
        code = os.waitstatus_to_exitcode(status)
        if code < 0:
            os.kill(os.getpid(), -code)
        if code:
            sys.exit(abs(code))  # its traceback is written
        found: T | Exception = pickle.loads(said)
        if isinstance(found, Exception):
            raise found
        return found


class Baton:
    """Numbers below `count` that a process and its copies take in turn, each of them once.

        baton = Baton(count)
        with Forked(lambda: [work(k) for k in baton]) as other:
            mine = [work(k) for k in baton]

    Which process takes which is for their haste to say; leaving it closes this one's end.
    """

    def __init__(self, count: int) -> None:
        self._out, into = os.pipe()
        os.write(into, bytes(range(count)))
        os.close(into)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._out)

    def __iter__(self) -> Iterator[int]:
        while taken := os.read(self._out, 1):
            yield taken[0]


def may_fork() -> bool:
    """Whether this process may be copied; `KNOTFAB_NO_FORK` in the environment says no."""
    # a copy of a process that has graphics may not run on macOS; Windows makes none
    return sys.platform == "linux" and "KNOTFAB_NO_FORK" not in os.environ


def _answer(call: Callable[[], Any], into: int, parent: int) -> None:
    """Write what the call gives, and end."""
    code = 1
    try:
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_ENDS_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before
            os._exit(code)
        try:
            found = call()
        except ValueError as error:
            found = error
        with os.fdopen(into, "wb") as answer:
            pickle.dump(found, answer)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
