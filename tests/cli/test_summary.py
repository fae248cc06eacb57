"""What a person reads at the end of a build: the word in the first line, warnings where they are due."""

import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reports import VERDICT, check_of, report_with

from knotfab.apps.batch.worker import run_apart
from knotfab.base.arrays import Array, Mask
from knotfab.base.pool import Workers
from knotfab.cli.summary import draw_shadow, print_checks, print_summary
from knotfab.knots import Knot, Knots
from knotfab.report.rows import list_rows
from knotfab.request import Outcome
from knotfab_formats.scene import ResolvedView


def outcome(word: str | None, code: int = 0, **sections: Any) -> Outcome:
    said = {**VERDICT, "word": word, "reasons": ["3 gaps are bridged"]}
    sections["print"] = {"bounding_box_mm": [1, 2, 3], "mass_g": 5.0, **sections.get("print", {})}
    report = report_with(**{"verdict": None if word is None else said, "views": [], **sections})
    return Outcome(code, replace(report, rows=list_rows(report)), Path("out"))


@pytest.mark.parametrize("word", ["faithful", "good", "coarse", "not recognisable", None])
def test_eight_lines_say_how_a_build_ended(
    word: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    many = {"warnings": ["front: unsure"], "notes": [f"note {n}" for n in range(20)]}
    print_summary(outcome(word, **many))
    first, second, *rest = capsys.readouterr().out.splitlines()
    assert (word or "pass") in first and first.endswith("open out/report.html")
    assert ("warning" in first) == (word in ("coarse", "not recognisable"))
    assert second == "  warn: front: unsure." and len(rest) == 6
    print_summary(outcome(word, code=3, **many))
    assert len(capsys.readouterr().out.splitlines()) == 8
    print_summary(outcome(word, **many), verbose=True)
    assert "note 19" in capsys.readouterr().out


def test_a_check_that_is_not_required_never_fails(capsys: pytest.CaptureFixture[str]) -> None:
    print_checks([check_of("closing", "fail", required=False), check_of("shadow", "fail")])
    said = {line.split()[1]: line.split()[0] for line in capsys.readouterr().out.splitlines()[1:3]}
    assert said == {"closing": "warn", "shadow": "FAIL"}


# The shadow in Braille: as large as the tube's, where it is, and never larger than what there is.


VIEW = ResolvedView(frame_width_mm=160.0, frame_height_mm=120.0)
FLAT = VIEW.magnification  # the magnification of a body in the middle of the piece


def ellipse(across: float, up: float, radius: float, count: int = 300) -> Knots:
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points: Array = np.stack([across * np.cos(t), up * np.sin(t), 0 * t], axis=1)
    return Knots((Knot(points),), radius)


def dots(lines: str) -> Mask:
    """Find which dots are set, by the code chart of Braille patterns: 1 2 3 7 down the left, 4 5 6 8 the
    right."""
    places = {
        0: (0, 0), 1: (1, 0), 2: (2, 0), 6: (3, 0), 3: (0, 1), 4: (1, 1), 5: (2, 1), 7: (3, 1),
    }  # fmt: skip
    rows = lines.split("\n")
    found = np.zeros((4 * len(rows), 2 * max(map(len, rows))), dtype=bool)
    for r, row in enumerate(rows):
        for c, character in enumerate(row):
            code = ord(character) - 0x2800
            for bit, (down, right) in places.items():
                found[4 * r + down, 2 * c + right] = character != " " and code >> bit & 1
    return found


@pytest.mark.parametrize("count", [12, 300, 20000])  # vertices: few, or far more than dots
def test_a_ring_darkens_its_area(count: int) -> None:
    seen = dots(draw_shadow([VIEW], ellipse(40.0, 30.0, 6.0, count), 80, 24))
    mm = 160.0 / 128  # a dot: the frame's 120 mm are 96 dots high, 128 wide
    assert seen.shape[0] == 96 and abs(seen.shape[1] - 128) <= 2
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    corners = FLAT * np.stack([40 * np.cos(t), 30 * np.sin(t)], axis=1)
    length = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).sum()
    assert seen.sum() * mm**2 == pytest.approx(2 * 6.0 * FLAT * length, rel=0.06)
    rows, columns = np.nonzero(seen)
    assert rows.mean() == pytest.approx(47.5, abs=0.7)
    assert columns.mean() == pytest.approx(63.5, abs=0.7)
    assert not seen[44:52, 60:68].any()


def test_it_keeps_to_what_there_is() -> None:
    tall = VIEW.model_copy(update={"frame_width_mm": 30.0, "frame_height_mm": 200.0})
    wide = VIEW.model_copy(update={"frame_width_mm": 900.0, "frame_height_mm": 100.0})
    for views in ([VIEW], [tall], [wide], [tall, VIEW], [VIEW, VIEW, VIEW]):
        for columns, rows in ((24, 8), (96, 24), (40, 30)):
            lines = draw_shadow(views, ellipse(40.0, 30.0, 6.0), columns, rows).split("\n")
            assert len(lines) <= rows and max(map(len, lines)) <= columns
    two = draw_shadow([tall, VIEW], ellipse(40.0, 30.0, 6.0), 96, 24)
    assert max(map(len, two.split("\n"))) > 64  # both are there


def test_what_leaves_the_frame_is_no_error() -> None:
    assert dots(draw_shadow([VIEW], ellipse(4000.0, 3000.0, 1.0), 80, 24)).sum() == 0


# The process that builds for batch and studio: one build after the other, each with its own end.


@pytest.fixture(scope="module")
def builder() -> Iterator[Workers]:
    with Workers("knotfab.apps.builder") as workers:
        yield workers


@pytest.mark.slow
def test_each_build_is_one_of_its_own(builder: Workers, tmp_path: Path) -> None:
    """One process answers several builds, each with its own exit code and words."""
    for name in ("one", "other"):
        call = ["build", str(tmp_path / f"{name}.png"), f"--out={tmp_path / 'out'}"]
        code, said = run_apart(builder, call)
        assert code == 2 and f"{name}.png" in said and "knotfab:" not in said
        (process,) = builder.processes
    assert run_apart(builder, ["printers"]) == (0, "")
    assert builder.processes == [process]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_asked_to_end_it_ends_its_build_and_builds_on(builder: Workers, tmp_path: Path) -> None:
    """The build, as one that is interrupted, which leaves nothing."""
    call = ["build", "text:A", f"--out={tmp_path}/out"]
    building = builder.submit(run_apart, builder, call)
    patience = time.monotonic() + 60
    while not list(tmp_path.iterdir()) and time.monotonic() < patience:
        time.sleep(0.02)
    assert list(tmp_path.iterdir())  # where it writes until it is done
    (process,) = builder.processes
    process.send_signal(signal.SIGTERM)
    code, said = building.result(60)
    assert code == 130 and "interrupted" in said
    assert not list(tmp_path.iterdir())
    assert run_apart(builder, ["printers"]) == (0, "") and builder.processes == [process]
