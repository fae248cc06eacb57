"""What each way to print costs: the front, ways that fail, and refusals."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from knotfab.apps.tradeoff import prints
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.progress import Progress
from knotfab.cli.app import main

QUIET = Progress("quiet")


def _report(hours: float, iou: float, way: str = "none", status: str = "pass") -> dict[str, Any]:
    return {
        "status": status,
        "checks": [{"name": "gap", "required": True, "status": status}],
        "views": [{"iou": 1.0}, {"iou": iou}],
        "settings": {"tube_radius_mm": 2.0},
        "timings": {"total": 3.0},
        "print": {
            "time_s": 3600 * hours,
            "filament_g": 10 * hours,
            "support_g": 1.0,
            "supports": {"way": way},
            "pose": {"height_mm": 80.0},
        },
    }


def _answer(options: prints.Options, way: str = "none") -> dict[str, Any]:
    if options.get("plate") == "full":
        raise SceneError("plate", "the bed is too small", "Take a larger one")
    if options.get("plate") == "pegs":
        return _report(1.0, 0.9999, way, "fail")
    if "depth" in options:
        return _report(float(options["depth"]) / 20, 0.99, way)
    if options.get("accuracy") == "fine":
        return _report(6.0, 0.999, way)
    return _report(5.0, 0.98 if options.get("accuracy") == "draft" else 0.995, way)


@pytest.mark.parametrize("way, depths", [("none", ["depth 60 mm", "depth 104 mm"]), ("slicer", [])])
def test_the_front_has_what_nothing_beats(
    way: str, depths: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[prints.Options] = []
    shown: list[list[prints.Way]] = []

    def draw(ways: list[prints.Way]) -> bytes:
        """What there is to draw after each way, drawn once at the end."""
        shown.append([*ways])
        return b""

    drawn = prints.draw_prints
    monkeypatch.setattr(prints, "draw_prints", draw)

    def answer(picture: str, folder: Path, options: prints.Options) -> dict[str, Any]:
        asked.append(options)
        return _answer(options, way)

    given = {"accuracy": "standard"}
    ways = prints.weigh_prints(["a.png", "b.png"], tmp_path, given, QUIET, builder=answer)
    by_name = {one.label: one for one in ways}
    assert [name for name in by_name if name.startswith("depth")] == depths
    assert {"tube 3.0 mm thick", "tube 5.2 mm thick"} <= by_name.keys()
    assert {"fine", "draft", "standard"} == {options["accuracy"] for options in asked}
    failed = {one.label: one.failed for one in ways if one.failed}
    assert failed.keys() == {"full plate", "pegs on a plate"}
    assert "the bed is too small" in failed["full plate"]
    assert "gap" in failed["pegs on a plate"]
    front = prints.front_of(ways)
    assert front and all(a.hours < b.hours and a.iou < b.iou for a, b in pairwise(front))
    for one in ways:
        if not one.failed:
            assert any(best.hours <= one.hours and best.iou >= one.iou for best in front)
    assert not any(one.failed for one in front)
    rows = json.loads((tmp_path / "tradeoff-prints.json").read_text("utf-8"))["ways"]
    assert [row["label"] for row in rows if row["front"]] == [o.label for o in ways if o in front]
    assert shown == [ways[: k + 1] for k in range(len(ways))]
    assert (tmp_path / "tradeoff-prints.png").read_bytes() == b""
    assert way != "none" or drawn(ways).startswith(b"\x89PNG")


def test_ways_that_there_is_no_time_for_are_not_begun(tmp_path: Path) -> None:
    def answer(picture: str, folder: Path, options: prints.Options) -> dict[str, Any]:
        raise AssertionError

    assert prints.weigh_prints(["a.png"], tmp_path, {}, QUIET, limit_s=0.0, builder=answer) == []


def test_without_a_slicer_there_are_no_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prints, "find_slicer", lambda: None)
    with pytest.raises(MachineError, match="PrusaSlicer"):
        prints.weigh_prints(["a.png"], tmp_path, {}, QUIET)


@pytest.mark.parametrize("words", [["--jobs", "2"], ["--repeats", "2"]])
def test_what_has_no_part_in_builds_is_refused(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["tradeoff", "text:♥", "--print", "--out", str(tmp_path / "out"), *words])
    assert left.value.code == 2
    assert "--print" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
