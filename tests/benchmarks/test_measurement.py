"""What the studies share: which report is read, what counts as a clear end, what a comparison shows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.measurement import (
    STOPPED,
    Built,
    Stopwatch,
    build_apart,
    build_warm,
    failed_checks,
    paint_comparison,
    read_question,
    read_report,
    save_pictures,
)
from examples.pictures import pictures

BUILT = Built(0, 1.0, 1.0, 1.0, None, "")


@pytest.mark.slow
def test_a_refused_picture_is_a_clear_end_without_a_report(tmp_path: Path) -> None:
    built = build_apart(tmp_path / "nowhere.png", tmp_path / "out")
    assert (built.code, built.report) == (2, None)
    assert built.clear and built.said.startswith("knotfab: ")
    assert built.wall_s > 0 and built.cpu_s > 0 and built.peak_mb > 1


@pytest.mark.slow
def test_a_build_in_this_process_gives_what_one_of_its_own_gives(tmp_path: Path) -> None:
    path = save_pictures(pictures(), tmp_path, ["heart"])["heart"]
    options = ["--accuracy=sketch", "--tube-radius=2"]
    apart = build_apart(path, tmp_path / "apart", *options, printing=False)
    warm = build_warm(path, tmp_path / "warm", accuracy="sketch", tube_radius="2")
    assert (apart.code, warm.code) == (0, 0)
    part = "part.stl"
    assert (tmp_path / "apart" / part).read_bytes() == (tmp_path / "warm" / part).read_bytes()
    refused = build_warm(tmp_path / "nowhere.png", tmp_path / "out")
    assert (refused.code, refused.report) == (2, None) and "nowhere.png" in refused.said


def test_a_build_past_its_limit_is_stopped(tmp_path: Path) -> None:
    built = build_apart(tmp_path / "nowhere.png", tmp_path / "out", limit_s=0.0)
    assert built.code == STOPPED and not built.clear


@pytest.mark.parametrize(
    ("code", "said", "clear"),
    [
        (0, "", True),
        (1, "fail: shadow", True),
        (1, "", False),
        (2, "Traceback (most recent call last):", False),
        (3, "this machine lacks something", False),
        (-9, "", False),
    ],
)
def test_how_a_build_may_end(code: int, said: str, clear: bool) -> None:
    assert replace(BUILT, code=code, said=said).clear is clear


def test_the_report_of_a_folder_or_of_what_was_rejected_in_it(tmp_path: Path) -> None:
    assert read_report(tmp_path) is None
    checks = [{"name": "shadow", "status": "fail"}, {"name": "tube", "status": "pass"}]
    (tmp_path / "rejected").mkdir()
    (tmp_path / "rejected" / "report.json").write_text(json.dumps({"checks": checks}))
    found = read_report(tmp_path)
    assert found is not None and failed_checks(found) == ["shadow"]
    (tmp_path / "report.json").write_text(json.dumps({"checks": []}))
    assert read_report(tmp_path) == {"checks": []}


def test_pictures_are_saved_by_name_and_become_questions(tmp_path: Path) -> None:
    ink = np.full((48, 64), 255, dtype=np.uint8)
    ink[12:36, 16:48] = 0
    drawn = {"two words": Image.fromarray(ink), "other": Image.fromarray(ink)}
    saved = save_pictures(drawn, tmp_path, ["two words"])
    assert saved == {"two words": tmp_path / "two-words.png"}
    assert [p.name for p in tmp_path.iterdir()] == ["two-words.png"]
    assert len(save_pictures(drawn, tmp_path)) == 2
    for picture in (saved["two words"], drawn["two words"]):
        (view,) = read_question(picture).problem.views
        assert view.mask.shape == (48, 64) and view.mask.sum() == 24 * 32
        assert view.view.frame_mm == (180.0, 135.0)


def test_a_comparison_tells_spill_from_what_is_missing() -> None:
    seen = np.array([[True, True], [False, False]])
    wanted = np.array([[True, False], [True, False]])
    (both, spilt), (missing, nothing) = paint_comparison(seen, wanted).astype(int)
    assert both.max() < 64 and nothing.min() == 255
    assert spilt.argmax() == 0 and missing.argmax() == 2


def test_a_stopwatch_counts_from_its_own_start() -> None:
    first = Stopwatch()
    sum(k * k for k in range(100_000))
    second = Stopwatch()
    assert first.cpu_s > second.cpu_s >= 0 and first.wall_s > second.wall_s >= 0
