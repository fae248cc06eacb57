"""What the refusals of `validate`, `preview` and `batch` suggest, typed and tried."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from command import knotfab, picture, refuse, square
from played_runs import draw, write_player

from knotfab_formats.verdict import KNOTS, MESH

pytestmark = pytest.mark.slow  # a piece is built, and verified again and again


# a call is one that does, whatever it measures
UNREAD = [f"--skip={name}" for name in (*KNOTS, *MESH, "tube", "clearance")]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a picture, its piece in `piece`, and in `film` the piece as a frame of a sequence."""
    folder = tmp_path_factory.mktemp("calls")
    picture(folder / "square.png", square())
    call = "build", folder / "square.png", "--accuracy", "sketch", "--tube-radius", "6", *UNREAD
    done = knotfab(*call, "--out", folder / "piece")
    assert done.code == 0, done.err
    (folder / "film").mkdir()
    for name in ("part.stl", "knots.json", "scene.toml"):
        stem, suffix = name.split(".")
        shutil.copy(folder / "piece" / name, folder / "film" / f"{stem}-01.{suffix}")
    for name in ("picture", "shadow"):
        (shot,) = (folder / "piece").glob(f"{name}-*.png")
        shutil.copy(shot, folder / "film")
    return folder


# a call, what its refusal says, and the call that follows from it: whole, or as words to replace
CALLS = {
    "validate film": (r"(knotfab validate .*?)\.?$", None),
    "validate piece --failures piece.jpg": ("Name a file in .png", ("piece.jpg", "piece.png")),
    "validate piece --skip everything": ("Known: .*shadow-render", ("everything", "shadow-render")),
    "preview piece/scene.toml": ("by its name: --scene piece/", ("piece/", "--scene piece/")),
    "compare square.png piece": (
        "name them: --corners x,y x,y x,y x,y",
        ("piece", "piece --corners 0,0 64,0 64,64 0,64"),
    ),
    "preview square.png --out square.jpg": ("Name a file in .png", ("square.jpg", "square-1.png")),
}


@pytest.mark.parametrize("call", CALLS)
def test_what_a_refusal_suggests_does(
    call: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    said, mend = CALLS[call]
    error = refuse(2, *shlex.split(call))
    found = re.search(said, error.strip())
    assert found is not None, error
    again = found[1].removeprefix("knotfab ") if mend is None else call.replace(*mend)
    done = knotfab(*shlex.split(again), *(UNREAD if "validate" in again else ()))
    assert done.code == 0, done


def test_what_a_batch_s_refusals_suggest_does(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures = draw(tmp_path / "pictures", a="pass", b="pass")
    script, _ = write_player(tmp_path)
    monkeypatch.setattr("sys.executable", str(script))
    out = tmp_path / "one"
    call = ["batch", str(pictures), "--out", str(out)]
    assert "Give 1 or more" in refuse(2, *call, "--jobs", "0")
    shutil.copytree(place / "piece", out)
    assert "add --force" in refuse(2, *call, "--jobs", "1")
    assert knotfab(*call, "--jobs", "1", "--force").code == 0
    assert (out / "a").is_dir() and (out / "b").is_dir()
