"""However a command ends: interrupted, without its verifier, or where nothing takes its words."""

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from command import knotfab, picture, refuse, square

from knotfab.apps import doctor
from knotfab.apps.doctor import Finding
from knotfab.base.errors import MachineError
from knotfab.pipeline.verifier import Files, Verifier
from knotfab_formats.errors import InputError


def child_of(process: int) -> list[int]:
    """Process numbers of the children."""
    found = []
    for task in Path(f"/proc/{process}/task").iterdir():
        found += [int(p) for p in (task / "children").read_text().split()]
    return found


def gone(process: int) -> bool:
    try:
        return "zombie" in Path(f"/proc/{process}/status").read_text()
    except OSError:
        return True


@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_that_is_dropped_on_its_way(
    monkeypatch: pytest.MonkeyPatch, asked: signal.Signals
) -> None:
    """A callback of numba's compiler drops an interrupt, and the compiler fails a step later."""

    def examine() -> list[Finding]:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(asked)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr(doctor, "examine", examine)
    before = signal.signal(asked, signal.SIG_DFL)  # under nohup it is ignored
    try:
        done = knotfab("doctor")
    finally:
        signal.signal(asked, before)
    assert (done.code, done.err) == (130, "knotfab: interrupted; nothing was changed\n")


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyError("a fault of ours"), 3, "a mistake of knotfab's own: KeyError"),
        (RuntimeError("two\nlines \udce9"), 3, "RuntimeError (two lines \\xe9)"),
        (RecursionError(), 2, "nested too deep"), (MemoryError(), 3, "this machine has no more"),
        (RuntimeError("can't start new thread"), 3, "this machine has no more"),
        (ImportError("no symbol", name="torch"), 3, "the library torch: it cannot be loaded"),
        (ImportError("failed to map segment", name="torch"), 3, "this machine has no more"),
        (UnicodeEncodeError("ascii", "ö", 0, 1, "no"), 3, "UnicodeEncodeError"),
        (OSError(errno.EROFS, "Read-only file system", "a.png"), 3, "a.png: it fails (Read-only"),
        (OSError(errno.EFBIG, "File too large", "a.png"), 3, "(File too large)"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "a" * 4000), 2, "(File name too long)"),
        (PermissionError(errno.EACCES, "Permission denied", b"\xe9"), 2, "\\xe9: it cannot be used"),
        (OSError("odd"), 3, "the system: it fails (odd)"),
    ],
)  # fmt: skip
def test_no_traceback_reaches_a_person(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: Exception, code: int, said: str
) -> None:
    """Any other error becomes one sentence; the traceback of a mistake of ours lies in a file to send."""

    def examine() -> list[Finding]:
        raise error

    monkeypatch.setattr(doctor, "examine", examine)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = knotfab("doctor")
    assert (done.code, done.out, done.err.count("\n")) == (code, "", 1) and said in done.err
    kept = list(tmp_path.iterdir())
    assert bool(kept) == ("mistake" in done.err)
    for file in kept:
        assert str(file) in done.err and "Traceback" in file.read_text()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs the process table of Linux")
