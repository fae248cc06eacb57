"""Progress: drawn on a terminal alone, silent when piped or quiet; stages always timed."""

import base64
import io
import json
import logging
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
import pytest

from knotfab.base.progress import Event, Mode, Progress, cpu_seconds
from knotfab.knots import Knot, Knots
from knotfab_formats.scene import ResolvedView


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def run(mode: Mode, stream: io.StringIO) -> Progress:
    with Progress(mode, stream) as progress:
        for name in ("template", "search", "search"):
            with progress.stage(name):
                progress.update(0.5, iou=0.9312)
                progress.update(7.0)
    return progress


@pytest.mark.parametrize(
    ("stream", "events", "watched"),
    [(io.StringIO(), None, False), (Terminal(), None, True), (io.StringIO(), io.StringIO(), True)],
)
def test_a_search_measures_for_a_bar_and_for_events_alone(
    stream: io.StringIO, events: io.StringIO | None, watched: bool
) -> None:
    with Progress("auto", stream, events) as progress:
        assert progress.watched is watched


@pytest.mark.parametrize("mode", ["auto", "quiet", "verbose"])
@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_every_mode_times_the_stages(mode: Mode, kind: type[io.StringIO]) -> None:
    progress = run(mode, kind())
    assert list(progress.timings) == ["template", "search"]
    assert all(seconds >= 0 for seconds in progress.timings.values())
    assert progress.total >= sum(progress.timings.values())


def test_silent_when_piped_or_quiet() -> None:
    for mode, stream in (("auto", io.StringIO()), ("quiet", io.StringIO()), ("quiet", Terminal())):
        run(mode, stream)
        assert stream.getvalue() == ""


def test_verbose_writes_plain_lines_when_piped() -> None:
    stream = io.StringIO()
    run("verbose", stream)
    lines = stream.getvalue().splitlines()
    assert [line.split(":")[0] for line in lines] == ["template", "search", "search"]
    assert lines[0].endswith(" s") and "\x1b" not in stream.getvalue()


