"""One build of the studio: the command line's own, in a process, its events passed on as they come."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from knotfab.batch.worker import run_apart

__all__ = ["LiveBuild", "Spare"]

_AGAIN_S = 2.0  # Python drops a signal that arrives while it frees something: it is sent again
_KILLED_S = 20.0  # a build that has not tidied up by then is killed

Event = dict[str, Any]


class Spare:
    """A process that is ready to build, so that a press is answered at once; `take` gives it away."""

    def __init__(self, warm: bool = True) -> None:
        self.warm = warm
        self._child: subprocess.Popen[str] | None = None

    def prepare(self) -> None:
        """Start one, where there is none."""
        if self.warm and (self._child is None or self._child.poll() is not None):
            self._child = _start(["-m", "knotfab.cli.spare"])

    def take(self, arguments: Sequence[str]) -> subprocess.Popen[str]:
        """A process that builds with these arguments of `knotfab`."""
        child, self._child = self._child, None
        if child is not None and child.poll() is None:
            assert child.stdin is not None
            with contextlib.suppress(OSError):
                child.stdin.write(json.dumps(list(arguments)) + "\n")
                child.stdin.close()
                return child
        child = _start(["-m", "knotfab", *arguments])
        assert child.stdin is not None
        child.stdin.close()
        return child

    def close(self) -> None:
        if self._child is not None:
            self._child.kill()
            with self._child:
                self._child = None


def _start(arguments: Sequence[str]) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen(
        # -P: modules come from the installation, never from the folder one happens to be in
        [sys.executable, "-P", *arguments],
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        text=True,
        encoding="utf-8",
        env={**os.environ, "PYTHONUTF8": "1"},
        start_new_session=True,  # Ctrl-C on the terminal is the studio's to pass on
    )


class LiveBuild:
    """A build that runs, or ran.

    Args:
        tell: told of each event, and at the last of {"event": "ended", "code", "sentence"}; in a thread.
    """

    def __init__(
        self, spare: Spare, arguments: Sequence[str], folder: Path, tell: Callable[[Event], None]
    ) -> None:
        self._tell = tell
        self._ended = threading.Event()
        call = ["build", f"--out={folder}", "--quiet", "--events=-", *arguments]
        self._child = spare.take(call)
        threading.Thread(target=self._wait, daemon=True).start()

    def stop(self) -> None:
        """Ask it to end as by Ctrl-C: it says first where its knots stand."""
        threading.Thread(target=self._stop, daemon=True).start()

    def kill(self, after_s: float = 5.0) -> None:
        """End it with the studio: asked first, then made to."""
        self._stop(after_s)

    def _stop(self, after_s: float = _KILLED_S) -> None:
        until = time.monotonic() + after_s
        while time.monotonic() < until and self._child.poll() is None:
            with contextlib.suppress(OSError):
                self._child.terminate()
            if self._ended.wait(min(_AGAIN_S, after_s)):
                return
        if self._child.poll() is None:
            self._child.kill()
        self._ended.wait(_AGAIN_S)

    def _wait(self) -> None:
        code, sentence = run_apart(self._child, self._tell)
        self._ended.set()
        self._tell({"event": "ended", "code": code, "sentence": sentence})
