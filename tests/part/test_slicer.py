"""Slicing for real where PrusaSlicer is installed, and a slicer that misbehaves in every way."""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from slicer_parts import Mesh, box, gcode_text, scene_of, write_boxes

from knotfab.geometry.tube import sweep
from knotfab.part import slicer as run
from knotfab.part import slicer_process as find
from knotfab.part import slicer_process as process
from knotfab.part.files import About, write_coloured_3mf
from knotfab.part.gcode import read_gcode
from knotfab.part.slicer import SlicerQueue, slice_part
from knotfab.part.slicer_process import REMEDY, NotSliced, Sliced, find_slicer
from knotfab.part.slicer_profile import write_profile

needs_slicer = pytest.mark.skipif(
    find_slicer() is None, reason=f"PrusaSlicer is not installed: {REMEDY}"
)
CUBE = box((0, 0, 0), (10, 10, 10))
INFO = "[part.3mf]\n" + "".join(f"min_{a} = 0.0\nmax_{a} = 10.0\n" for a in "xyz")
INFO += "manifold = yes\nvolume = 1000.0\n"


def _fake(folder: Path, slicing: str, info: str | None = None) -> str:
    """A program that answers `--info`, and does `slicing` (shell) where it is to slice."""
    folder.mkdir(exist_ok=True)
    (folder / "info.txt").write_text(INFO)
    (folder / "good.gcode").write_text(gcode_text())
    program = folder / "prusa-slicer"
    program.write_text(
        f"""#!/bin/sh
here={folder}
case "$*" in
*--info*) {info or 'cat "$here/info.txt"'};;
*) {slicing};;
esac
"""
    )
    program.chmod(0o755)
    return str(program)


def _slice(
    tmp_path: Path, program: str | None, *meshes: Mesh, scene: str = "", timeout_s: float = 60.0
) -> Sliced | NotSliced:
    """Slice boxes in a folder that must be empty afterwards."""
    setting = scene_of(scene)
    part = write_boxes(tmp_path / "part.3mf", *(meshes or (CUBE,)), scene=setting)
    work = tmp_path / "work"
    work.mkdir(exist_ok=True)
    result = slice_part(part, setting, work, timeout_s, program)
    assert not list(work.iterdir())
    return result


def _slice_meshes(tmp_path: Path, *meshes: Mesh, scene: str = "") -> Sliced:
    result = _slice(tmp_path, None, *meshes, scene=scene)
    assert isinstance(result, Sliced), result
    return result


def _failures(result: Sliced) -> set[str]:
    return {check.name for check in result.checks if not check.passed}


@pytest.mark.slow
@needs_slicer
def test_a_cube(tmp_path: Path) -> None:
    found = _slice_meshes(tmp_path)
    assert found.program == "PrusaSlicer" and found.version[0].isdigit()
    assert (found.layers, found.objects, found.support_m) == (50, 1, 0.0)
    assert found.problems == [] and found.warnings == () and len(found.checks) == 6
    assert 60 < found.time_s < 3600
    grams = found.filament_m * 1000 * 3.14159 * 1.75**2 / 4 * 1.24e-3
    assert found.filament_g == pytest.approx(grams, rel=0.02) and 0.4 < grams < 1.3
    assert "part.3mf" in found.command and str(tmp_path) not in found.command


@needs_slicer
def test_bodies_stay_where_they_are(tmp_path: Path) -> None:
    """PrusaSlicer drops each object of a file onto the bed by itself: the file holds one."""
    found = _slice_meshes(tmp_path, CUBE, box((0, 0, 15), (10, 10, 10)), box((30, 5, 4), (5, 5, 5)))
    assert found.problems == [] and (found.layers, found.objects) == (100, 1)
    assert found.support_m > 0


