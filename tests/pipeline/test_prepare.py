"""A call that may begin: where it will be built, and what its pieces are called."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import picture

from knotfab.base.progress import Progress
from knotfab.pipeline.options import ALL_OUT, options_from
from knotfab.pipeline.prepare import prepare_build
from knotfab.request import Request
from knotfab.scene.load import dump_scene
from knotfab_formats.errors import InputError


def prepare(*pictures: str | Path, **options: Any) -> Request:
    given = options_from({"accuracy": "sketch", "tube_radius": 5, **options})
    return prepare_build([str(p) for p in pictures], given, "", Progress("quiet"))


@pytest.fixture
def square(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that one works in, with a square in cat.png and in walk/1.png and walk/2.png."""
    (tmp_path / "walk").mkdir()
    monkeypatch.chdir(tmp_path)
    block = np.pad(np.ones((60, 60), dtype=bool), 20)
    picture(tmp_path / "walk" / "1.png", block)
    picture(tmp_path / "walk" / "2.png", np.roll(block, 5, axis=1))
    return picture(tmp_path / "cat.png", block)


@pytest.mark.slow
def test_the_default_folder_is_named_after_the_picture(square: Path) -> None:
    assert prepare(square).out == ALL_OUT / "cat"
    assert prepare(square, "text:A").out == ALL_OUT / "cat-A"
    assert prepare(square, square, size=120).out == ALL_OUT / "cat"
    for frames in ("walk/", "walk", "walk/*.png"):
        assert prepare(frames, sequence=True).out == ALL_OUT / "walk"
    assert prepare(square, out="here").out == Path("here")


def test_more_knots_than_pieces_are_no_silent_wish(square: Path) -> None:
    (said,) = prepare(square, knots=3).preview[-1:]
    assert said.startswith("--knots 3: the picture is one piece, and becomes one knot.")
    assert "--knots" not in prepare(square, knots=1).preview[-1]


def test_what_is_not_there_is_told_with_what_would_be_right(square: Path, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('[[views]]\npicture = "dog.png"\n')
    for given, remedy in (
        ({"pictures": ["nope.png"]}, "or write text:…"),
        ({"pictures": ["https://example.org/cat.png"]}, "Download the picture"),
        ({"scene": tmp_path / "scene.toml"}, "Lay it beside the scene"),
    ):
        with pytest.raises(InputError, match=remedy):
            prepare(*given.pop("pictures", []), **given)
    with pytest.raises(InputError) as told:
        prepare()
    assert str(told.value).startswith("no picture is given. Name one")


def test_gcode_is_kept_only_where_something_is_sliced(square: Path) -> None:
    for given, remedy in (
        ({}, "Add --print"),
        ({"print": True, "skip": "slicer"}, "Leave out --skip"),
    ):
        options = options_from({**given, "also": "gcode"})
        with pytest.raises(InputError, match=f"--also gcode: nothing is sliced.*{remedy}"):
            prepare_build([str(square)], options, "", Progress("quiet"))


@pytest.mark.slow
def test_a_scene_that_a_build_wrote_keeps_the_piece_its_name(square: Path, tmp_path: Path) -> None:
    written = tmp_path / "written"
    written.mkdir()
    (written / "picture-front.png").write_bytes(square.read_bytes())
    scene = prepare(square).scene
    view = scene.views[0].model_copy(update={"picture": "picture-front.png", "title": "My cat"})
    (written / "scene.toml").write_text(dump_scene(scene.model_copy(update={"views": (view,)})))
    again = prepare(scene=written / "scene.toml")
    assert [t.name for t in again.targets] == ["My-cat"] and again.out == ALL_OUT / "My-cat"
    assert [t.shown for t in again.targets] == ["My cat"]
    other = prepare("text:A", scene=written / "scene.toml")  # another picture has its own
    assert other.out == ALL_OUT / "A"
