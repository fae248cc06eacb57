"""What a person reads at the end of a build: the word in the first line, warnings where they are due."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from knotfab.cli.summary import print_checks, print_summary
from knotfab.request import Outcome


def outcome(word: str | None, code: int = 0) -> Outcome:
    verdict = None if word is None else {"word": word, "reasons": ["3 gaps are bridged"]}
    report: dict[str, Any] = {
        "verdict": verdict, "timings": {"total": 12.0}, "views": [], "knots": [{}], "checks": [],
        "print": {"bounding_box_mm": [1, 2, 3], "mass_g": 5.0}, "settings": {"tube_radius_mm": 2.0},
    }  # fmt: skip
    return Outcome(code, report, Path("out"))


@pytest.mark.parametrize("word", ["faithful", "good", "coarse", "not recognisable", None])
def test_the_first_line_says_what_the_shadow_is_like(
    word: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    print_summary(outcome(word))
    first, *rest = capsys.readouterr().out.splitlines()
    assert (word or "pass") in first
    assert ("warning" in first) == (word in ("coarse", "not recognisable"))
    assert ("3 gaps are bridged" in rest[0]) == (word is not None)


def test_the_last_line_says_what_it_takes_and_where_to_look(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done = outcome("good")
    done.report["print"] |= {"time_s": 9000.0, "filament_g": 42.0, "support_share": 0.31}
    print_summary(done)
    last = capsys.readouterr().out.splitlines()[-1].strip()
    assert last == "good, 2.5 h, 42 g, 31% of it supports: open out/report.html"


def test_where_there_is_no_part_it_has_neither_size_nor_weight(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done = outcome(None, 1)
    done.report["print"] |= {"bounding_box_mm": None, "mass_g": 0.0}
    print_summary(done)
    said = capsys.readouterr().out
    assert "tube radius 2.00 mm, no part\n" in said and said.endswith("  open out/report.html\n")


def test_of_a_stand_the_frame_alone_is_quoted(capsys: pytest.CaptureFixture[str]) -> None:
    done = outcome("good")
    view = {"name": "front", "iou": 0.7, "iou_frame": 0.95, "legibility": {}}
    done.report["views"] = [view]
    for kind, quoted in (("stand", "IoU 0.9500 in the frame"), ("wall", "IoU 0.7000")):
        done.report["print"]["mount"] = {"kind": kind}
        print_summary(done)
        assert f"front: {quoted}\n" in capsys.readouterr().out


def test_a_check_that_is_not_required_never_fails(capsys: pytest.CaptureFixture[str]) -> None:
    line = {"measured": 1.0, "limit": 0.5, "unit": "mm", "detail": "too far"}
    print_checks(
        [
            {"name": "closing", "status": "fail", "required": False, **line},
            {"name": "shadow", "status": "fail", "required": True, **line},
        ]
    )
    said = {line.split()[1]: line.split()[0] for line in capsys.readouterr().out.splitlines()[1:3]}
    assert said == {"closing": "warn", "shadow": "FAIL"}


def test_how_gracefully_the_knots_run_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    done = outcome("good")
    keys = ("mean_curvature_radii", "curvature_90_radii", "turns")
    rows = ((0.2, 0.41, 30.0), (0.1, 0.52, 12.0))
    done.report["knots"] = [dict(zip(keys, row, strict=True)) for row in rows]
    print_summary(done)
    assert "curvature x radius 0.20 (90 % below 0.52), 42 turns" in capsys.readouterr().out