@needs_slicer
def test_bodies_of_several_objects_are_dropped_and_noticed(tmp_path: Path) -> None:
    """What part-colours.3mf would come to: the slicer's own reading and the G-code tell."""
    meshes = [CUBE, box((30, 0, 15), (10, 10, 10))]
    write_profile(tmp_path, scene_of())
    part = tmp_path / "part.3mf"
    write_coloured_3mf(part, meshes, ["a", "b"], ["#d9d4c7", "#3d6fa5"], About("two"))
    found = slice_part(part, scene_of(), tmp_path)
    assert isinstance(found, Sliced) and found.objects == 2
    assert _failures(found) >= {"reading", "surface", "layers"}


def _knots_apart() -> list[Mesh]:
    """Three loose knots at different heights, the lowest on the bed."""
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    wave = np.stack([6 * np.cos(t), 6 * np.sin(t), np.sin(2 * t)], axis=1)
    places = ((10.0, 10.0, 3.0), (28.0, 10.0, 6.0), (18.0, 28.0, 9.0))
    meshes = [sweep(wave + np.array(place), 2.0, 12) for place in places]
    low = np.min([vertices.min(axis=0) for vertices, _ in meshes], axis=0)
    return [(vertices - low, faces) for vertices, faces in meshes]


@pytest.mark.slow
@needs_slicer
def test_three_loose_knots_are_printed_each_where_it_belongs(tmp_path: Path) -> None:
    """By the report's command, as a person would slice the folder: from the very files, byte for byte, the
    same G-code that was checked, but for its date, with each knot in its place, read by hand.
    """
    knots = _knots_apart()
    kept = tmp_path / "kept"
    kept.mkdir()
    program = tmp_path / "prusa-slicer"
    program.write_text(f'#!/bin/sh\n{find_slicer()} "$@" && cp * {kept}\n')
    program.chmod(0o755)
    found = _slice(tmp_path, str(program), *knots)
    assert isinstance(found, Sliced) and found.problems == [] and found.objects == 1
    for name in ("part.3mf", "slicer.ini"):
        assert (kept / name).read_bytes() == (tmp_path / name).read_bytes()
    subprocess.run(found.command, shell=True, cwd=tmp_path, check=True, capture_output=True)
    dated = "; generated by PrusaSlicer "
    by_hand, checked = (
        [line for line in (folder / "part.gcode").read_text().splitlines() if dated not in line]
        for folder in (tmp_path, kept)
    )
    assert len(by_hand) > 1000 and by_hand == checked
    gcode = read_gcode(tmp_path / "part.gcode")
    every = np.concatenate([vertices for vertices, _ in knots])
    middle = np.array([125.0, 105.0]) - (every.min(axis=0) + every.max(axis=0))[:2] / 2
    lines = np.concatenate([gcode.start, gcode.end]) - [*middle, 0.0]
    for vertices, _ in knots:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        own = lines[((lines > low - 1) & (lines < high + 1)).all(axis=1)]
        assert own.min(axis=0) == pytest.approx(low, abs=0.6)
        assert own.max(axis=0) == pytest.approx(high, abs=0.6)


@pytest.mark.slow
@needs_slicer
def test_what_exit_code_0_hides(tmp_path: Path) -> None:
    """It ends with 0 for each of these."""
    vertices, faces = CUBE
    assert "reading" in _failures(_slice_meshes(tmp_path, (vertices, faces[:-1])))
    assert _failures(_slice_meshes(tmp_path, CUBE, box((20, 0, 0), (10, 0.1, 10)))) >= {"surface"}
    assert _failures(_slice_meshes(tmp_path, CUBE, box((5, 0, 0), (10, 10, 10)))) == {"surface"}
    assert _failures(_slice_meshes(tmp_path, box((0, 0, 0), (10, 10, 222)))) == {"bed"}
    assert _failures(_slice_meshes(tmp_path, box((0, 0, 0), (251, 10, 2)))) == {"bed"}


