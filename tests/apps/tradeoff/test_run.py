"""The trade-off of real searches: what is measured and what is written."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from command import knotfab
from PIL import Image, ImageDraw
from played_runs import FakeRunner, FakeStudy, make_run
from shapely import MultiPolygon

from knotfab.apps.tradeoff import bench
from knotfab.apps.tradeoff.bench import Runner, WantedRun, list_rungs, run_all
from knotfab.apps.tradeoff.measure import Run, Study, facet_error_px, outline_error_px
from knotfab.apps.tradeoff.points import PRESET, Point, frontier, list_points
from knotfab.apps.tradeoff.run import JOURNAL, Tradeoff, measure_tradeoff, print_tradeoff, tradeoff
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.progress import Progress
from knotfab.geometry.tube import sweep
from knotfab.problem import Problem, TargetView
from knotfab_formats.errors import InputError
from knotfab_formats.scene import ResolvedView, Scene, SettledRegion
from knotfab_formats.search import PRESETS

QUICK = PRESETS["draft"].model_copy(
    update={
        "coarse_px": 64,
        "fine_px": 96,
        "coarse_iterations": 8,
        "fine_iterations": 6,
        "settle_iterations": 6,
        "depth_candidates": 1,
    }
)
SCENE = Scene.model_validate({"schema": 1, "piece": {"tube_radius_mm": 4.0, "depth": "flat"}})


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    image = Image.new("L", (96, 96), 255)
    ImageDraw.Draw(image).ellipse((20, 24, 76, 72), fill=0)
    path = tmp_path_factory.mktemp("pictures") / "oval.png"
    image.save(path)
    return path


def _disc(radius: float, at: tuple[float, float] = (60.0, 60.0)) -> np.ndarray:
    v, u = np.mgrid[:120, :120]
    return np.asarray(np.hypot(u - at[0], v - at[1]) < radius)


def test_the_outline_error_is_how_far_outlines_are_apart() -> None:
    one = _disc(40.0)
    assert outline_error_px(one, one) == 0.0
    for grown in (2.0, 5.0):
        assert outline_error_px(one, _disc(40.0 + grown)) == pytest.approx(grown, abs=0.75)
    # moved by d, a circle is d |cos| away from itself: 95 % are within d sin(.95 pi / 2)
    moved = outline_error_px(one, _disc(40.0, (66.0, 60.0)))
    assert moved == pytest.approx(6.0 * np.sin(0.95 * np.pi / 2), abs=0.75)
    # a pair that one lacks is found from the other side
    hole = one & ~_disc(30.0)
    assert outline_error_px(one, hole) == outline_error_px(hole, one) > 8.0
    none = np.zeros_like(one)
    assert outline_error_px(none, none) == 0.0 and outline_error_px(none, one) > 120.0


def test_facets_stand_out_as_far_as_the_sweep_makes_them() -> None:
    """A polygon of the circle's area stands out by r a² / 12, to second order."""

    view = ResolvedView(wall_distance_mm=1e-3, frame_width_mm=1024.0, frame_height_mm=1024.0)
    target = TargetView(view, np.ones((2, 2), dtype=bool), MultiPolygon())
    asked = Problem((target,), 0.4, None, 1e5, SettledRegion(size_mm=(1e3, 1e3, 1e3)))
    turn = 2 * np.pi * np.arange(400) / 400
    ring = 100 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    for sides in (12, 48):
        vertices, _ = sweep(ring, 5.0, sides)
        across = np.hypot(np.hypot(vertices[:, 0], vertices[:, 1]) - 100, vertices[:, 2])
        said = facet_error_px(asked, 5.0, sides)
        assert across.max() - 5.0 == pytest.approx(said, rel=0.05)


ASKED = [Point("preset", "quick", QUICK), Point("iterations", "× 2", QUICK.scaled(2.0))]


@pytest.fixture(scope="module")
def found(picture: Path, tmp_path_factory: pytest.TempPathFactory) -> Tradeoff:
    out = tmp_path_factory.mktemp("tradeoff")
    return tradeoff(SCENE, [str(picture)], out, chosen=ASKED, combinations=0)


@pytest.mark.slow
def test_what_is_written_says_what_was_measured(found: Tradeoff, picture: Path) -> None:
    out, measured = found.folder, found.explored.measured
    content = json.loads((out / "tradeoff.json").read_text())
    assert [row["iou"] for row in content["points"]] == [m.iou for m in measured]
    assert all(0.8 < m.iou < 1 and m.seconds > 0 and m.runs[0].faces > 0 for m in measured)
    assert all(0 < m.curvature < 1 and 0 < (m.legible or 0) <= 1 for m in measured)
    assert any(row["frontier"] for row in content["points"])
    assert content["points"][1]["settings"]["coarse_iterations"] == 16
    with Image.open(out / "tradeoff.png") as drawn:
        assert drawn.size[0] > 500
    files = ["tradeoff-runs.jsonl", "tradeoff.html", "tradeoff.json", "tradeoff.png"]
    assert sorted(p.name for p in out.iterdir()) == files
    # again, nothing is left to be measured: not even the seconds change
    before = (out / JOURNAL).read_bytes()
    again = tradeoff(SCENE, [str(picture)], out, chosen=ASKED, combinations=0)
    assert again.explored.measured == measured and (out / JOURNAL).read_bytes() == before


