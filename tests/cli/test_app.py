"""The command line: every wrong call is one sentence and an exit code, and nothing is left behind."""

import shlex
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from command import knotfab, picture, refuse, small_disk, square
from PIL import Image

import knotfab as package
from knotfab.apps import doctor
from knotfab.apps.doctor import Finding
from knotfab.cli.commands import app
from knotfab.pipeline import build as pipeline
from knotfab.pipeline.options import OFTEN, BuildOptions, PlanOptions
from knotfab.pipeline.values import read_seconds
from knotfab_formats.errors import InputError

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="64" height="64">{}</svg>'
BAD_PICTURES = {
    "missing.png": "there is no such file", "folder": "it is a directory",
    "words.png": "it is not a picture", "outside.svg": "refers to something outside the file",
    "speck.png": "too little to be drawn", "checker.png": "none of these is its background",
}  # fmt: skip
BAD_SCENES = {
    "[piece]\ntube_radius = 3\n": "Did you mean 'tube_radius_mm'",
    '[piece]\ntube_radius_mm = "3 inch"\n': "in millimetres, without unit",
    "[piece]\nclearance_mm = -1\n": "must be a number not less than 0",
    "[piece]\ntube_radius_mm = nan\n": "must be a finite number", "[piece\n": "not valid TOML",
    "[search]\niterations = 10\n": "there is no such setting", "schema = 2\n": "must be 1",
    "\n".join(f'[[views]]\nname = "v{k}"\nazimuth_deg = {13 * k}' for k in range(13)): "has 13 views",
}  # fmt: skip
BAD_CALLS = [
    (["--bogus"], "Unknown option"), (["--accuracy", "superb"], "Choose from"),
    (["--time-budget", "abc"], "not a positive time. Give seconds"),
    (["--time-budget", "-3"], "not a positive time"), (["--font", "DejaVu Serif"], "no picture is one"),
    (["--printer", "nonsense"], "no such printer"), (["--tube-radius", "0"], "Give millimetres"),
    (["--tube-radius", "thick"], "it is no length. Give millimetres"),
    (["--tube-radius", "-2"], "not above 0. Give millimetres"),
    (["--size", "18 parsecs"], "no unit parsecs. Use mm, cm, m or in."),
    (["--acc", "draft"], "Did you mean --accept or --accuracy?"),
    (["--depth", "9999"], "towards the light"), (["--knots", "0"], "neither auto nor a number"),
    (["--seed", "-1"], "it is below 0. Give a number from 0"),
    (["--seed", "abc"], "no whole number. Give one such as 3."),
    (["--skip", "everything"], "Known: shadow-render"), (["--mount", "rope"], "Choose from"),
    (["--material", "steel-wire-2mm"], "Print the piece"), (["--bender", "grbl"], "Print the piece"),
    (["--out"], "requires an argument"), (["--out", ""], "names no place"),
]  # fmt: skip


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
    said = refuse(2, "preview", "cat.png", "--colours")
    assert "--colours is an option of knotfab build" in said


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

    def build(request: pipeline.Request, *_: object) -> None:
        asked.append(request)
        raise InputError("the test", "it has seen enough", "Go on")

    monkeypatch.setattr(pipeline, "run_build", build)
    if in_scene:
        scene = tmp_path / "scene.toml"
        scene.write_text(in_scene)
        options = [*options, "--scene", str(scene)]
    call = ["build", bad / "good.png", "--tube-radius", "9", "--out", tmp_path / "out"]
    refuse(2, *call, *options)
    assert [request.printing for request in asked] == [printing]


@pytest.mark.slow
def test_the_default_folder_keeps_what_another_picture_came_to(
    bad: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def build(request: pipeline.Request, *_: object) -> None:
        raise InputError("the test", "it has seen enough", "Go on")

    monkeypatch.setattr(pipeline, "run_build", build)
    monkeypatch.chdir(tmp_path)
    out = Path("knotfab-out") / "good"
    out.mkdir(parents=True)
    (out / "report.json").write_text("{}")
    (out / "picture-front.png").write_bytes(b"another")
    assert "built from another picture" in refuse(2, "build", bad / "good.png")
    for more in (["--force"], ["--out", str(out)]):
        assert "seen enough" in refuse(2, "build", bad / "good.png", *more)
    (out / "given-front.png").write_bytes((bad / "good.png").read_bytes())
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
    assert "at least --tube-radius 0.8" in refuse(1, *call)


@pytest.mark.slow
def test_a_device_for_the_flow_or_that_is_not_there(bad: Path, tmp_path: Path) -> None:
    import torch

    call = ["build", bad / "good.png", "--out", tmp_path / "out", "--device", "cuda"]
    assert "only the paper's network runs there" in refuse(2, *call)
    assert not (tmp_path / "out").exists()
    if not torch.cuda.is_available():
        assert "no CUDA device" in refuse(3, *call, "--search", "inn")


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/nope"])
@pytest.mark.slow
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
        (["validate"], 2, "nothing to validate"), (["validate", "missing"], 2, "no such file"),
        (["validate", "folder"], 2, "no part.stl"), (["validate", "words.png"], 2, "words.png"),
        (["validate", "--knots", "words.png"], 2, "is not JSON"),
        (["validate", "--knots", "words.png", "--skip", "all"], 2, "no such check"),
        (["shadow", "words.stl", "--scene", "empty.toml", "--out", "x.png"], 2, "words.stl"),
        (["shadow", "missing.stl", "--scene", "empty.toml", "--out", "x.png"], 2, "missing.stl"),
        (["shadow", "words.stl", "--scene", "empty.toml", "--out", "x.jpg"], 2, "PNG"),
        (["shadow"], 2, "requires an argument"), (["nonsense"], 2, "Unknown command"),
    ],
)  # fmt: skip
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
    every = {f"--{field.name.strip('_').replace('_', '-')}" for field in fields(BuildOptions)}
    for call, names in (("--help", OFTEN), ("--help-all", every)):
        done = knotfab("build", call)
        assert done.code == 0
        assert {name for name in every if f"│ {name} " in done.out} == names
        plan = {f"--{f.name.strip('_').replace('_', '-')}" for f in fields(PlanOptions)}
        previewed = knotfab("preview", call).out
        assert {name for name in every if f"│ {name} " in previewed} - {"--out"} == names & plan
        groups = [done.out.index(f"─ {name} ─") for name in ("Picture", "Piece", "Print", "Search")]
        assert groups == sorted(groups)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["batch", "build", "compare", "preview", "shadow", "studio", "tradeoff", "validate"]
)
def test_the_examples_of_the_help_are_calls(name: str) -> None:
    examples = app[name].help_epilogue
    lines = [line for line in examples.splitlines() if line.startswith("knotfab ")]
    assert (
        lines and lines[0 if name != "build" else 1].split("   ")[0] in knotfab(name, "--help").out
    )
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