@needs_slicer
def test_a_body_in_the_air_without_supports(tmp_path: Path) -> None:
    found = _slice_meshes(
        tmp_path, CUBE, box((0, 0, 15), (10, 10, 10)), scene="[printer]\nsupports = false"
    )
    assert len(found.problems) == 1 and "Empty layer" in found.problems[0]
    assert not found.warnings[0].settled and found.warnings[0].explanation


@pytest.mark.slow
@needs_slicer
def test_a_part_that_is_refused(tmp_path: Path) -> None:
    thin = _slice(tmp_path, None, box((0, 0, 0), (10, 0.1, 10)))
    assert isinstance(thin, NotSliced) and thin.kind == "refused" and "empty" in thin.reason
    high = _slice(tmp_path, None, scene="[printer]\nlayer_height_mm = 0.5")
    assert isinstance(high, NotSliced) and high.kind == "refused" and "ayer height" in high.reason


@pytest.mark.slow
@needs_slicer
def test_no_setting_of_the_user_is_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "home"
    (home / ".config").mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home / ".config"))
    _slice_meshes(tmp_path)
    assert [path.name for path in home.rglob("*")] == [".config"]


@needs_slicer
def test_a_folder_of_an_awkward_name(tmp_path: Path) -> None:
    folder = tmp_path / "a b – é ' [1]"
    folder.mkdir()
    assert _slice_meshes(folder).problems == []


def test_what_is_no_filament_is_not_sliced(tmp_path: Path) -> None:
    found = _slice(tmp_path, "no such program", scene="[printer]\nname = 'form-3'")
    assert isinstance(found, NotSliced) and found.kind == "process"


def test_a_missing_program_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    absent = _slice(tmp_path, str(tmp_path / "nowhere"))
    monkeypatch.setenv("PATH", str(tmp_path))
    for found in (absent, _slice(tmp_path, None)):
        assert isinstance(found, NotSliced) and found.kind == "missing"
        assert found.remedy == REMEDY


def test_a_program_that_is_found_by_another_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _fake(tmp_path / "bin", "exit 0")
    (tmp_path / "bin" / "prusa-slicer").rename(tmp_path / "bin" / "PrusaSlicer")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert find_slicer() == shutil.which("PrusaSlicer") is not None


def test_a_program_where_its_installer_put_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _fake(tmp_path / "Program Files", "exit 0")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_slicer() is None
    monkeypatch.setattr(find, "PLACES", (str(tmp_path / "Program Files"),))
    assert find_slicer() == str(tmp_path / "Program Files" / "prusa-slicer")