def _alike(found: Tradeoff, other: Tradeoff) -> bool:
    """Tell whether both measured the same points, however long each took."""
    one, two = (
        [(m.point, m.seconds > 0, *((r.iou, r.faces, r.shadow) for r in m.runs)) for m in measured]
        for measured in (found.explored.measured, other.explored.measured)
    )
    return one == two


def test_a_worker_answers_what_is_measured_here(
    found: Tradeoff, picture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its side of the pipe, in this process: studies are pickled, and runs told in JSON."""

    def play(studies: Sequence[Study], jobs: int) -> Runner:
        (tmp_path / "studies").write_bytes(pickle.dumps(list(studies)))
        bench.begin(str(tmp_path / "studies"))

        def run(requests: Iterator[WantedRun]) -> Iterator[tuple[WantedRun, Run]]:
            for wanted in requests:
                asked = {"picture": wanted.picture, "settings": wanted.settings.model_dump()}
                told = bench.answer({**asked, "judge": wanted.turn == 0}, None)
                yield wanted, Run(**json.loads(json.dumps(told)))

        return run

    monkeypatch.setattr("knotfab.apps.tradeoff.run.run_all", play)
    out = tmp_path / "out"
    told = tradeoff(SCENE, [str(picture)], out, chosen=ASKED, jobs=2, combinations=0)
    assert _alike(found, told) and json.loads((out / "tradeoff.json").read_text())["jobs"] == 2


@pytest.mark.study  # its answers are those of the test above, and tests/base has the processes
def test_points_side_by_side_are_the_same_points(
    found: Tradeoff, picture: Path, tmp_path: Path
) -> None:
    beside = tradeoff(SCENE, [str(picture)], tmp_path, chosen=ASKED, jobs=2, combinations=0)
    assert _alike(found, beside)


def _answer(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a point with a worker that is this script."""
    broken = tmp_path / "python"
    broken.write_text(f"#!/bin/sh\n{script}\n")
    broken.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(broken))
    list(run_all([cast(Study, None)], 2)(iter([WantedRun(0, QUICK)])))


def test_two_processes_share_the_runs_and_the_first_of_a_point_is_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_run(1.0, 0.99)
    asked = tmp_path / "asked"
    played = tmp_path / "python"
    told = json.dumps({"answer": run.to_dict()})
    played.write_text(
        f'#!/bin/sh\necho "$$ $*" >> {tmp_path}/begun\n'
        f"while read line; do sleep .2; echo \"$line\" >> {asked}; echo '{told}'; done\n"
    )
    played.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(played))
    wanted = [WantedRun(number, QUICK, turn) for turn in range(3) for number in range(2)]
    assert dict(run_all([cast(Study, None)] * 2, 2)(iter(wanted))) == dict.fromkeys(wanted, run)
    requests = [json.loads(line) for line in asked.read_text().splitlines()]
    judged = sorted((r["picture"], r["judge"]) for r in requests)
    assert judged == sorted((w.picture, w.turn == 0) for w in wanted)
    assert all(r["settings"] == QUICK.model_dump() for r in requests)
    begun = (tmp_path / "begun").read_text().splitlines()
    assert len(begun) == 2 and all(f" {bench.__name__} " in line for line in begun)


def test_a_point_whose_process_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MachineError, match=r"--jobs 2: .*no more memory.*--jobs 1"):
        _answer("echo 'no more memory' >&2; exit 9", tmp_path, monkeypatch)


def test_what_a_worker_refuses_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = '{"answer": {"refused": ["SceneError", "the picture", "it is too fine", "Simplify it"]}}'
    with pytest.raises(SceneError, match=r"the picture: it is too fine\. Simplify it"):
        _answer(f"read line; echo '{told}'; read line", tmp_path, monkeypatch)


@pytest.mark.parametrize(
    "option", ["--repeats 0", "--jobs 0", "--combinations -1", "--time-limit soon"]
)
def test_no_runs_are_refused(picture: Path, tmp_path: Path, option: str) -> None:
    done = knotfab("tradeoff", str(picture), *option.split(), "--out", str(tmp_path / "out"))
    assert done.code == 2 and option in done.err
    assert not (tmp_path / "out").exists()


def test_no_picture_and_a_missing_one_are_refused(picture: Path, tmp_path: Path) -> None:
    for pictures, said in (((), "no picture"), ((str(picture), "none.png"), "none.png")):
        done = knotfab("tradeoff", *pictures, "--out", str(tmp_path / "out"))
        assert done.code == 2 and said in done.err
        assert not (tmp_path / "out").exists()


# What is measured of which pictures, once, as long as there is time.


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
    print_tradeoff(found)
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
        assert explored.cost_of(one) == pytest.approx((one.seconds, one.error))
    middle = explored.middle
    few = middle.over(1)
    assert explored.cost_of(few) == pytest.approx((middle.seconds, middle.error))


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
