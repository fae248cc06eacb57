"""One build of the studio: the command line's own, in a process, its events passed on as they come."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from knotfab.base.pool import Workers
from knotfab.batch.worker import run_apart

__all__ = ["LiveBuild"]

_AGAIN_S = 2.0  # Python drops a signal that arrives while it frees something: it is sent again
_KILLED_S = 20.0  # a build that has not tidied up by then is killed

Event = dict[str, Any]


class LiveBuild:
    """A build that runs, or ran.

    Args:
        builder: the process that builds.
        tell: told of each event, and at the last of {"event": "ended", "code", "sentence"}; in a thread.
    """

    def __init__(
        self,
        builder: Workers,
        arguments: Sequence[str],
        folder: Path,
        tell: Callable[[Event], None],
    ) -> None:
        self._builder, self._tell = builder, tell
        self._ended = threading.Event()
        call = ["build", f"--out={folder}", "--quiet", "--events=-", *arguments]
        builder.submit(self._run, call)

    def stop(self) -> None:
        """Ask it to end as by Ctrl-C: it says first where its knots stand."""
        threading.Thread(target=self._stop, daemon=True).start()

    def kill(self, after_s: float = 5.0) -> None:
        """End it with the studio: asked first, then made to."""
        self._stop(after_s)

    def _stop(self, after_s: float = _KILLED_S) -> None:
        for _ in range(max(1, round(after_s / _AGAIN_S))):
            self._builder.interrupt()
            if self._ended.wait(min(_AGAIN_S, after_s)):
                return
        self._builder.interrupt(9)
        self._ended.wait(_AGAIN_S)

    def _run(self, call: Sequence[str]) -> None:
        try:
            code, sentence = run_apart(self._builder, call, self._tell)
        except OSError as error:
            code, sentence = 3, f"The build cannot be started ({error.strerror}): try again."
        self._ended.set()
        self._tell({"event": "ended", "code": code, "sentence": sentence})