def test_without_process_groups_the_system_ends_what_was_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows has none: taskkill is called for the whole tree, and the program itself is killed."""
    monkeypatch.delattr(process.os, "killpg")
    told = tmp_path / "told"
    for call in (f'echo "$*" > {told}', None):  # there, and not there
        _fake(tmp_path / "bin", "sleep 30")
        taskkill = tmp_path / "bin" / "taskkill"
        taskkill.unlink(missing_ok=True)
        if call is not None:
            taskkill.write_text(f"#!/bin/sh\n{call}\n")
            taskkill.chmod(0o755)
        folder = tmp_path / "work"
        folder.mkdir(exist_ok=True)
        path = f"{tmp_path / 'bin'}:/usr/bin:/bin"
        monkeypatch.setenv("PATH", path)
        ended = process.run_limited(["sleep", "30"], folder, 0.2)
        assert ended.stopped == process.OUT_OF_TIME and ended.code == -9
    assert told.read_text().startswith("/F /T /PID ")


def test_a_file_without_bodies_is_the_callers_error(tmp_path: Path) -> None:
    write_profile(tmp_path, scene_of())
    (tmp_path / "part.3mf").write_bytes(b"none")
    with pytest.raises(ValueError, match="not a 3MF"):
        slice_part(tmp_path / "part.3mf", scene_of(), tmp_path, program="prusa-slicer")
    assert {path.name for path in tmp_path.iterdir()} == {"part.3mf", "slicer.ini"}


COPY = 'cp "$here/good.gcode" part.gcode'


@pytest.mark.parametrize(
    ("slicing", "info", "kind", "said"),
    [
        ("echo 'it does not fit' >&2; exit 1", None, "refused", "it does not fit"),
        ("exit 3", None, "refused", "exit code 3, without a word"),
        ("echo 'print warning: odd'; kill -SEGV $$", None, "crashed", "signal 11"),
        ("exit 0", None, "crashed", "cannot be read"),
        ("head -c 5000 /dev/urandom > part.gcode", None, "crashed", "which program"),
        ('head -n 14 "$here/good.gcode" > part.gcode', None, "crashed", "cut off"),
        (COPY, "exit 1", "refused", "without a word"),
        (COPY, "kill -9 $$", "stopped", "signal 9"),
        ("kill -TERM $$", None, "stopped", "--skip slicer"),
    ],
)
def test_how_it_may_fail(
    tmp_path: Path, slicing: str, info: str | None, kind: str, said: str
) -> None:
    found = _slice(tmp_path, _fake(tmp_path / "bin", slicing, info))
    assert isinstance(found, NotSliced) and found.kind == kind
    assert said in found.reason


def test_its_words_are_quoted_and_cut_short(tmp_path: Path) -> None:
    found = _slice(
        tmp_path, _fake(tmp_path / "bin", "yes disaster | head -c 3000 | tr '\\n' ' '; exit 1")
    )
    assert isinstance(found, NotSliced) and "disaster" in found.said and len(found.reason) < 500


def test_warnings_and_garbage_on_both_outputs(tmp_path: Path) -> None:
    slicing = (
        "echo '10 => Processing'; echo 'print warning: Empty layer between 1 and 2.';"
        "echo 'Object name: knot 1'; echo '90 => Done'; printf 'caf\\351 \\377\\n' >&2;"
        "echo 'Gtk-WARNING **: no display' >&2; " + COPY
    )
    found = _slice(tmp_path, _fake(tmp_path / "bin", slicing))
    assert isinstance(found, Sliced) and found.time_s == 3723 and found.filament_m == 0.1005
    texts = [warning.text for warning in found.warnings]
    assert texts[0] == "Empty layer between 1 and 2.\nObject name: knot 1" and len(texts) == 3
    assert [w.settled for w in found.warnings] == [False, False, True]
    # and the G-code, of one line, is not the cube
    assert _failures(found) == {"place", "surface", "layers"}


@pytest.mark.slow
@pytest.mark.parametrize("slicing", ["sleep 600", "sleep 600 & wait", "trap '' TERM; sleep 600"])
def test_a_program_that_does_not_end_is_stopped(tmp_path: Path, slicing: str) -> None:
    slicing = f"echo $$ > {tmp_path}/pid; {slicing}"
    found = _slice(tmp_path, _fake(tmp_path / "bin", slicing), timeout_s=0.5)
    assert isinstance(found, NotSliced) and found.kind == "stopped" and "0.5 s" in found.reason
    _gone(int((tmp_path / "pid").read_text()))


def _gone(group: int) -> None:
    """No process of the group is alive (one that waits to be reaped is not)."""
    for _ in range(100):
        alive = []
        for path in Path("/proc").glob("[0-9]*/stat"):
            try:
                state, _, own = path.read_text().rpartition(")")[2].split()[:3]
            except OSError:
                continue
            if own == str(group) and state != "Z":
                alive.append(path)
        if not alive:
            return
        time.sleep(0.02)
    raise AssertionError(f"still alive: {alive}")


@pytest.mark.slow
def test_a_program_that_never_stops_talking(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "MOST_SAID", 100_000)
    found = _slice(tmp_path, _fake(tmp_path / "bin", "yes"))
    assert isinstance(found, NotSliced) and found.kind == "stopped" and "said more" in found.reason
    found = _slice(tmp_path, _fake(tmp_path / "bin", "yes >&2"))
    assert isinstance(found, NotSliced) and "said more" in found.reason


def test_a_program_that_fills_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "MOST_WRITTEN", 1_000_000)
    slicing = "while true; do head -c 300000 /dev/zero >> part.gcode; sleep 0.01; done"
    found = _slice(tmp_path, _fake(tmp_path / "bin", slicing))
    assert isinstance(found, NotSliced) and found.kind == "stopped" and "wrote more" in found.reason


def test_a_build_that_ends_takes_the_slicer_with_it(tmp_path: Path) -> None:
    program = _fake(tmp_path / "bin", f"echo $$ > {tmp_path}/pid.new; sleep 600")
    part = write_boxes(tmp_path / "part.3mf", CUBE)
    with pytest.raises(KeyboardInterrupt), SlicerQueue(tmp_path, program=program) as queue:
        slicing = queue.submit(part, scene_of())
        while not (tmp_path / "pid.new").is_file() or not (tmp_path / "pid.new").read_text():
            time.sleep(0.01)
        raise KeyboardInterrupt
    _gone(int((tmp_path / "pid.new").read_text()))
    assert slicing.result() == NotSliced("stopped", "the build ended")
    assert not list(tmp_path.glob("slicer-*"))


def test_how_far_it_is_is_told_while_it_slices(tmp_path: Path) -> None:
    said = "printf '10 => a\\n70 => b\\n 30 => c\\n'"
    program = _fake(
        tmp_path / "bin", f"{said}; while [ ! -e {tmp_path}/on ]; do sleep .02; done; {COPY}"
    )
    part = write_boxes(tmp_path / "part.3mf", CUBE)
    with SlicerQueue(tmp_path, program=program) as queue:
        slicing = queue.submit(part, scene_of())
        until = time.monotonic() + 60
        while queue.done != 0.7 and time.monotonic() < until:
            time.sleep(0.01)
        assert queue.done == 0.7 and not slicing.done()
        (tmp_path / "on").touch()
        assert isinstance(slicing.result(), Sliced)


def test_its_own_home_and_no_display(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for key, value in (("DISPLAY", ":0"), ("LC_ALL", "de_DE.UTF-8"), ("XDG_DATA_HOME", "/x")):
        monkeypatch.setenv(key, value)
    _slice(tmp_path, _fake(tmp_path / "bin", f"env > {tmp_path}/env; {COPY}"))
    found = dict(line.split("=", 1) for line in (tmp_path / "env").read_text().splitlines())
    assert str(tmp_path / "work") in found["HOME"] and found["HOME"] == found["XDG_CONFIG_HOME"]
    assert not {"DISPLAY", "LC_ALL", "XDG_DATA_HOME"} & set(found)


def test_our_own_error_is_raised_where_the_result_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("ours")

    monkeypatch.setattr(run, "compare_gcode", broken)
    with pytest.raises(RuntimeError, match="ours"):
        _slice(tmp_path, _fake(tmp_path / "bin", COPY))
    assert not list((tmp_path / "work").iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="the system must tell children")
def test_the_program_ends_when_the_build_is_killed(tmp_path: Path) -> None:
    program = (
        "import pathlib, sys; from knotfab.part.slicer_process import run_limited;"
        f"run_limited(['sh', '-c', 'echo $$ > started; exec sleep 60'], pathlib.Path({str(tmp_path)!r}), 60)"
    )
    build = subprocess.Popen([sys.executable, "-c", program])
    until, started = time.monotonic() + 30, tmp_path / "started"
    while not (started.exists() and started.read_text().strip()) and time.monotonic() < until:
        time.sleep(0.02)
    slicer = Path(f"/proc/{started.read_text().strip()}/cmdline")
    assert b"sleep" in slicer.read_bytes() or b"sh" in slicer.read_bytes()
    build.kill()
    build.wait()
    while time.monotonic() < until:
        try:
            if slicer.read_bytes() == b"":  # the slicer of a run that nobody waits for
                return
        except OSError:
            return
        time.sleep(0.02)
    pytest.fail("it outlives the build")