def test_interrupted_in_the_middle_of_the_search(tmp_path: Path) -> None:
    """Code 130, the earlier result as it was, no folder and no process left over.

    By kill, whose signal only our own handler tells from the end of the process; Ctrl-C has the same.
    """
    out = tmp_path / "out"
    out.mkdir()
    (out / "part.stl").write_text("earlier")
    drawn = picture(tmp_path / "square.png", square())
    call = [sys.executable, "-m", "knotfab", "build", str(drawn), "--tube-radius", "5"]
    build = subprocess.Popen(
        [*call, "--accuracy", "fine", "--skip", "shadow-render", "--verbose", "--out", str(out)],
        env={**os.environ, "KNOTFAB_JOBS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert build.stderr is not None
        said = ""
        for line in build.stderr:
            said += line
            if line.startswith("template:"):
                break
        else:
            pytest.fail(f"no search began: {said}")
        time.sleep(0.3)
        children = child_of(build.pid)
        assert children, "the verifier was to start before the search"
        assert "serve.py" not in Path(f"/proc/{children[0]}/cmdline").read_text()  # it is a copy
        assert len(list(out.iterdir())) == 2  # the earlier part, and the hidden folder
        for _ in range(6):  # Python drops one that arrives while it frees something: press again
            build.send_signal(signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                printed, err = build.communicate(timeout=15)
                break
    finally:
        build.kill()
    assert build.returncode == 130
    assert printed == "" and "Traceback" not in err
    assert "knotfab: interrupted; nothing was changed" in err
    assert [p.name for p in out.iterdir()] == ["part.stl"]
    assert (out / "part.stl").read_text() == "earlier"
    assert all(gone(p) for p in children)


@pytest.mark.parametrize(
    ("script", "how"),
    [
        ("kill -SEGV $$", "SIGSEGV"),
        ("echo 'loading GL'; kill -ABRT $$", "SIGABRT"),
        ("echo 'ImportError: no GL' >&2; exit 1", "exit code 1 (ImportError: no GL)"),
    ],
)
def test_a_verifier_that_dies_is_a_lack_of_this_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, how: str
) -> None:
    crashing = tmp_path / "python"
    crashing.write_text(f"#!/bin/sh\nulimit -c 0\n{script}\n")
    crashing.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(crashing))
    knots = tmp_path / "knots.json"
    knots.write_text("{}")
    said = refuse(3, "validate", "--knots", knots)
    assert how in said and "--skip shadow-render" in said


@pytest.mark.slow
def test_a_verifier_answers_for_several_pieces(tmp_path: Path) -> None:
    """Each in its turn, whatever became of the one before; nothing of it is left."""
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    bad.write_text("{}")
    good.write_text(
        json.dumps({"schema": 1, "unit": "mm", "knots": [{"closed": True, "points": ring()}]})
    )
    with Verifier({"shadow-render"}) as verifier:
        answers = [verifier.submit(Files(None, path)) for path in (bad, good, good)]
        with pytest.raises(InputError):
            answers[0].result()
        first, second = (answer.result() for answer in answers[1:])
        assert first.checks == second.checks and first.exit_code == 0
        skipped = verifier.submit(Files(None, good), ["thickness"]).result()
        assert {c.name: c.status for c in skipped.checks}["thickness"] == "skipped"
        pending = [verifier.submit(Files(None, good)) for _ in range(50)]
    assert pending[-1].verdict.cancelled()


def ring(n: int = 200, size: float = 20.0) -> list[list[float]]:
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([size * np.cos(t), size * np.sin(t), np.zeros(n)]).tolist()


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "status", "code"), [(19.9, "pass", 0), (20.1, "fail", 1)])
def test_validate_knows_a_ring_by_its_knots_alone(
    tmp_path: Path, radius: float, status: str, code: int
) -> None:
    """The polygonal thickness of a regular polygon is its inradius."""
    path = tmp_path / "knots.json"
    knot = {"closed": True, "type": "unknot", "points": ring()}
    path.write_text(json.dumps({"schema": 1, "unit": "mm", "radius_mm": radius, "knots": [knot]}))
    done = knotfab("validate", "--knots", path, "--json")
    answer = json.loads(done.out)
    assert (done.code, answer["status"], done.err) == (code, status, "")
    checks = {c["name"]: c for c in answer["checks"]}
    assert set(checks["thickness"]) >= {"name", "status", "measured", "limit", "unit", "detail"}
    assert checks["thickness"]["status"] == status
    assert checks["thickness"]["measured"] == pytest.approx(20.0 * np.cos(np.pi / 200), rel=1e-11)
    assert checks["thickness"]["limit"] == radius
    plain = knotfab("validate", "--knots", path)
    assert plain.code == code and "thickness" in plain.out


def test_every_error_of_a_crash_names_its_exit_code() -> None:
    assert (InputError.exit_code, MachineError.exit_code) == (2, 3)


# No console, reader or disk that a command writes to changes what the command does.


PROGRAM = """
import sys
from knotfab.cli.app import guard_streams, why_unsaid
guard_streams()
for number in range(20000):
    print(f"line {number}")
print(why_unsaid(), file=sys.stderr)
sys.exit(7)
"""
SIGNS = """
from knotfab.cli.app import guard_streams
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