def test_a_terminal_sees_stage_bar_and_iou(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = Terminal()
    with Progress("auto", stream) as progress, progress.stage("search"):
        progress.update(0.25, iou=0.9312)
        assert progress._bar is not None
        progress._bar.refresh()
    assert "search" in stream.getvalue() and "IoU 0.931" in stream.getvalue()


def test_a_failed_stage_is_timed_and_the_error_goes_on() -> None:
    progress = Progress("quiet")
    with pytest.raises(KeyboardInterrupt), progress, progress.stage("search"):
        raise KeyboardInterrupt
    assert set(progress.timings) == {"search"}


def test_nested_stages() -> None:
    stream = Terminal()
    with Progress("auto", stream) as progress, progress.stage("verify"):
        with progress.stage("shadow"):
            progress.update(0.5)
        progress.update(0.75)
    assert set(progress.timings) == {"verify", "shadow"}


def test_stages_and_the_rest_add_up_to_the_whole_with_child_processes() -> None:
    burn = "import time\nwhile time.process_time() < 0.3: pass\nprint()\ninput()"
    with Progress("quiet") as progress, progress.stage("verify"), progress.stage("shadow"):
        call = [sys.executable, "-c", burn]
        with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
            assert child.stdout is not None
            child.stdout.readline()  # it still runs at the end of the stage
            running = cpu_seconds()
            child.communicate(b"\n")
    for account in progress.account():
        parts = [seconds for name, seconds in account.items() if name != "total"]
        assert min(parts) >= 0 and sum(parts) == pytest.approx(account["total"], abs=0.05)
    assert progress.cpu["shadow"] >= 0.28 > progress.cpu["verify"]
    assert cpu_seconds() >= running - 0.05


def test_update_outside_a_stage_is_no_error() -> None:
    Progress("auto", io.StringIO()).update(0.5)


def ring(x: float) -> Knots:
    t = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    return Knots((Knot(np.stack([x * np.cos(t), x * np.sin(t), 0 * t], axis=1)),), 1.5)


def test_the_end_is_told_last() -> None:
    events = io.StringIO()
    with Progress("quiet", io.StringIO(), events) as progress:
        progress.show(lambda: ring(10.0), certified=True)
        progress.tell("end", exit_code=0)
    told = [json.loads(line)["event"] for line in events.getvalue().splitlines()]
    assert told[-2:] == ["standing", "end"]


def test_events_say_all_that_happens_and_few_frames() -> None:
    events, made = io.StringIO(), []
    with Progress("quiet", io.StringIO(), events) as progress, progress.stage("search"):
        progress.say("a remark")
        for k in range(500):

            def knots(k: int = k) -> Knots:
                made.append(k)
                return ring(10.0 + k)

            progress.update(k / 500, 0.9)
            progress.show(knots, certified=k < 400)
    told = [json.loads(line) for line in events.getvalue().splitlines()]
    kinds = [event["event"] for event in told]
    assert kinds[:3] == ["stage", "say", "progress"] and kinds[-1] == "standing"
    assert kinds.count("knots") < 10 and len(made) == kinds.count("knots") + 1
    seen = np.frombuffer(base64.b64decode(told[3]["curves"][0]), "<f4").reshape(-1, 3)
    assert np.allclose(seen, ring(10.0).points, atol=1e-5)
    standing = json.loads(told[-1]["start"])
    assert standing["knots"][0]["points"] == ring(409.0).points.tolist()  # the last certified ones


def test_where_nobody_watches_no_knots_are_made() -> None:
    def knots() -> Knots:
        raise AssertionError("nobody asked for them")

    with Progress("quiet") as progress:
        progress.show(knots, certified=True)


def test_a_reader_that_went_away_is_no_error() -> None:
    events = io.StringIO()
    with Progress("quiet", events=events) as progress, progress.stage("search"):
        events.close()
        progress.tell("end")
        progress.show(lambda: ring(1.0), certified=True)


def test_the_time_left_follows_from_what_the_stages_took(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    events = io.StringIO()
    with Progress("quiet", events=events) as progress:
        progress.plan({"radius": 10.0, "search": 20.0, "verify": 30.0})
        with progress.stage("radius"):
            now[0] += 40.0  # a slow machine
        with progress.stage("search"):
            now[0] += 10.0
            progress.update(0.25)
        with progress.stage("verify"):
            now[0] += 1000.0
    told = [json.loads(line) for line in events.getvalue().splitlines()]
    first, second, running, last = (event["left_s"] for event in told)
    assert first == 60.0  # as usual, while nothing is known
    slower = 43.0 / 13.0
    assert second == pytest.approx(slower * 50, abs=0.1)
    assert running == pytest.approx(30.0 + slower * 30, abs=0.1)  # three quarters of 40 s to come
    assert 0 < last < 200
    shares = [event["share"] for event in told if "share" in event]
    assert shares == sorted(shares) and 0 < shares[0] < 1


def test_what_takes_longer_than_usual_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    events = io.StringIO()
    with Progress("quiet", events=events) as progress:
        progress.plan({"slicer": 8.0})
        with progress.stage("slicer"):
            for seconds in (7.0, 5.0, 30.0):
                now[0] += seconds
                progress.update(0.5, even=False)  # half of its work, not of its time
        with progress.stage("report"):  # which nobody planned
            now[0] += 50.0
            progress.update(0.0)
    told = [json.loads(line) for line in events.getvalue().splitlines()]
    seen = [event for event in told if event["event"] == "progress"]
    assert [event["late"] for event in seen] == [False, True, True, False]
    assert seen[0]["left_s"] == pytest.approx(1.0)


@pytest.mark.parametrize("mode", ["auto", "quiet", "verbose"])
def test_every_mode_logs_its_stages(mode: Mode, caplog: pytest.LogCaptureFixture) -> None:
    """A library's caller reads the stages after logging.basicConfig(level=logging.INFO)."""
    with caplog.at_level("INFO", logger="knotfab"):
        run(mode, io.StringIO())
    said = [record.getMessage().split(":")[0] for record in caplog.records]
    assert said == ["template", "search", "search"]
    assert {record.name for record in caplog.records} == {"knotfab"}


def test_verbose_leaves_the_logger_as_it_was() -> None:
    logger = logging.getLogger("knotfab")
    before = logger.level, list(logger.handlers)
    run("verbose", io.StringIO())
    assert (logger.level, logger.handlers) == before


def test_a_terminal_with_room_shows_the_knots_below_the_bar(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    view = ResolvedView(frame_width_mm=100.0, frame_height_mm=100.0)
    asked: list[tuple[int, int]] = []

    def draw(views: Sequence[ResolvedView], knots: Knots, columns: int, rows: int) -> str:
        asked.append((columns, rows))
        assert list(views) == [view] and knots.radius_mm == 1.5
        return "THE\nKNOTS"

    def show(columns: int, lines: int, term: str, stream: io.StringIO) -> str:
        for name, value in (("COLUMNS", columns), ("LINES", lines), ("TERM", term)):
            monkeypatch.setenv(name, str(value))
        with Progress("auto", stream, draw=draw) as progress, progress.stage("search"):
            progress.set_scene([view], list, 1.5)
            for _ in range(50):  # few of these are drawn
                progress.show(lambda: ring(30.0), certified=True)
            if progress._bar is not None:
                progress._bar.refresh()
        return stream.getvalue()

    assert "KNOTS" in show(80, 24, "xterm-256color", Terminal())
    ((columns, rows),) = asked
    assert columns <= 80 and 8 <= rows <= 22
    for unfit in ((20, 24, "xterm"), (80, 9, "xterm"), (80, 24, "dumb")):
        assert "KNOTS" not in show(*unfit, Terminal())
    assert show(80, 24, "xterm", io.StringIO()) == "" and len(asked) == 1


def test_a_reader_of_the_events_may_go_away() -> None:
    first = io.StringIO()
    with Progress("quiet", events=first) as progress:
        progress.tell("one")
        assert json.loads(first.getvalue())["event"] == "one"
        first.close()
        progress.tell("two")
        progress.tell("three")


def test_a_callable_hears_events_and_ends_work_by_raising() -> None:
    heard: list[Event] = []
    written = io.StringIO()
    with Progress("quiet", events=written, heard=heard.append) as progress:
        progress.plan({"search": 4.0, "part": 1.0})
        with progress.stage("search"):
            progress.update(0.5, iou=0.9)
        with progress.stage("part"):
            progress.say("a word")
    lines = [json.loads(line) for line in written.getvalue().splitlines()]
    assert [{"event": event.name, **event.data} for event in heard] == lines
    assert [event.stage for event in heard] == ["search", "search", "part", "part"]
    shares = [event.share for event in heard]
    assert shares == sorted(shares) and shares[-1] > 0 and heard[1].left_s is not None

    class Stop(BaseException):
        pass

    def stop(event: Event) -> None:
        raise Stop(event.name)

    with Progress("quiet", heard=stop) as progress:
        # a listener that swallowed the first is told again, and called no more
        for name in ("say", "stage"):
            with pytest.raises(Stop, match="say"):
                progress.tell(name)
