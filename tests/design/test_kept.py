"""Frames that are done are kept: the same parts as without an interruption, and never of another sequence."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from quick_sequences import QUICK, discs, in_order

from knotfab.design import kept
from knotfab.design.film import Chain
from knotfab.design.kept import KeptFrames, keep_for
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Piece, Sequence
from knotfab_formats.scene import Scene

SCENE = Scene(piece=Piece(tube_radius_mm=12.0), search=QUICK)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KNOTFAB_CACHE", str(tmp_path / "cache"))


@pytest.mark.slow
def test_an_interrupted_sequence_goes_on_to_the_same_knots(tmp_path: Path) -> None:
    targets = discs(tmp_path, (40, 36, 33))
    place = KeptFrames(tmp_path / "kept")
    begun = Chain(resolve(SCENE), targets, kept=place).frames()
    first, second = next(begun), next(begun)
    begun.close()  # here the machine is switched off
    assert len(place) == 2
    again = Chain(resolve(SCENE), targets, kept=place)
    resumed = in_order(again)
    assert again.resumed == 2
    whole = in_order(Chain(resolve(SCENE), targets))
    for one, other in zip(resumed, whole, strict=True):
        assert one.made.knots.points.tobytes() == other.made.knots.points.tobytes()
        assert one.made.scene == other.made.scene
        assert one.made.result.log == other.made.result.log
    assert np.array_equal(resumed[1].made.knots.points, second.made.knots.points)
    assert first.number == 0
    place.discard()
    assert place.load(0) is None and not place.folder.exists()


def _request(tmp_path: Path) -> Request:
    targets = discs(tmp_path, (40, 36))
    return Request(resolve(SCENE), ("a", "b"), tmp_path / "out", targets=targets)


def kept_of(asked: Request) -> KeptFrames:
    return keep_for(asked.scene, asked.targets, asked.device, asked.time_budget_s)


@pytest.mark.parametrize(
    "change",
    [
        lambda r: replace(r, scene=r.scene.model_copy(update={"sequence": Sequence(loop=False)})),
        lambda r: replace(r, device="cuda"),
        lambda r: replace(r, time_budget_s=9.0),
        lambda r: replace(r, scene=r.scene.model_copy(update={"piece": Piece()})),
        lambda r: replace(r, targets=r.targets[::-1]),
        lambda r: replace(
            r, targets=(r.targets[0], replace(r.targets[1], mask=~r.targets[1].mask))
        ),
        lambda r: replace(r, targets=tuple(replace(t, suffix=".bmp") for t in r.targets)),
    ],
    ids=["loop", "device", "budget", "scene", "order", "picture", "file"],
)
def test_what_decides_about_the_frames_decides_what_is_found(
    tmp_path: Path, change: Callable[[Request], Request]
) -> None:
    asked = _request(tmp_path)
    here = kept_of(asked)
    here.store(1, "a frame")
    assert kept_of(asked).load(1) == "a frame"
    # where it is written, and what is checked, decide nothing
    elsewhere = replace(asked, out=tmp_path / "other", skip=frozenset({"shadow"}))
    assert kept_of(elsewhere).load(1) == "a frame"
    other = change(asked)
    assert kept_of(other).load(1) is None


def test_another_version_finds_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = _request(tmp_path)
    kept_of(asked).store(0, "a frame")
    monkeypatch.setattr(kept, "_digest_program", lambda: b"a newer one")
    assert kept_of(asked).load(0) is None


def test_damaged_files_and_locked_folders_keep_nothing(tmp_path: Path) -> None:
    place = KeptFrames(tmp_path / "kept")
    place.store(0, list(range(999)))
    file = next(place.folder.iterdir())
    file.write_bytes(file.read_bytes()[:100])
    assert place.load(0) is None
    (tmp_path / "file").write_text("")
    nowhere = KeptFrames(tmp_path / "file" / "kept")
    nowhere.store(0, "a frame")
    assert nowhere.load(0) is None


def test_what_cannot_be_kept_is_no_error(tmp_path: Path) -> None:
    place = KeptFrames(tmp_path / "kept")
    for number, value in enumerate((lambda: 0, threading.Lock())):
        place.store(number, value)
    assert len(place) == 0


def test_what_nobody_asked_for_again_is_removed(tmp_path: Path) -> None:
    asked = _request(tmp_path)
    here = kept_of(asked)
    here.store(0, "a frame")
    then = time.time() - 86400 * 31
    os.utime(here.folder, (then, then))
    assert kept_of(asked).load(0) is None
    assert not here.folder.exists()
