"""Progress of a build: a bar on a terminal, events for a program that watches, timings of stages."""

from __future__ import annotations

import base64
import json
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO

if TYPE_CHECKING:
    import rich.progress

    from knotfab_formats.scene import ResolvedView

Mode = Literal["auto", "quiet", "verbose"]
Standing = Callable[[], Any]  # the Knots as a search has them; nothing here imports their type
# the views, the knots as they stand, and the columns and rows that there are: lines of a terminal
Draw = Callable[["Sequence[ResolvedView]", Any, int, int], str]
_log = logging.getLogger("knotfab")
_ENTERED: list[Progress] = []  # those that are used at present
_FRAME_S = 0.1  # between events of one kind, so that watching costs next to nothing
_DRAWN_S = 0.25  # between pictures on a terminal
_KEPT_S = 5.0  # between knots at full precision, which a build that is killed leaves behind
_DOUBT_S = 3.0  # measured times count for half once they are so long
_LEAST_COLUMNS, _LEAST_ROWS = 24, 8  # a picture on a terminal
_MOST_COLUMNS, _MOST_ROWS = 96, 24


@dataclass(frozen=True)
class Event:
    """Something that happens in a build, as `--events` writes it, with the share of the whole done."""

    name: str
    """stage, progress, scene, knots, standing, say or end."""
    stage: str
    """The one that runs, or the last that did."""
    share: float
    """How much of the whole is done, 0 to 1; it never falls."""
    seconds: float
    """Since the beginning."""
    left_s: float | None
    """Seconds that the rest will take; None where that is not known."""
    late: bool
    """The stage has run longer than it usually does."""
    data: Mapping[str, Any]
    """What the line holds besides (docs/studio.md)."""


