"""A running build, and the tabs that follow it: its process, events and status."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from knotfab.apps.batch.worker import run_apart
from knotfab.apps.studio.builds import describe_folder
from knotfab.base.moves import REJECTED
from knotfab.base.pool import Workers

_PHASES = {0: "done", 1: "rejected", 130: "stopped"}
_STOPPED = "Stopped; nothing was saved."


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


class Broadcast:
    """One build at a time, and the tabs that follow it. It is changed only in the event loop's thread."""

    def __init__(self) -> None:
        self.status: dict[str, Any] = {"phase": "idle"}
        self.out = Path()  # the folder of the current or last build
        self.scene: str | None = None  # the last events of these kinds, for a tab opened later
        self.frame: str | None = None
        self.listeners: set[Listener] = set()
        self._pressed = 0.0
        self._reported = False  # whether the build wrote its report

    async def open(self) -> None:
        """Prepare what the first tab needs."""

    async def close(self) -> None:
        """End every process."""

    @property
    def running(self) -> bool:
        return self.status["phase"] in ("running", "stopping")

    def describe(self) -> dict[str, Any]:
        """Describe the whole state, for a page that was opened or reloaded."""
        return {"build": self.status}

    def folder_of(self, where: str) -> Path | None:
        """Return the folder of a build by name; None if there is none."""
        return self.out if where == self.out.name else None

    def plain(self, sentence: str) -> str:
        """Return a sentence in the page's words."""
        return sentence

    def listen(self) -> Listener:
        """Add a listener, with the current state as its first message."""
        listener = Listener()
        listener.put(json.dumps({"event": "state", **self.describe()}))
        if self.scene is not None:
            listener.put(self.scene)
        if self.frame is not None:
            listener.put(self.frame, frame=True)
        self.listeners.add(listener)
        return listener

    def tell_state(self) -> None:
        """Send the state to every tab."""
        self.send(json.dumps({"event": "state", **self.describe()}))

    def send(self, text: str, frame: bool = False) -> None:
        for listener in self.listeners:
            listener.put(text, frame)

    def begin(self, out: Path, title: str) -> None:
        """Set the status to that of a build that starts, which will write the folder `out`."""
        self.scene = self.frame = None
        self.out, self._pressed, self._reported = out, time.monotonic(), False
        self.status = {
            "phase": "running", "name": out.name, "title": title, "stage": "start", "share": 0.0, "notes": [],
        }  # fmt: skip

    def hear(self, event: Event) -> None:
        """Update the status by an event of the build, and pass it on to all tabs."""
        kind, text = event["event"], json.dumps(event)
        if kind == "end":
            self._reported = True
        elif kind == "knots":
            if self.frame is None:
                self.status["first_frame_s"] = round(time.monotonic() - self._pressed, 3)
            self.frame = text
        elif kind == "scene":
            self.scene = text
        elif kind == "stage":
            self.status |= {"stage": event["name"], "left_s": event["left_s"], "late": False}
            self.status.pop("fraction", None)
        elif kind == "progress":
            told = ("stage", "share", "left_s", "iou", "fraction", "late")
            self.status |= {key: event[key] for key in told if event.get(key) is not None}
        elif kind == "say":
            self.status["notes"] = [*self.status["notes"], self.plain(event["text"])][-40:]
        self.send(text, frame=kind == "knots")

    def end(self, code: int, sentence: str) -> None:
        """Set the status to that of a build that ended."""
        # stopped before it could tidy up, or after
        if self.status["phase"] == "stopping" and not self._reported and (code >= 128 or code == 1):
            code = 130
        self.status |= {"phase": _PHASES.get(code, "failed"), "exit_code": code, "left_s": 0}
        self.status["sentence"] = self.plain(sentence)
        if code == 130:
            self.status["sentence"] = _STOPPED
        report = self.out / ("" if code == 0 else REJECTED) / "report.json"
        # a report that this build did not write is an earlier one's
        if code == 0 or (code == 1 and self._reported and report.is_file()):
            self.status["share"] = 1.0
            self.status["result"] = describe_folder(self.out, code == 1)
        elif code == 1:
            self.status["phase"] = "failed"


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
