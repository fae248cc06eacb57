"""`knotfab build --sequence`: what it refuses, and that a new result leaves nothing of an older one."""

from pathlib import Path

import numpy as np
import pytest
from command import knotfab, picture, refuse, square

from knotfab.files.folder import OutputFolder

CALL = ("build", "--sequence")
TWO_VIEWS = "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nazimuth_deg = 90.0\n"


def _frames(folder: Path, count: int = 2, size: int = 64) -> Path:
    """A folder of squares, each a pixel further to the right."""
    folder.mkdir()
    for number in range(1, count + 1):
        picture(folder / f"{number}.png", np.roll(square(size), number, axis=1))
    return folder


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--knots", "2"], "frame 1 has another number of pieces (1)"),
        (["--depth", "9999"], "towards the light"),
    ],
)
def test_what_makes_no_sense_with_a_sequence(tmp_path: Path, options: list[str], why: str) -> None:
    frames = _frames(tmp_path / "frames")
    assert why in refuse(2, *CALL, frames, "--out", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


def test_one_piece_has_no_loop_to_leave_open(tmp_path: Path) -> None:
    drawn = picture(tmp_path / "square.png", square())
    done = knotfab("build", drawn, "--no-loop", "--out", tmp_path / "out")
    assert done.code == 2 and "--no-loop" in done.err and "--sequence" in done.err
    assert not (tmp_path / "out").exists()


def test_a_scene_of_two_views_is_no_sequence(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TWO_VIEWS)
    frames = _frames(tmp_path / "frames")
    said = refuse(2, *CALL, frames, "--scene", scene, "--out", tmp_path / "out")
    assert "2 views" in said


def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has a CUDA device")
    frames = _frames(tmp_path / "frames")
    said = refuse(3, *CALL, frames, "--out", tmp_path / "out", "--device", "cuda")
    assert "no CUDA device" in said


def test_a_shorter_sequence_leaves_no_frames_of_the_one_before(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    old = ["part-01.stl", "part-02.3mf", "knots-02.json", "scene-02.toml", "zoetrope.stl"]
    old += ["plate-02-1.3mf", "setup-02.pdf", "bends-02.csv", "bends-02-1.csv"]
    old += ["bending-templates-a4-02.pdf", "drill-template-letter-02.pdf"]
    for name in [*old, "sequence.gif", "picture-frame-02.png", "report.json", "my-part-1.stl"]:
        (out / name).write_text("old")
    with OutputFolder(out) as folder:
        folder.write("part-01.stl", "new")
        folder.write("report.json", "new")
        folder.commit()
    assert {p.name for p in out.iterdir()} == {"part-01.stl", "report.json", "my-part-1.stl"}


def test_validate_names_the_frames_of_a_sequence(tmp_path: Path) -> None:
    (tmp_path / "part-01.stl").write_text("")
    done = knotfab("validate", tmp_path)
    assert done.code == 2
    assert "it holds a sequence" in done.err and "scene-01.toml" in done.err