class Progress:
    """The stages of a build, shown and timed as they run.

    `auto` draws on `stream` where that is a terminal, and says nothing where it is piped; `quiet`
    never says anything; `verbose` writes a plain line with the time of each finished stage, piped
    or not, and draws on a terminal as well. `timings` collects seconds per stage in every mode, and `cpu`
    those of all processors; a stage in another counts for itself alone.
    Those lines are records of the logger "knotfab", at level INFO in every mode: `verbose` shows them.

    Use it as a context manager, so that the terminal is left clean whatever happens:

        with Progress("auto") as progress:
            with progress.stage("search"):
                progress.update(0.4, iou=0.93)

    Args:
        events: where a line of JSON goes for each thing that happens (docs/studio.md lists them).
        began: `time.perf_counter()` at the beginning of the time that `total` counts; now by default.
        draw: draws the knots below the bar, where a terminal has room for them; None: nothing does.
        heard: called with each event, one at a time, on the thread where it happens. An exception that
            it raises ends the build: the next event raises it again.
    """

    def __init__(
        self,
        mode: Mode = "auto",
        stream: TextIO | None = None,
        events: TextIO | None = None,
        began: float | None = None,
        draw: Draw | None = None,
        heard: Callable[[Event], object] | None = None,
    ) -> None:
        self.mode: Mode = mode
        self.timings: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self._stream = sys.stderr if stream is None else stream
        self._events = events
        self._heard = heard
        self._raised: BaseException | None = None  # raised by the listener
        self._last = ""  # stage that began
        self._draw_knots = draw
        self._views: Sequence[ResolvedView] = ()
        self._picture = ""  # below the bar
        self._lock = threading.Lock()  # trials of radii run side by side
        self._due: dict[str, float] = {}
        self._standing: Standing | None = None
        self._bar: rich.progress.Progress | None = None
        self._told: set[str] = set()  # lines that were said
        self._task: rich.progress.TaskID | None = None
        self._began = time.perf_counter() if began is None else began
        self._spent = cpu_seconds() if began is None else 0.0  # before the beginning
        self._due["standing"] = time.perf_counter() + _KEPT_S
        self._usual: dict[str, float] = {}
        self._before: dict[str, float] = {}  # timings when the stages to come were announced
        self._stages: list[tuple[str, float]] = []  # stages that run, the outer before the inner
        self._fraction: float | None = None
        self._late = False  # the stage that runs takes longer than usual
        self._most = 0.0  # the largest share so far, so that the bar never runs back
        self._shown, self._level = _Lines(self._say), logging.NOTSET

    @property
    def draws(self) -> bool:
        """True if a bar is drawn: only on a terminal, and never when quiet."""
        return self.mode != "quiet" and self._stream.isatty()

    @property
    def total(self) -> float:
        """Seconds since this progress began."""
        return time.perf_counter() - self._began

    def account(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the seconds and the CPU seconds by stage, with what no stage took and the total."""
        totals = (self.timings, self.total), (self.cpu, cpu_seconds() - self._spent)
        wall, cpu = (
            {**parts, "other": max(total - sum(parts.values()), 0.0), "total": total}
            for parts, total in totals
        )
        return wall, cpu

    def __enter__(self) -> Progress:
        _ENTERED.append(self)
        if self.draws:
            self._bar = _make_bar(self._stream, self._remaining, lambda: self._picture)
            self._bar.start()
        if self.mode == "verbose":
            _log.addHandler(self._shown)
            self._level = _log.level
            _log.setLevel(min(_log.getEffectiveLevel(), logging.INFO))
        return self

    def __exit__(self, *_: object) -> None:
        _ENTERED.remove(self)
        if self.mode == "verbose":
            _log.removeHandler(self._shown)
            _log.setLevel(self._level)
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
        self._tell_standing()

    def _tell_standing(self) -> None:
        """Send the last knots from which a search may resume, once."""
        knots, self._standing = self._standing, None
        if knots is not None and self._raised is None:
            self.tell("standing", start=knots().dump_start())

    def plan(self, usual: Mapping[str, float]) -> None:
        """Announce the stages to come and their usual times, s, from which the time left is estimated."""
        self._usual, self._before = dict(usual), dict(self.timings)

    def plan_again(self) -> None:
        """Announce that the same stages come once more."""
        self.plan(self._usual)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block under `name`; a stage that comes again adds to its time.

        A stage that fails is timed as well, and its error is passed on.
        """
        begin = time.perf_counter()
        before = begin - sum(self.timings.values()), cpu_seconds() - sum(self.cpu.values())
        self._stages.append((name, begin))
        self._fraction, self._last = None, name
        self._draw(name, "")
        self.tell("stage", name=name, seconds=round(self.total, 2), left_s=self._left())
        try:
            yield
        finally:
            # since it began, but for the stages within it
            seconds = time.perf_counter() - sum(self.timings.values()) - before[0]
            spent = cpu_seconds() - sum(self.cpu.values()) - before[1]
            self.timings[name] = self.timings.get(name, 0.0) + max(seconds, 0.0)
            self.cpu[name] = self.cpu.get(name, 0.0) + max(spent, 0.0)
            self._stages.pop()
            self._fraction = None
            if self._stages:
                self._draw(self._stages[-1][0])
            _log.info("%s: %.2f s", name, seconds)

    def update(self, fraction: float, iou: float | None = None, even: bool = True) -> None:
        """Report how far the running stage is (0 to 1), and the IoU reached.

        Args:
            even: whether equal shares take equal times, so that the time left can be estimated.
        """
        if not self._stages:
            return
        name, fraction = self._stages[-1][0], min(max(fraction, 0.0), 1.0)
        self._fraction = fraction if even else None
        self._draw(name, None if iou is None else f"IoU {iou:.3f}")
        if self._heeded and self._is_due("progress"):
            share, left = self._whole()
            told = {"stage": name, "fraction": round(fraction, 4), "share": round(share, 4)}
            seen = None if iou is None else round(iou, 4)
            self.tell("progress", **told, iou=seen, left_s=left, late=self._late)

    @property
    def watched(self) -> bool:
        """True if anybody sees what `update` reports; otherwise a search need not measure it."""
        return self._bar is not None or self._heeded

    @property
    def _heeded(self) -> bool:
        """True if anybody listens to events."""
        return self._events is not None or self._heard is not None

    def set_scene(
        self,
        views: Sequence[ResolvedView],
        pictures: Callable[[], list[str]],
        radius_mm: float | None,
    ) -> None:
        """Set how knots are drawn: the views, and their silhouettes as data URIs."""
        self._views = views
        if self._heeded:
            told = [view.model_dump(mode="json") for view in views]
            self.tell("scene", views=told, pictures=pictures(), radius_mm=radius_mm)

    def show(self, knots: Standing, certified: bool) -> None:
        """Show the present knots to whoever watches; `knots` is called only where somebody does.

        Args:
            certified: whether certified steps led to them, so that a search may resume from them.
        """
        if self._views and (room := self._room()) and self._is_due("picture", _DRAWN_S):
            assert self._draw_knots is not None
            self._picture = self._draw_knots(self._views, knots(), *room)
        if not self._heeded:
            return
        if certified:
            self._standing = knots
            if self._is_due("standing", _KEPT_S):
                self.tell("standing", start=knots().dump_start())
        if self._is_due("knots"):
            seen = knots()
            curves = [_pack(knot.points) for knot in seen.knots]
            self.tell("knots", radius_mm=seen.radius_mm, curves=curves)

    def _room(self) -> tuple[int, int] | None:
        """Return the columns and rows free for a picture below the bar; None where there are none."""
        if self._bar is None or self._draw_knots is None:
            return None
        console = self._bar.console
        (columns, rows), said = console.size, len(self._bar.tasks)
        able = console.is_terminal and not console.is_dumb_terminal and not console.legacy_windows
        if not able or not console.encoding.startswith("utf"):
            return None
        # a line stays free above the bar for messages, and one below the picture
        free = min(columns, _MOST_COLUMNS), min(rows - said - 2, _MOST_ROWS)
        return free if free[0] >= _LEAST_COLUMNS and free[1] >= _LEAST_ROWS else None

    def tell(self, event: str, **data: Any) -> None:
        """Send an event, "end" as the last. A closed stream is dropped without an error."""
        if event == "end":
            self._tell_standing()
        if self._heard is not None:
            self._call(self._heard, event, data)
        if self._events is None:
            return
        line = json.dumps({"event": event, **data}) + "\n"
        with self._lock:
            try:
                self._events.write(line)
                self._events.flush()
            except (OSError, ValueError):  # ValueError: it is closed
                self._events = None

    def _call(self, heard: Callable[[Event], object], name: str, data: Mapping[str, Any]) -> None:
        with self._lock:
            if self._raised is not None:
                raise self._raised
            share, left = self._whole() if name != "end" else (1.0, 0.0)
            event = Event(name, self._last, share, round(self.total, 2), left, self._late, data)
            try:
                heard(event)
            except BaseException as error:
                self._raised = error
                raise

    def say(self, text: str) -> None:
        """Print a line that a person must see before the end, once; nothing when quiet."""
        if text in self._told:  # another frame has told it
            return
        self._told.add(text)
        self.tell("say", text=text)
        if self.mode != "quiet":
            self._say(text)

    def _say(self, text: str) -> None:
        if self._bar is not None:
            # above the bar, which rich redraws below
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=self._stream, flush=True)

    def _is_due(self, event: str, every_s: float = _FRAME_S) -> bool:
        """Return whether a frequent event is due to be written again."""
        now = time.perf_counter()
        with self._lock:
            due = now >= self._due.get(event, 0.0)
            if due:
                self._due[event] = now + every_s
        return due

    def _draw(self, name: str, iou: str | None = None) -> None:
        if self._bar is None:
            return
        if self._task is None:
            self._task = self._bar.add_task(name, total=1.0, iou="")
        share = self._whole()[0]
        self._bar.update(self._task, description=name, completed=share)
        if iou is not None:
            self._bar.update(self._task, iou=iou)

    def _left(self) -> float | None:
        return self._whole()[1]

    def _remaining(self) -> str:
        left = self._left()
        if left is None:
            return ""
        if self._late:
            return "longer than usual"
        return f"{left / 60:.0f} min left" if left >= 90 else f"{left:.0f} s left"

    def _whole(self) -> tuple[float, float | None]:
        """Return the share of all stages that is done, and the seconds left; None where unknown.

        Stages to come are given their usual times, scaled by how much longer than usual the finished
        ones took. The time of the running stage follows from its own share.
        """
        if not self._stages:
            return self._most, None
        name, begun = self._stages[0]
        ran, usual = time.perf_counter() - begun, dict(self._usual)
        expected = usual.pop(name, 0.0)
        since = {n: s - self._before.get(n, 0.0) for n, s in self.timings.items()}
        known = {n: s for n, s in since.items() if n in usual and s > 0}
        took = _DOUBT_S + sum(known.values())
        slower = took / (_DOUBT_S + sum(usual[n] for n in known))
        ahead = slower * sum(s for n, s in usual.items() if n not in known)
        self._late = False
        single = len(self._stages) == 1 and self._fraction
        if single and self._fraction and self._fraction > 0.02:
            left = ran * (1.0 - self._fraction) / self._fraction
        elif self._usual:
            spent = since.get(name, 0.0) + ran
            # a share of a stage's usual time is still to come, however long it has run
            left = max(slower * expected - spent, 0.1 * slower * expected)
            # a stage this long after its usual time takes longer than usual
            self._late = 0 < slower * expected < spent - 2.0
        else:
            return self._most, None
        left += ahead
        done = sum(self.timings.values()) + ran
        self._most = max(self._most, done / max(done + left, 1e-9))
        return self._most, round(left, 1)


