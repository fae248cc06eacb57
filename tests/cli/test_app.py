"""The command line: every wrong call is one sentence and an exit code, and nothing is left behind."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from command import knotfab, picture, refuse, small_disk, square
from PIL import Image

import knotfab as package
from knotfab.apps import doctor
from knotfab.apps.doctor import Finding
from knotfab.base.errors import MachineError
from knotfab.cli.commands import app
from knotfab.pipeline import build as pipeline
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.read_options import read_seconds
from knotfab.pipeline.verifier import Files, Verifier
from knotfab_formats.errors import InputError

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="64" height="64">{}</svg>'
BAD_PICTURES = {
    "missing.png": "there is no such file",
    "folder": "it is a directory",
    "words.png": "it is not a picture",
    "outside.svg": "refers to something outside the file",
    "speck.png": "too little to be drawn",
    "checker.png": "none of these is its background",
}
BAD_SCENES = {
    "[piece]\ntube_radius = 3\n": "Did you mean 'tube_radius_mm'",
    '[piece]\ntube_radius_mm = "3 inch"\n': "in millimetres, without unit",
    "[piece]\nclearance_mm = -1\n": "must be a number not less than 0",
    "[piece]\ntube_radius_mm = nan\n": "must be a finite number",
    "[piece\n": "not valid TOML",
    "[search]\niterations = 10\n": "there is no such setting",
    "schema = 2\n": "must be 1",
    "\n".join(
        f'[[views]]\nname = "v{k}"\nazimuth_deg = {13 * k}' for k in range(13)
    ): "has 13 views",
}
BAD_CALLS = [
    (["--bogus"], "Unknown option"),
    (["--accuracy", "superb"], "Choose from"),
    (["--time-budget", "abc"], "not a positive time. Give seconds"),
    (["--time-budget", "-3"], "not a positive time"),
    (["--font", "DejaVu Serif"], "no picture is one"),
    (["--printer", "nonsense"], "no such printer"),
    (["--tube-radius", "0"], "Give millimetres"),
    (["--tube-radius", "thick"], "it is no length. Give millimetres"),
    (["--tube-radius", "-2"], "not above 0. Give millimetres"),
    (["--size", "18 parsecs"], "no unit parsecs. Use mm, cm, m or in."),
    (["--acc", "draft"], "Did you mean --accept or --accuracy?"),
    (["--depth", "9999"], "towards the light"),
    (["--knots", "0"], "neither auto nor a number"),
    (["--seed", "-1"], "negative"),
    (["--seed", "abc"], "no whole number. Give one such as 3."),
    (["--skip", "everything"], "Known: shadow-render"),
    (["--mount", "rope"], "Choose from"),
    (["--material", "steel-wire-2mm", "--mount", "wall"], "wire is bent, and a mount is printed"),
    (["--out"], "requires an argument"),
    (["--out", ""], "names no place"),
]


@pytest.fixture(scope="module")
def bad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every picture that is none, and one that is."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "folder").mkdir()
    (folder / "words.png").write_text("I am no picture.\n")
    picture(folder / "good.png", square())
    outside = '<image href="https://example.org/a.png" width="9" height="9"/>'
    (folder / "outside.svg").write_text(SVG.format(outside))
    speck = np.full((64, 64), 255, dtype=np.uint8)
    speck[30, 30] = 100  # a piece that covers less than this one pixel
    Image.fromarray(speck).save(folder / "speck.png")
    picture(folder / "checker.png", np.indices((128, 128)).sum(axis=0) % 2 == 1)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("name", "why"), BAD_PICTURES.items())
def test_bad_pictures(bad: Path, tmp_path: Path, name: str, why: str) -> None:
    said = refuse(2, "build", bad / name, "--out", tmp_path / "a" / "out")
    assert name in said and why in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_picture_too_fine_for_any_printable_tube(tmp_path: Path) -> None:
    lines = np.zeros((256, 256), dtype=bool)
    lines[100:156:16, 8:248] = True  # strokes of 0.7 mm, and the thinnest tube is 1.6 mm
    out = tmp_path / "out"
    out.mkdir()
    call = ["build", picture(tmp_path / "f.png", lines), "--out", out, "--accuracy", "draft"]
    said = refuse(1, *call, "--lines", "off")
    assert "too fine for any printable tube" in said
    assert list(out.iterdir()) == []


@pytest.mark.parametrize(("text", "why"), BAD_SCENES.items())
def test_bad_scenes(bad: Path, tmp_path: Path, text: str, why: str) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(text)
    for picture_ in ([bad / "good.png"], []):
        if "search" in text and not picture_:
            continue
        said = refuse(2, "build", *picture_, "--scene", scene, "--out", tmp_path / "out")
        assert why in said
    assert list(tmp_path.iterdir()) == [scene]


@pytest.mark.parametrize("scene", ["missing.toml", "folder", "good.png"])
def test_what_is_no_scene(bad: Path, tmp_path: Path, scene: str) -> None:
    said = refuse(2, "build", bad / "good.png", "--scene", bad / scene, "--out", tmp_path / "out")
    assert scene in said


def test_an_option_of_build_is_named_where_it_is_none() -> None:
    assert "--mount is an option of knotfab build" in refuse(
        2, "preview", "cat.png", "--mount=wall"
    )


@pytest.mark.parametrize(("options", "why"), BAD_CALLS)
def test_wrong_calls(bad: Path, tmp_path: Path, options: list[str], why: str) -> None:
    where = ["--out", str(tmp_path / "out")] if "--out" not in options else []
    assert why in refuse(2, "build", bad / "good.png", *where, *options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("30", 30.0), ("30s", 30.0), ("90sec", 90.0), ("2 seconds", 2.0), ("1m", 60.0),
        ("1.5min", 90.0), ("1,5min", 90.0), (".5 minutes", 30.0), ("1m30s", 90.0),
        ("1h 5 min", 3900.0), ("2H", 7200.0),
    ],
)  # fmt: skip
def test_times(text: str, seconds: float) -> None:
    assert read_seconds(text) == pytest.approx(seconds)


@pytest.mark.parametrize(
    "text", ["", "s", "0", "0min", "-3", "nan", "inf", "1:30", "1m 30", "5 parsecs", "1.2.3s", "m5"]
)
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(InputError, match=r"--time-limit .*not a positive time"):
        read_seconds(text, "--time-limit")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "in_scene", "printing"),
    [
        ([], "", False),
        (["--print"], "", True),
        (["--mount", "wall"], "", True),
        (["--mount", "stand"], "", True),
        (["--mount", "none"], "", False),
        # a scene that a build wrote gives the same part again
        ([], '[mount]\nkind = "stand"\n', True),
        ([], "[piece]\nprinted = true\n", True),
        ([], '[mount]\nkind = "none"\n', False),
        (["--mount", "none"], '[mount]\nkind = "stand"\n', False),
    ],
)
def test_a_mount_is_printed(
    bad: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: list[str],
    in_scene: str,
    printing: bool,
) -> None:
    asked: list[pipeline.Request] = []

    def build(request: pipeline.Request, progress: object) -> None:
        asked.append(request)
        raise InputError("the test", "it has seen enough", "Go on")

    monkeypatch.setattr(pipeline, "build", build)
    if in_scene:
        scene = tmp_path / "scene.toml"
        scene.write_text(in_scene)
        options = [*options, "--scene", str(scene)]
    call = ["build", bad / "good.png", "--tube-radius", "9", "--out", tmp_path / "out"]
    refuse(2, *call, *options)
    assert [request.printing for request in asked] == [printing]


def test_the_default_folder_keeps_what_another_picture_came_to(
    bad: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def build(request: pipeline.Request, progress: object) -> None:
        raise InputError("the test", "it has seen enough", "Go on")

    monkeypatch.setattr(pipeline, "build", build)
    monkeypatch.chdir(tmp_path)
    out = Path("knotfab-out") / "good"
    out.mkdir(parents=True)
    (out / "report.json").write_text("{}")
    (out / "picture-front.png").write_bytes(b"another")
    assert "built from another picture" in refuse(2, "build", bad / "good.png")
    for more in (["--force"], ["--out", str(out)]):
        assert "seen enough" in refuse(2, "build", bad / "good.png", *more)
    (out / "picture-front.png").write_bytes((bad / "good.png").read_bytes())
    assert "seen enough" in refuse(2, "build", bad / "good.png")


def test_a_font_is_for_text(bad: Path, tmp_path: Path) -> None:
    call = ("build", "text:R", "--out", tmp_path / "out", "--font")
    assert "no font of that name" in refuse(2, *call, "No Such Family At All")
    assert "no font file" in refuse(2, *call, bad / "words.png")


def test_no_picture_and_two_pictures(bad: Path, tmp_path: Path) -> None:
    assert "no picture" in refuse(2, "build", "--out", tmp_path / "out")
    good = bad / "good.png"
    call = ("build", good, good, "--out", tmp_path / "out", "--depth", "flat")
    assert "several views" in refuse(2, *call)


def test_a_scene_that_is_given_as_a_picture_is_told_from_one(bad: Path, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text("[[views]]\n")
    assert f"--scene {scene}" in refuse(2, "build", scene, "--out", tmp_path / "out")


@pytest.mark.parametrize("option", ["--seed", "--specks", "--keep-largest"])
def test_a_count_is_a_whole_number(bad: Path, tmp_path: Path, option: str) -> None:
    for value in ("1.5", "many"):
        call = ("build", bad / "good.png", "--out", tmp_path / "out", option, value)
        said = refuse(2, *call)
        assert f"{option} {value}: it is no whole number" in said


def test_a_tube_thinner_than_the_printer_prints(bad: Path, tmp_path: Path) -> None:
    call = ["build", bad / "good.png", "--out", tmp_path / "out", "--tube-radius", "0.1"]
    assert "at least 0.8 mm" in refuse(1, *call)


@pytest.mark.slow
def test_a_device_that_is_not_there(bad: Path, tmp_path: Path) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has a CUDA device")
    call = ["build", bad / "good.png", "--out", tmp_path / "out", "--device", "cuda"]
    assert "no CUDA device" in refuse(3, *call)


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/nope"])
def test_an_output_folder_that_cannot_be_written(bad: Path, tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("in the way")
    said = refuse(2, "build", bad / "good.png", "--out", tmp_path / place)
    assert "--out" in said and str(tmp_path / place) in said
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of 64 KiB without a free byte, and one file of its own."""
    with small_disk(tmp_path / "disk", "64k") as disk:
        (disk / "mine").write_bytes(b"x" * 65536)
        yield disk


