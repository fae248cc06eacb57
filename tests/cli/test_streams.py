"""No console, reader or disk that a command writes to changes what the command does."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

PROGRAM = """
import sys
from knotfab.cli.streams import guard_streams, why_unsaid
guard_streams()
for number in range(20000):
    print(f"line {number}")
print(why_unsaid(), file=sys.stderr)
sys.exit(7)
"""
SIGNS = """
from knotfab.cli.streams import guard_streams
guard_streams()
print("cm³ 45° × … – ≤ é 猫 caf\\udce9")
"""


def run(
    program: str, environment: Mapping[str, str] = os.environ, **streams: object
) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=environment, stderr=subprocess.PIPE, timeout=60, **streams)  # type: ignore[call-overload,no-any-return]


@pytest.mark.parametrize("encoding", ["cp932", "cp1251", "ascii", "latin-1", "utf-8"])
def test_signs_that_a_console_lacks_are_replaced(encoding: str) -> None:
    done = run(SIGNS, {**os.environ, "PYTHONIOENCODING": encoding}, stdout=subprocess.PIPE)
    said = done.stdout.decode(encoding)
    assert done.returncode == 0 and done.stderr == b""
    assert said.startswith("cm") and said.rstrip().endswith("caf\\xe9")
    if encoding == "ascii":
        assert said.strip() == "cm3 45 deg x ... - <= e \\u732b caf\\xe9"


def test_a_pipe_that_is_closed_early_changes_no_exit_code() -> None:
    command = [sys.executable, "-c", PROGRAM]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, env=dict(os.environ), **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == b"line 0\n"
        process.stdout.close()
        assert (process.wait(), process.stderr.read()) == (7, b"None\n")


def test_what_cannot_be_said_for_want_of_space_is_told() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("needs a device that is full")
    with open("/dev/full", "wb") as full:
        done = run(PROGRAM, stdout=full)
    assert done.returncode == 7 and done.stderr.count(b"\n") == 1
    assert b"cannot be written (No space left on device)" in done.stderr


@pytest.mark.parametrize("closed", [0, 1, 2])
def test_a_closed_stream_is_nowhere(closed: int) -> None:
    """No file that is opened later takes a closed stream's place."""
    check = PROGRAM.replace("for number", 'assert open("/dev/null").fileno() > 2\nfor number')
    command = ["sh", "-c", f'exec {closed}>&-; "$0" -c "$1"', sys.executable, check]
    assert subprocess.run(command, capture_output=True, timeout=60).returncode == 7
