"""A running build's process, and the tabs that follow it."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotfab.apps.batch.worker import run_apart
from knotfab.base.pool import Workers


@dataclass(eq=False)
class Listener:
    """Queues messages for one tab: all in order, but of the frames only the latest."""

    messages: deque[str] = field(default_factory=deque)
    frame: str | None = None
    woken: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, text: str, frame: bool = False) -> None:
        if frame:
            self.frame = text
        else:
            self.messages.append(text)
        self.woken.set()

    async def next(self) -> list[str]:
        """Wait for messages, and take all that are queued."""
        await self.woken.wait()
        self.woken.clear()
        found = [*self.messages, *([] if self.frame is None else [self.frame])]
        self.messages.clear()
        self.frame = None
        return found


_AGAIN_S = 2.0  # before a signal is sent again, as Python drops one that arrives during cleanup
_KILLED_S = 20.0  # after which a build that has not tidied up is killed

Event = dict[str, Any]


class LiveBuild:
    """Runs a build in a process.

    Args:
        builder: the process.
        tell: is called with each event, and at last with {"event": "ended", "code", "sentence"}, from a
            thread.
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
        """Interrupt the build as Ctrl-C would."""
        threading.Thread(target=self._stop, daemon=True).start()

    def kill(self, after_s: float = 5.0) -> None:
        """Interrupt the build, wait for `after_s`, and then kill it."""
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