def test_a_full_disk_is_noticed_before_the_work(bad: Path, full_disk: Path) -> None:
    said = refuse(3, "build", bad / "good.png", "--out", full_disk)
    assert "the disk is full" in said and "Free some space" in said
    assert [p.name for p in full_disk.iterdir()] == ["mine"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("call", "code", "why"),
    [
        (["validate"], 2, "nothing to validate"),
        (["validate", "missing"], 2, "no such file"),
        (["validate", "folder"], 2, "no part.stl"),
        (["validate", "words.png"], 2, "words.png"),
        (["validate", "--knots", "words.png"], 2, "is not JSON"),
        (["validate", "--knots", "words.png", "--skip", "all"], 2, "no such check"),
        (["shadow", "words.stl", "--scene", "empty.toml", "--out", "x.png"], 2, "words.stl"),
        (["shadow", "missing.stl", "--scene", "empty.toml", "--out", "x.png"], 2, "missing.stl"),
        (["shadow", "words.stl", "--scene", "empty.toml", "--out", "x.jpg"], 2, "PNG"),
        (["shadow"], 2, "requires an argument"),
        (["nonsense"], 2, "Unknown command"),
    ],
)
def test_wrong_calls_of_the_others(
    bad: Path, monkeypatch: pytest.MonkeyPatch, call: list[str], code: int, why: str
) -> None:
    (bad / "words.stl").write_text("I am no part.\n")
    (bad / "empty.toml").write_text("schema = 1\n")
    monkeypatch.chdir(bad)
    before = sorted(bad.iterdir())
    assert why in refuse(code, *call)
    assert sorted(bad.iterdir()) == before