def _make_bar(
    stream: TextIO, remaining: Callable[[], str], picture: Callable[[], str]
) -> rich.progress.Progress:
    from rich.console import Console, RenderableType
    from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
    from rich.text import Text

    class Remaining(ProgressColumn):
        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            return Text(remaining(), style="progress.remaining")

    class Below(Progress):
        """The bar, and a picture below it."""

        def get_renderables(self) -> Iterator[RenderableType]:
            yield from super().get_renderables()
            if drawn := picture():
                yield Text(drawn, no_wrap=True, overflow="crop")

    return Below(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=32),
        Remaining(),
        TextColumn("{task.fields[iou]}"),
        console=Console(file=stream),
        transient=True,
    )


def say_everywhere(text: str) -> None:
    """Print a line as `Progress.say` does, where whoever finds it out knows of no progress."""
    for progress in tuple(_ENTERED):
        progress.say(text)


class _Lines(logging.Handler):
    """Hands each record's message on."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._tell = say

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


def cpu_seconds() -> float:
    """Return CPU seconds of this process and of all that it started, ended or not."""
    own = os.times()
    spent = own.user + own.system + own.children_user + own.children_system
    return spent + _running_ticks("self", own=False) / _TICKS


_TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def _running_ticks(process: str, own: bool = True) -> int:
    """Count the ticks of a process (if its `own` count), of its ended children and of the running ones."""
    folder = Path(f"/proc/{process}")
    try:
        fields = (folder / "stat").read_text().rpartition(")")[2].split() if own else ()
        children = [c for t in folder.glob("task/*/children") for c in t.read_text().split()]
    except (OSError, ValueError):  # it has just ended, or the system does not say
        return 0
    return sum(map(int, fields[11:15])) + sum(map(_running_ticks, children))


def process_age() -> float:
    """Return the seconds since this process started; 0 where the system does not say."""
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        started = int(fields[19]) / os.sysconf("SC_CLK_TCK")
        return max(0.0, float(Path("/proc/uptime").read_text().split()[0]) - started)
    except (OSError, ValueError, IndexError):
        return 0.0


def _pack(points: Any) -> str:
    """Encode points (n, 3) as little-endian float32 in base64, a tenth of the size of JSON numbers."""
    return base64.b64encode(points.astype("<f4").tobytes()).decode("ascii")
