"""Read untrusted files in a copy of this process that has limited time and memory, and may crash.

A copy takes a few milliseconds, and loads nothing again. Only Linux makes one; elsewhere the work is
done here.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

from knotfab.base.errors import keep_traceback
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import add_parts, recording
from knotfab_formats.limits import limit_process

_T = TypeVar("_T")
_SLOWER = 10  # wall-clock time over processor time, on a machine that is busy
_ENDING = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP} if sys.platform == "linux" else set()
_lock = threading.Lock()  # two copies made at once would hold each other's pipes
_living: set[int] = set()
_is_copy = False


def run_limited(
    work: Callable[[], _T],
    what: str,
    *,
    seconds: int,
    gigabytes: float = 3.0,
    verb: str = "reading it",
    remedy: str = "Scale it down or simplify it, or save it as a PNG.",
) -> _T:
    """Return what `work` returns or raise what it raises; any other change that it makes in memory is lost.

    Args:
        what, verb, remedy: for the error's sentence.
        seconds: limit on processor time. gigabytes: limit on memory, beyond what this process has.

    Raises:
        InputError: it takes more than that, or crashes.
    """
    if _is_copy or sys.platform != "linux":
        return work()
    with _lock:
        ours, theirs = os.pipe()
        # a signal that came in between would be lost, or heeded by the copy
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
        try:
            child = os.fork()
        except BaseException:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            raise
        if child == 0:
            _work_as_copy(work, theirs, seconds, gigabytes)
        os.close(theirs)
        _living.add(child)
    late, code = False, None
    try:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        sent, late = _receive(ours, time.monotonic() + _SLOWER * seconds)
    finally:
        os.close(ours)
        _living.discard(child)
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if late or code == -signal.SIGXCPU:
        raise InputError(what, f"{verb} takes more than {seconds} s", remedy)
    if not sent:
        raise InputError(what, f"{verb} crashes what reads it", remedy)
    kind, value, state = pickle.loads(sent)  # of this program's own copy
    if kind is None:
        returned: _T
        returned, parts = value
        add_parts(parts)
        return returned
    if issubclass(kind, MemoryError):
        raise InputError(what, f"{verb} takes more than {gigabytes:g} GB", remedy)
    error = kind.__new__(kind, *value)
    error.args = value
    error.__dict__.update(state)
    raise error


def end_copies() -> None:
    """Kill all copies; threads that wait for one get an error."""
    for child in list(_living):
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)


def _receive(ours: int, until: float) -> tuple[bytes, bool]:
    """Read all that a copy sends; return that (b"" if it stops halfway or is late) and whether it is late."""
    parts: list[bytes] = []
    while (left := until - time.monotonic()) > 0:
        if select.select([ours], [], [], left)[0]:
            part = os.read(ours, 2**20)
            if not part:
                sent = b"".join(parts)
                return (sent[:-1] if sent[-1:] == b"." else b""), False
            parts.append(part)
    return b"", True


def _work_as_copy(work: Callable[[], Any], theirs: int, seconds: int, gigabytes: float) -> NoReturn:
    global _is_copy
    _is_copy = True
    code = 1
    try:
        _limit(seconds, gigabytes)
        try:
            with recording() as parts:
                packed = _packed((None, (work(), parts), {}))
        except Exception as error:
            error.add_note(traceback.format_exc())
            packed = _packed((type(error), error.args, error.__dict__), error)
        with open(theirs, "wb") as pipe:
            pipe.write(packed + b".")
        code = 0
    finally:
        os._exit(code)  # no tidying up of what is the parent's


def _packed(sent: tuple[Any, ...], error: Exception | None = None) -> bytes:
    """Pickle what a copy sends; an error that the parent could not make again is kept in a file."""
    try:
        if error is not None:
            type(error).__new__(type(error), *error.args)
        return pickle.dumps(sent, pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        return pickle.dumps((MemoryError, (), {}))
    except Exception as fault:
        told = keep_traceback(error or fault)
        return pickle.dumps((type(told), told.args, told.__dict__))


def _limit(seconds: int, gigabytes: float) -> None:
    import ctypes

    with open(os.devnull, "wb") as nowhere:  # libraries talk, and print what they crash of
        os.dup2(nowhere.fileno(), 2)
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU):
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
    ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # it goes with its parent
    limit_process(seconds, gigabytes)