def test_help() -> None:
    done = knotfab("--help")
    assert (done.code, done.err) == (0, "")
    for word in ("Exit codes", "0 ", "1 ", "2 ", "3 ", "130", "build", "validate", "shadow"):
        assert word in done.out
    done = knotfab("build", "--help")
    assert done.code == 0
    for field in fields(BuildOptions):
        assert f"--{field.name.strip('_').replace('_', '-')} " in done.out
    groups = [done.out.index(f"─ {name} ─") for name in ("Picture", "Piece", "Print", "Search")]
    assert groups == sorted(groups)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["batch", "build", "compare", "preview", "shadow", "studio", "tradeoff", "validate"]
)
def test_the_examples_of_the_help_are_calls(name: str) -> None:
    examples = app[name].help_epilogue
    lines = [line for line in examples.splitlines() if line.startswith("knotfab ")]
    assert lines and lines[0].split("   ")[0] in knotfab(name, "--help").out
    for line in lines:
        words = shlex.split(line.split("   ")[0])
        command, bound, _ = app.parse_args(words[1:], exit_on_error=False, print_error=False)
        assert command.__name__ == name
        assert bound.args or name == "studio" or "--scene" in words or "--sequence" in words


def test_version() -> None:
    done = knotfab("--version")
    assert (done.code, done.out.strip(), done.err) == (0, package.__version__, "")


@pytest.mark.parametrize(("status", "code"), [("ok", 0), ("warning", 0), ("missing", 3)])
def test_the_doctor_ends_with_3_where_something_is_missing(
    monkeypatch: pytest.MonkeyPatch, status: str, code: int
) -> None:
    monkeypatch.setattr(doctor, "examine", lambda: [Finding("torch", status, "2.13", "pip")])
    done = knotfab("doctor")
    assert (done.code, done.err) == (code, "") and "torch" in done.out
    assert (code == 3) == ("missing " in done.out)


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
        (RecursionError(), 2, "nested too deep"),
        (MemoryError(), 3, "this machine has no more"),
        (RuntimeError("can't start new thread"), 3, "this machine has no more"),
        (ImportError("no symbol", name="torch"), 3, "the library torch: it cannot be loaded"),
        (ImportError("failed to map segment", name="torch"), 3, "this machine has no more"),
        (UnicodeEncodeError("ascii", "ö", 0, 1, "no"), 3, "UnicodeEncodeError"),
        (OSError(errno.EROFS, "Read-only file system", "a.png"), 3, "a.png: it fails (Read-only"),
        (OSError(errno.EFBIG, "File too large", "a.png"), 3, "(File too large)"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "a" * 4000), 2, "(File name too long)"),
        (
            PermissionError(errno.EACCES, "Permission denied", b"\xe9"),
            2,
            "\\xe9: it cannot be used",
        ),
        (OSError("odd"), 3, "the system: it fails (odd)"),
    ],
)
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
