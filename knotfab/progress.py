"""Progress on a terminal: stage, bar, remaining time and the IoU so far; timings always."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal, TextIO

if TYPE_CHECKING:
    import rich.progress
    import rich.text

__all__ = ["Mode", "Progress"]

Mode = Literal["auto", "quiet", "verbose"]
_log = logging.getLogger("knotfab")


class Progress:
    """Stages of a build, shown as they run.

    `auto` draws on `stream` where that is a terminal, and says nothing where it is piped; `quiet`
    never says anything; `verbose` writes a plain line with the time of each finished stage, piped
    or not, and draws on a terminal as well. `timings` collects seconds per stage in every mode.
    Those lines are records of the logger "knotfab", at level INFO in every mode: `verbose` shows them.

    Use it as a context manager, so that the terminal is left clean whatever happens:

        with Progress("auto") as progress:
            with progress.stage("search"):
                progress.update(0.4, iou=0.93)
    """

    def __init__(self, mode: Mode = "auto", stream: TextIO | None = None) -> None:
        self.mode: Mode = mode
        self.timings: dict[str, float] = {}
        self._stream = sys.stderr if stream is None else stream
        self._bar: rich.progress.Progress | None = None
        self._task: rich.progress.TaskID | None = None
        self._began = time.perf_counter()
        self._shown, self._level = _Lines(self._say), logging.NOTSET

    @property
    def draws(self) -> bool:
        """Whether there is a bar: only on a terminal, and not when quiet."""
        return self.mode != "quiet" and self._stream.isatty()

    @property
    def total(self) -> float:
        """Seconds since this progress began."""
        return time.perf_counter() - self._began

    def __enter__(self) -> Progress:
        if self.draws:
            self._bar = _bar(self._stream)
            self._bar.start()
        if self.mode == "verbose":
            _log.addHandler(self._shown)
            self._level = _log.level
            _log.setLevel(min(_log.getEffectiveLevel(), logging.INFO))
        return self

    def __exit__(self, *_: object) -> None:
        if self.mode == "verbose":
            _log.removeHandler(self._shown)
            _log.setLevel(self._level)
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what runs inside under `name`; a stage that comes again adds to its time.

        A stage that fails is timed as well, and the error goes on.
        """
        begin = time.perf_counter()
        before = self._task
        if self._bar is not None:
            self._task = self._bar.add_task(name, total=None, iou="")
        try:
            yield
        finally:
            seconds = time.perf_counter() - begin
            self.timings[name] = self.timings.get(name, 0.0) + seconds
            if self._bar is not None and self._task is not None:
                self._bar.remove_task(self._task)
            self._task = before
            _log.info("%s: %.2f s", name, seconds)

    @contextmanager
    def line(self, name: str) -> Iterator[None]:
        """A line of its own for one of several things that run side by side, from any thread."""
        bar = self._bar
        line = None if bar is None else bar.add_task(name, total=None, iou="")
        try:
            yield
        finally:
            if bar is not None and line is not None:
                bar.remove_task(line)

    def update(self, fraction: float, iou: float | None = None) -> None:
        """Say how far the running stage is (0 to 1), and the IoU it has reached."""
        if self._bar is None or self._task is None:
            return
        self._bar.update(self._task, total=1.0, completed=min(max(fraction, 0.0), 1.0))
        if iou is not None:
            self._bar.update(self._task, iou=f"IoU {iou:.3f}")

    def note(self, text: str) -> None:
        """A plain line for the log, which `verbose` shows."""
        _log.info("%s", text)

    def say(self, text: str) -> None:
        """A plain line that a person must see before the end; nothing where quiet."""
        if self.mode != "quiet":
            self._say(text)

    def _say(self, text: str) -> None:
        if self._bar is not None:
            # above the bar, which rich redraws below
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=self._stream, flush=True)


class _Lines(logging.Handler):
    """Hands each record's message on."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._tell = say

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


def _bar(stream: TextIO) -> rich.progress.Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    class Time(TimeRemainingColumn):
        """What is left, where that is known, else what has passed."""

        def render(self, task: rich.progress.Task) -> rich.text.Text:
            passed = task.total is None
            return TimeElapsedColumn().render(task) if passed else super().render(task)

    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=32),
        Time(compact=True),
        TextColumn("{task.fields[iou]}"),
        console=Console(file=stream),
        speed_estimate_period=3600.0,  # pictures of a batch end minutes apart
        transient=True,
    )
