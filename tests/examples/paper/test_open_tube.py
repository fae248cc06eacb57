"""Open tubes: exact volumes, caps where they must be, and lines that no tube fits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from examples.corpus.curves import circle
from examples.paper.curves import spiral
from examples.paper.open_tube import Cap, open_volume, sweep_open
from knotfab.errors import SceneError
from knotfab.files.stl import write_stl
from knotfab.geometry.meshes import as_manifold
from knotfab.geometry.tube import mesh_volume
from knotfab.knots import Knot, Knots
from knotfab_validators.validate import validate

SPIRAL = spiral(6.0, 5.0, 2.5, 0.8)
OPEN = {
    "arc": circle(20.0, 170)[:120],
    "screw": SPIRAL + np.linspace(0, 40, len(SPIRAL))[:, None] * [0, 0, 1],
    "spiral": SPIRAL,
    "straight": np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 9.0]]),
}


@pytest.mark.parametrize("cap", ["round", "flat"])
@pytest.mark.parametrize("sides", [3, 7, 24])
@pytest.mark.parametrize("name", OPEN)
def test_an_open_tube_is_a_ball_with_the_exact_volume(name: str, sides: int, cap: Cap) -> None:
    vertices, faces = sweep_open(OPEN[name], 1.5, sides, cap)
    wanted = open_volume(OPEN[name], 1.5, cap)
    assert mesh_volume(vertices, faces) == pytest.approx(wanted, rel=1e-9)
    solid = as_manifold((vertices, faces))
    assert solid.num_tri() == len(faces) and solid.genus() == 0


def test_the_caps_end_where_they_must() -> None:
    line = OPEN["straight"]
    along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    length = float(np.linalg.norm(line[1] - line[0]))
    ends: dict[Cap, float] = {"flat": 0.0, "round": 1.5}
    for cap, end in ends.items():
        vertices, _ = sweep_open(line, 1.5, 48, cap)
        height = (vertices - line[0]) @ along
        assert (height.min(), height.max()) == pytest.approx((-end, length + end), abs=0.02)


def test_open_lines_that_no_tube_fits_are_refused() -> None:
    with pytest.raises(SceneError, match="bends to a radius"):
        sweep_open(circle(1.0, 140)[:100], 1.5, 12)
    with pytest.raises(SceneError, match="coincide"):
        sweep_open(np.zeros((2, 3)), 1.5, 12)
    with pytest.raises(ValueError, match="points must be"):
        sweep_open(np.zeros((1, 3)), 1.5, 12)
    hairpin = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [60.0, 8.0, 0.0], [30.0, 16.0, 0.0]])
    with pytest.raises(SceneError, match="vertex 2"):
        sweep_open(hairpin, 5.0, 12)


@pytest.mark.slow
def test_an_open_tube_passes_the_independent_checks(tmp_path: Path) -> None:
    """A spiral's files: its length leaves the closing edge out, and the surface is its tube."""
    points = OPEN["spiral"] + [30.0, 30.0, 5.0]
    knot = Knot(points, "open", closed=False)
    assert knot.length_mm == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    knots = Knots((knot,), 1.5)
    knots.write(tmp_path / "knots.json")
    assert json.loads((tmp_path / "knots.json").read_text())["knots"][0]["closed"] is False
    vertices, faces = sweep_open(points, 1.5, 48)
    write_stl(tmp_path / "part.stl", [(vertices, faces)])
    verdict = validate(tmp_path / "part.stl", tmp_path / "knots.json")
    status = {check.name: check.status for check in verdict.checks}
    for name in ("mesh_closed", "mesh_genus", "mesh_volume", "mesh_self_intersection", "tube"):
        assert status[name] == "pass", name
    assert status["thickness"] == "pass"
    assert not [name for name, found in status.items() if found == "fail"]
