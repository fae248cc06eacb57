"""The trade-off of real searches: what is measured and what is written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from command import knotfab
from PIL import Image, ImageDraw
from shapely import MultiPolygon

from knotfab.apps.tradeoff.bench import WantedRun, run_all
from knotfab.apps.tradeoff.measure import Study, facet_error_px, outline_error_px
from knotfab.apps.tradeoff.points import Point
from knotfab.apps.tradeoff.run import JOURNAL, Tradeoff, tradeoff
from knotfab.base.errors import MachineError, SceneError
from knotfab.geometry.tube import sweep
from knotfab.problem import Problem, TargetView
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


@pytest.mark.slow
def test_points_side_by_side_are_the_same_points(
    found: Tradeoff, picture: Path, tmp_path: Path
) -> None:
    beside = tradeoff(SCENE, [str(picture)], tmp_path, chosen=ASKED, jobs=2, combinations=0)
    for alone, other in zip(found.explored.measured, beside.explored.measured, strict=True):
        assert alone.point == other.point and other.seconds > 0
        one, two = alone.runs[0], other.runs[0]
        assert (one.iou, one.faces, one.shadow) == (two.iou, two.faces, two.shadow)
    assert json.loads((tmp_path / "tradeoff.json").read_text())["jobs"] == 2


def _answer(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a point with a worker that is this script."""
    broken = tmp_path / "python"
    broken.write_text(f"#!/bin/sh\n{script}\n")
    broken.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(broken))
    list(run_all([cast(Study, None)], 2)(iter([WantedRun(0, QUICK)])))


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
