"""The trade-off: what is measured, what is on the frontier, and what is written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from command import knotfab
from PIL import Image, ImageDraw
from shapely import MultiPolygon

from knotfab.errors import MachineError
from knotfab.geometry.tube import sweep
from knotfab.problem import Problem, TargetView
from knotfab.progress import Progress
from knotfab.scene.model import ResolvedRegion, ResolvedView, Scene
from knotfab.scene.settings import PRESETS
from knotfab.tradeoff.measure import Measured, Study, facet_error_px, frontier, measure
from knotfab.tradeoff.points import Point, points
from knotfab.tradeoff.run import tradeoff

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


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    image = Image.new("L", (96, 96), 255)
    ImageDraw.Draw(image).ellipse((20, 24, 76, 72), fill=0)
    path = tmp_path / "oval.png"
    image.save(path)
    return path


def _make_measured(iou: float, seconds: float, feasible: bool = True) -> Measured:
    return Measured(Point("iterations", "", QUICK), iou, 0.1, seconds, 0.0, feasible, 0, 0)


def test_the_frontier_is_what_nothing_beats() -> None:
    slow_best, fast, beaten = (
        _make_measured(0.99, 4.0),
        _make_measured(0.95, 1.0),
        _make_measured(0.94, 2.0),
    )
    same, infeasible = _make_measured(0.99, 5.0), _make_measured(0.999, 0.5, feasible=False)
    assert frontier([slow_best, fast, beaten, same, infeasible]) == [fast, slow_best]


def test_facets_stand_out_as_far_as_the_sweep_makes_them() -> None:
    """r a² / 12 is the polygon of the circle's area against the circle, to second order."""

    view = ResolvedView(wall_distance_mm=1e-9, frame_width_mm=1024.0, frame_height_mm=1024.0)
    target = TargetView(view, np.ones((2, 2), dtype=bool), MultiPolygon())
    asked = Problem((target,), 0.4, None, 1e5, ResolvedRegion(size_mm=(1e3, 1e3, 1e3)))
    turn = 2 * np.pi * np.arange(400) / 400
    ring = 100 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    for sides in (12, 48):
        vertices, _ = sweep(ring, 5.0, sides)
        across = np.hypot(np.hypot(vertices[:, 0], vertices[:, 1]) - 100, vertices[:, 2])
        said = facet_error_px(asked, 5.0, sides)
        assert across.max() - 5.0 == pytest.approx(said, rel=0.05)


def test_every_point_is_a_setting_of_its_own() -> None:
    asked = points()
    assert len({p.settings for p in asked}) == len(asked)
    assert {p.label for p in asked if p.knob == "preset"} == set(PRESETS)


@pytest.mark.slow
def test_what_is_written_says_what_was_measured(picture: Path, tmp_path: Path) -> None:
    scene = Scene.model_validate({"schema": 1, "piece": {"tube_radius_mm": 4.0, "depth": "flat"}})
    asked = [Point("preset", "quick", QUICK), Point("iterations", "2 times", QUICK.scaled(2.0))]
    out = tmp_path / "out"
    found = tradeoff(scene, str(picture), out, repeats=2, progress=Progress("quiet"), chosen=asked)
    content = json.loads((out / "tradeoff.json").read_text())
    assert [row["iou"] for row in content["points"]] == [m.iou for m in found.measured]
    assert all(0.8 < m.iou < 1 and m.search_s > 0 and m.faces > 0 for m in found.measured)
    assert any(row["frontier"] for row in content["points"])
    assert content["points"][1]["settings"]["coarse_iterations"] == 16
    with Image.open(out / "tradeoff.png") as drawn:
        assert drawn.size[0] > 500
    assert sorted(p.name for p in out.iterdir()) == ["tradeoff.json", "tradeoff.png"]


@pytest.mark.slow
def test_points_side_by_side_are_the_same_points(picture: Path, tmp_path: Path) -> None:
    scene = Scene.model_validate({"schema": 1, "piece": {"tube_radius_mm": 4.0, "depth": "flat"}})
    asked = [Point("iterations", f"{f:g} times", QUICK.scaled(f)) for f in (0.25, 0.5)]
    found = {
        jobs: tradeoff(scene, str(picture), tmp_path / str(jobs), chosen=asked, jobs=jobs).measured
        for jobs in (1, 2)
    }
    for alone, beside in zip(found[1], found[2], strict=True):
        assert (alone.point, alone.iou, alone.faces) == (beside.point, beside.iou, beside.faces)
        assert beside.search_s > 0
    assert json.loads((tmp_path / "2" / "tradeoff.json").read_text())["jobs"] == 2


def test_a_point_whose_process_ends(
    picture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho 'no more memory' >&2; exit 9\n")
    broken.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(broken))
    with pytest.raises(MachineError, match=r"--jobs 2: .*no more memory.*--jobs 1"):
        measure(cast(Study, None), [Point("preset", "quick", QUICK)], jobs=2)


@pytest.mark.parametrize("option", ["--repeats", "--jobs"])
def test_no_runs_are_refused(picture: Path, tmp_path: Path, option: str) -> None:
    done = knotfab("tradeoff", str(picture), option, "0", "--out", str(tmp_path / "out"))
    assert done.code == 2 and f"{option} 0" in done.err
    assert not (tmp_path / "out").exists()
