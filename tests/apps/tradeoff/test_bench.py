"""What is measured of which pictures, once, as long as there is time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fake_runs import FakeRunner, FakeStudy

from knotfab.apps.commands import _print_tradeoff
from knotfab.apps.tradeoff.bench import list_rungs
from knotfab.apps.tradeoff.points import PRESET, frontier, list_points
from knotfab.apps.tradeoff.run import JOURNAL, Tradeoff, measure_tradeoff
from knotfab.base.progress import Progress
from knotfab_formats.errors import InputError
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS


@pytest.fixture(autouse=True)
def no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("knotfab.apps.tradeoff.run.draw", lambda *_: b"")


def _pictures(count: int = 4) -> list[FakeStudy]:
    return [FakeStudy(f"picture {k}") for k in range(count)]


def _measure(out: Path, runner: FakeRunner, studies: list[FakeStudy], **more: object) -> Tradeoff:
    return measure_tradeoff(studies, Scene(), out, runner, clock=runner.clock, **more)


def test_fewer_and_fewer_points_on_more_and_more_pictures(tmp_path: Path) -> None:
    runner, studies = FakeRunner(), _pictures(8)
    found = _measure(tmp_path, runner, studies)
    explored = found.explored
    seen = {m.point: len(m.runs) for m in explored.measured}
    assert list_rungs(8) == [1, 2, 4, 8] and set(seen.values()) == {1, 2, 4, 8}
    assert {p.label for p, n in seen.items() if p.knob == PRESET and n == 8} == set(PRESETS)
    assert len(runner.asked) == len(set(runner.asked)) == sum(seen.values())
    assert explored.compared == 8 and explored.front == frontier(explored.whole, explored.middle)
    assert len(runner.asked) < 0.6 * 8 * len(seen)


@pytest.mark.parametrize("count", [1, 2, 3, 12])
def test_rungs_end_with_all(count: int) -> None:
    rungs = list_rungs(count)
    assert rungs[-1] == count and rungs == sorted(set(rungs))


def test_an_interrupted_study_goes_on_and_measures_nothing_twice(tmp_path: Path) -> None:
    whole = FakeRunner()
    _measure(tmp_path / "whole", whole, _pictures())
    first = FakeRunner(most=25)
    with pytest.raises(KeyboardInterrupt, match=r"25 runs are kept in .*the same call goes on"):
        _measure(tmp_path / "parts", first, _pictures())
    with (tmp_path / "parts" / JOURNAL).open("a") as journal:
        journal.write('{"key": "cut o')  # as a machine that stops leaves it
    second = FakeRunner()
    found = _measure(tmp_path / "parts", second, _pictures())
    assert not set(first.asked) & set(second.asked)
    assert set(first.asked) | set(second.asked) == set(whole.asked)
    told = [(tmp_path / name / "tradeoff.json").read_text() for name in ("whole", "parts")]
    assert told[0] == told[1]
    third = FakeRunner()
    again = _measure(tmp_path / "parts", third, _pictures())
    assert not third.asked and again.explored.measured == found.explored.measured


def test_what_another_picture_left_is_not_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _measure(tmp_path, FakeRunner(), [FakeStudy("a", "one content")])
    before, runner = (tmp_path / JOURNAL).read_text(), FakeRunner()
    with Progress("verbose") as progress:
        _measure(tmp_path, runner, [FakeStudy("a", "another")], progress=progress)
    said = capsys.readouterr().err
    assert f"holds {len(before.splitlines())} runs of other pictures" in said
    assert runner.asked and (tmp_path / JOURNAL).read_text().startswith(before)


def test_a_time_limit_is_kept_and_what_was_left_out_is_said(tmp_path: Path) -> None:
    runner = FakeRunner(seconds=10.0)
    found = _measure(tmp_path, runner, _pictures(), limit_s=205.0)
    assert runner.now <= 205.0 and len(runner.asked) == 20
    assert found.left_out and "no time for" in found.said_left_out()
    told = json.loads((tmp_path / "tradeoff.json").read_text())
    assert told["left_out"] == len(found.left_out)
    assert {m.point.label for m in found.explored.measured} >= set(PRESETS)
    assert found.said_left_out() in (tmp_path / "tradeoff.html").read_text().replace("&#39;", "'")
    later = FakeRunner()
    done = _measure(tmp_path, later, _pictures())
    assert not done.left_out and not set(runner.asked) & set(later.asked)


def test_the_table_says_what_steps_buy_and_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = _measure(tmp_path, FakeRunner(), _pictures(), limit_s=505.0)
    _print_tradeoff(found)
    said = capsys.readouterr().out
    assert found.steps and all(str(step) in said for step in found.steps)
    assert found.said_left_out() in said
    best = [m.point.label for m in found.explored.front]
    assert sum(line.startswith("* ") for line in said.splitlines()) == len(best) + 1
    assert max(map(len, said.split("\n\n")[0].splitlines())) <= 80


@pytest.mark.parametrize("pictures", [1, 4])
def test_a_point_is_placed_by_how_it_stands_to_the_middle(tmp_path: Path, pictures: int) -> None:
    explored = _measure(tmp_path, FakeRunner(), _pictures(pictures)).explored
    for one in explored.whole:
        assert explored.place(one) == pytest.approx((one.seconds, one.error))
    middle = explored.middle
    few = middle.over(1)
    assert explored.place(few) == pytest.approx((middle.seconds, middle.error))


def test_no_time_at_all_is_refused(tmp_path: Path) -> None:
    runner = FakeRunner(seconds=10.0)
    with pytest.raises(InputError, match=r"--time-limit 25s: .*measured once"):
        _measure(tmp_path, runner, _pictures(), limit_s=25.0)
    assert len(runner.asked) == 2


def test_no_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no picture"):
        _measure(tmp_path / "out", FakeRunner(), [])
    assert not (tmp_path / "out").exists()


def test_one_picture_is_the_same_loop(tmp_path: Path) -> None:
    runner = FakeRunner()
    found = _measure(tmp_path, runner, _pictures(1), repeats=3)
    assert {len(m.runs) for m in found.explored.measured} == {1}
    assert {request.turn for request in runner.asked} == {0, 1, 2}
    assert len(found.explored.measured) > len(list_points())
    rows = json.loads((tmp_path / "tradeoff.json").read_text())["points"]
    assert [row["point"] for row in rows if row["knob"] == PRESET] == list(PRESETS)
