"""Moves that came with a folder, which a stranger wrote, are not done; those of a killed build are."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from command import killed_build, knotfab, picture, square

from knotfab.base.folder import OutputFolder
from knotfab.base.moves import _kept_secret, _sign, mend
from tests.base.test_folder import build, listing

STEPS: dict[str, Callable[[Path], list[object]]] = {
    "absolute": lambda aside: [["new/evil", str(aside / "victim")]],
    "absolute, from anywhere": lambda aside: [[str(aside / "victim"), "part.stl"]],
    "upwards": lambda aside: [["new/evil", "../aside/victim"]],
    "upwards, from the hidden folder": lambda aside: [["../../aside/victim", "part.stl"]],
    "by a link": lambda aside: [["new/evil", "link/victim"]],
    "nested": lambda aside: [["new/evil", "deep/mine"]],
    "the other way round": lambda aside: [["new/evil", "deep\\mine"]],
    "another's file": lambda aside: [["evil", "mine"]],
    "removed": lambda aside: [[None, "mine"]],
    "a device": lambda aside: [["new/evil", "CON"], ["new/evil", "nul.txt"]],
    "a stream": lambda aside: [["new/evil", "mine:evil"]],
    "a null character": lambda aside: [["new/evil", "mine\0"]],
    "nothing": lambda aside: [["new/evil", ""], ["new/evil", "."], ["new/evil", ".."]],
    "no steps": lambda aside: [["new/evil"], 3, None, {"new/evil": "mine"}],
    "plain": lambda aside: [["new/mine", "mine"]],
}


def strangers_folder(place: Path, steps: list[object], wrap: Callable[[str], object]) -> Path:
    """A folder of somebody else, with moves in it, beside a file of the user."""
    for folder in (
        "aside",
        "from afar/deep",
        "from afar/.knotfab-x/new",
        "from afar/.knotfab-x/old",
    ):
        (place / folder).mkdir(parents=True)
    (place / "aside" / "victim").write_text("user")
    folder = place / "from afar"
    (folder / "link").symlink_to(place / "aside")
    for name in ("mine", "deep/mine", "report.json"):
        (folder / name).write_text("user")
    for name in ("evil", "new/evil", "new/mine", "old/victim", "old/mine"):
        (folder / ".knotfab-x" / name).write_text("evil")
    for name in ("moves.json", "undo.json"):
        (folder / ".knotfab-x" / name).write_text(json.dumps(wrap(json.dumps(steps))))
    return folder


@pytest.mark.parametrize("kind", STEPS)
def test_moves_that_a_stranger_wrote_do_nothing(tmp_path: Path, kind: str) -> None:
    """They come as once written, under made-up seals, and under one of this user for another folder."""
    ours = killed_build(tmp_path / "ours", note="new")
    seal, signed = (ours / "seal").read_text(), json.loads((ours / "moves.json").read_text())
    wraps: list[tuple[str | None, Callable[[str], object]]] = [
        (None, json.loads),
        ("", lambda text: ["", text]),
        ("0" * 64, lambda text: ["0" * 64, text]),
        (seal, lambda text: [signed[0], text]),
        (seal, lambda _: signed),
    ]
    for number, (mark, wrap) in enumerate(wraps):
        place = tmp_path / f"{number}"
        folder = strangers_folder(place, STEPS[kind](place / "aside"), wrap)
        if mark is not None:
            (folder / ".knotfab-x" / "seal").write_text(mark)
        before = listing(place)
        mend(folder)
        assert listing(place) == before
        with OutputFolder(folder) as out:
            out.write("mine", "new")
            out.commit()
        assert listing(place) == before | {"from afar/mine": b"new"}


@pytest.mark.parametrize("kind", STEPS)
def test_moves_under_a_true_seal_stay_in_their_folder(tmp_path: Path, kind: str) -> None:
    place = tmp_path / "place"
    folder = strangers_folder(place, STEPS[kind](place / "aside"), json.loads)
    hidden = folder / ".knotfab-x"
    text = (hidden / "moves.json").read_text()
    (hidden / "seal").write_text(_sign(hidden, ""))
    (hidden / "moves.json").write_text(json.dumps([_sign(hidden, text), text]))
    mend(folder)
    found = listing(place)
    assert found["aside/victim"] == b"user" == found["from afar/deep/mine"]
    own = {"plain": b"evil", "removed": None}  # such moves a build may write down
    assert found.get("from afar/mine") == own.get(kind, b"user")
    assert not any(name.casefold().startswith(("from afar/con", "from afar/nul")) for name in found)


@pytest.mark.parametrize("link", [".knotfab-x", "new", "old", "seal"])
def test_links_in_place_of_a_hidden_folder_are_not_followed(tmp_path: Path, link: str) -> None:
    hidden = killed_build(tmp_path / "out", part__stl="new")
    (tmp_path / "out" / "part.stl").write_text("old")
    at = hidden if link == ".knotfab-x" else hidden / link
    at.rename(tmp_path / "elsewhere")
    at.symlink_to(tmp_path / "elsewhere")
    before = listing(tmp_path)
    mend(tmp_path / "out")
    assert listing(tmp_path) == before


def test_moves_of_a_user_without_a_place_for_the_secret_are_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("KNOTFAB_STATE", str(tmp_path / "file" / "deeper"))
    build(tmp_path / "out", note="new")
    assert listing(tmp_path / "out") == {"note": b"new"}
    killed_build(tmp_path / "out", note="newer")
    monkeypatch.setattr("knotfab.base.moves._PASSING", b"of the next process")
    _kept_secret.cache_clear()
    before = listing(tmp_path)
    mend(tmp_path / "out")
    assert listing(tmp_path) == before
    _kept_secret.cache_clear()


def test_no_command_does_moves_that_a_stranger_wrote(tmp_path: Path) -> None:
    folder = strangers_folder(tmp_path, STEPS["absolute"](tmp_path / "aside"), json.loads)
    picture(folder / "cat.png", square(8))
    before = listing(tmp_path)
    cat, scene = folder / "cat.png", folder / "scene.toml"
    for call in (
        ("printers", folder), ("preview", cat), ("preview", folder), ("validate", folder),
        ("validate", f"--scene={scene}"), ("shadow", folder / "part.stl", "--scene", scene),
        ("compare", cat, folder), ("build", cat, "--wrong"), ("build", "--scene", scene),
        ("batch", folder, "--wrong"), ("tradeoff", cat, "--wrong"), ("studio", "--out", folder, "--wrong"),
    ):  # fmt: skip
        knotfab(*call)
        assert listing(tmp_path) == before, call
