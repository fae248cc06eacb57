"""Progress: drawn on a terminal alone, silent when piped or quiet; stages always timed."""

from __future__ import annotations

import io
import logging
import subprocess
import sys

import pytest

from knotfab.progress import Mode, Progress


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
        progress.note("a remark")
    return progress


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
    assert [line.split(":")[0] for line in lines] == ["template", "search", "search", "a remark"]
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


def test_update_outside_a_stage_is_no_error() -> None:
    Progress("auto", io.StringIO()).update(0.5)


def test_nothing_of_rich_is_loaded_when_piped() -> None:
    code = (
        "import io, sys; from knotfab.progress import Progress\n"
        "with Progress('verbose', io.StringIO()) as p:\n"
        "    with p.stage('a'): p.update(0.5)\n"
        "print('rich' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_line_for_each_of_several_things_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = Terminal()
    with Progress("auto", stream) as progress, progress.stage("pictures"):
        assert progress._bar is not None
        with progress.line("cat"), progress.line("dog"):
            assert [t.description for t in progress._bar.tasks] == ["pictures", "cat", "dog"]
            progress._bar.refresh()
        assert [t.description for t in progress._bar.tasks] == ["pictures"]
    assert "cat" in stream.getvalue() and "dog" in stream.getvalue()
    with Progress("quiet", stream).line("cat"):
        pass


@pytest.mark.parametrize("mode", ["auto", "quiet", "verbose"])
def test_every_mode_logs_its_stages(mode: Mode, caplog: pytest.LogCaptureFixture) -> None:
    """As a library's caller reads them: logging.basicConfig(level=logging.INFO)."""
    with caplog.at_level("INFO", logger="knotfab"):
        run(mode, io.StringIO())
    said = [record.getMessage().split(":")[0] for record in caplog.records]
    assert said == ["template", "search", "search", "a remark"]
    assert {record.name for record in caplog.records} == {"knotfab"}


def test_verbose_leaves_the_logger_as_it_was() -> None:
    logger = logging.getLogger("knotfab")
    before = logger.level, list(logger.handlers)
    run("verbose", io.StringIO())
    assert (logger.level, logger.handlers) == before
