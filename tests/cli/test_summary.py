"""What a person reads at the end of a build: the word in the first line, warnings where they are due."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
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
from knotfab.request import Outcome
from knotfab_formats.scene import ResolvedView


def outcome(word: str | None, code: int = 0, **sections: Any) -> Outcome:
    said = {**VERDICT, "word": word, "reasons": ["3 gaps are bridged"]}
    sections["print"] = {"bounding_box_mm": [1, 2, 3], "mass_g": 5.0, **sections.get("print", {})}
    report = report_with(**{"verdict": None if word is None else said, "views": [], **sections})
    return Outcome(code, report, Path("out"))


def test_a_warning_stands_before_the_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(outcome("good", warnings=["front: unsure; --ink light takes it"]))
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first == "warning: front: unsure; --ink light takes it." and second.startswith("pass")


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
    taken = {"time_s": 9000.0, "filament_g": 42.0, "support_share": 0.31}
    print_summary(outcome("good", print=taken))
    last = capsys.readouterr().out.splitlines()[-1].strip()
    assert last == "good, 2.5 h, 42 g, 31% of it supports: open out/report.html"


def test_where_there_is_no_part_it_has_neither_size_nor_weight(
    capsys: pytest.CaptureFixture[str],
) -> None:
    print_summary(outcome(None, 1, print={"bounding_box_mm": None, "mass_g": 0.0}))
    said = capsys.readouterr().out
    assert "  no part; one knot of a tube 4.0 mm thick\n" in said
    assert said.endswith("  open out/report.html\n")


def test_of_a_stand_the_frame_alone_is_quoted(capsys: pytest.CaptureFixture[str]) -> None:
    views = [{"iou": 0.7, "iou_frame": 0.95, "legibility": {}}]
    for kind, quoted in (("stand", "95.0% alike in the frame"), ("wall", "70.0% alike")):
        print_summary(outcome("good", views=views, print={"mount": {"kind": kind}}))
        assert f"  {quoted}\n" in capsys.readouterr().out


def test_a_check_that_is_not_required_never_fails(capsys: pytest.CaptureFixture[str]) -> None:
    print_checks([check_of("closing", "fail", required=False), check_of("shadow", "fail")])
    said = {line.split()[1]: line.split()[0] for line in capsys.readouterr().out.splitlines()[1:3]}
    assert said == {"closing": "warn", "shadow": "FAIL"}


def test_how_gracefully_the_knots_run_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    keys = ("mean_curvature_radii", "curvature_90_radii", "turns")
    rows = ((0.2, 0.41, 30.0), (0.1, 0.52, 12.0))
    knots = [dict(zip(keys, row, strict=True)) for row in rows]
    print_summary(outcome("good", knots=knots), verbose=True)
    assert "curvature × radius 0.20 (90% below 0.52), 42 turns" in capsys.readouterr().out


def view(name: str, iou: float, **more: Any) -> dict[str, Any]:
    named = {"45": {"z": more.pop("z", 1.6), "first": False}}
    return {"name": name, "iou": iou, "legibility": {}, "recognition": named, **more}


def test_views_are_told_by_name_in_percent(capsys: pytest.CaptureFixture[str]) -> None:
    off = {
        "parting_px": 2.0, "lamp_mm": 5.0, "turn_deg": 1.0, "iou": 0.95, "samples": 7, "lamp_iou": {},
        "lamp_iou_per_mm": {}, "worst": {"of": "turn", "way": "up", "raw": 0.9, "fitted": 0.966},
    }  # fmt: skip
    teapot = view("teapot", 0.957, z=2.5, bound=0.9976, misplacement=off)
    done = outcome("good", views=[view("heart", 0.99962, bound=0.9), teapot])
    print_summary(done)
    said = capsys.readouterr().out
    # no bound that it beats
    assert "  heart: 99.9% alike; from 45° aside its picture is not read (z 1.6)\n" in said
    assert (
        "  teapot: 95.7% alike (at most 99.8% without spill); 97% with the piece turned by 1°"
        in said
    )
    assert "; from 45° aside its picture may be guessed (z 2.5)\n" in said
    print_summary(outcome("good", views=[view("heart", 0.9, z=3.3)]))
    assert "; from 45° aside its picture is read (z 3.3)\n" in capsys.readouterr().out
    assert "IoU" not in said and "radius" not in said and "curvature" not in said
    print_summary(done, verbose=True)
    assert "IoU 0.9570" in capsys.readouterr().out


def test_a_sequence_is_one_line_of_frames(capsys: pytest.CaptureFixture[str]) -> None:
    views = [view(f"frame-{k:02d}", iou) for k, iou in ((1, 0.98), (2, 0.95), (3, 0.97))]
    print_summary(outcome("good", views=views, print={"parts": 3}))
    assert "  95.0% (frame 2) to 98.0% alike (frame 1)\n" in capsys.readouterr().out


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
