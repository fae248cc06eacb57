"""One command with limits on its time and its output: nothing of it is left when it returns."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from knotfab.base.pool import tie

__all__ = ["OUT_OF_TIME", "Ended", "run_limited"]

MOST_SAID = 4_000_000  # bytes on standard output or error
MOST_WRITTEN = 1_000_000_000  # bytes in the working folder
GRACE_S = 5.0  # until a killed process must be gone
OUT_OF_TIME = "no answer in time"


@dataclass(frozen=True)
class Ended:
    """The end of a command: its exit code (negative: a signal), or why it was stopped."""

    code: int
    out: str
    err: str
    stopped: str = ""


def run_limited(
    command: Sequence[str],
    folder: Path,
    timeout_s: float,
    stop: threading.Event | None = None,
    hear: Callable[[str], None] | None = None,
) -> Ended:
    """Run `command` in `folder`, which is its home, in a process group that is killed when it must stop.

    On Linux it ends with this process, too.

    It is stopped when `timeout_s` have passed, when it says or writes too much, and when `stop` is
    set. What it says goes to files of the folder, so that it never waits for a reader.

    Args:
        hear: told what it has said so far, while it runs.

    Raises:
        OSError: the command cannot be started.
    """
    if shutil.which(command[0]) is None:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), command[0])
    out, err = folder / "said.out", folder / "said.err"
    with out.open("wb") as to_out, err.open("wb") as to_err:
        child = subprocess.Popen(
            tie(command, signal.SIGKILL),
            cwd=folder,
            env=_environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=to_out,
            stderr=to_err,
            start_new_session=True,
        )
        stopped = ""
        try:
            deadline = time.monotonic() + timeout_s
            while child.poll() is None and not stopped:
                if stop is not None and stop.is_set():
                    stopped = "the build ended"
                elif time.monotonic() > deadline:
                    stopped = OUT_OF_TIME
                elif max(out.stat().st_size, err.stat().st_size) > MOST_SAID:
                    stopped = f"it said more than {MOST_SAID // 10**6} MB"
                elif _size(folder) > MOST_WRITTEN:
                    stopped = f"it wrote more than {MOST_WRITTEN // 10**9} GB"
                else:
                    with suppress(subprocess.TimeoutExpired):
                        child.wait(0.05)
                    if hear is not None:
                        hear(_text(out))
        finally:
            _kill_group(child)
    return Ended(child.returncode, _text(out), _text(err), stopped)


def _environment(folder: Path) -> dict[str, str]:
    """Return this process's environment, but with a home of its own, no display and no other language."""
    kept = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("LC_", "XDG_")) and key not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    return {**kept, "HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "LANG": "C.UTF-8"}


def _kill_group(child: subprocess.Popen[bytes]) -> None:
    """End the command and all that it started: the group outlives its first process."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)
    else:  # Windows, which knows who started whom
        call = ["taskkill", "/F", "/T", "/PID", str(child.pid)]
        with suppress(OSError, subprocess.TimeoutExpired):
            subprocess.run(call, capture_output=True, timeout=GRACE_S, check=False)
        child.kill()
    with suppress(subprocess.TimeoutExpired):
        child.wait(GRACE_S)


def _size(folder: Path) -> int:
    total = 0
    for path in folder.iterdir():
        with suppress(OSError):  # gone in between
            total += path.stat().st_size
    return total


def _text(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(MOST_SAID).decode("utf-8", "replace")
