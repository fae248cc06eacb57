"""knots.json is read bit for bit; test_hostile.py has what is no such file."""

import json
from pathlib import Path

import numpy as np
import pytest

from knotfab_validators.files.knots import parse_knots, read_knots


def test_points_come_back_bit_for_bit_without_a_radius_too(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) * 100
    knot = {"closed": True, "type": "3_1", "points": points.tolist()}
    content = {"schema": 1, "unit": "mm", "radius_mm": 0.2, "knots": [knot]}
    (tmp_path / "knots.json").write_text(json.dumps(content))
    curves = read_knots(tmp_path / "knots.json")
    assert np.array_equal(curves.polygons[0], points)
    assert curves.types == ("3_1",) and curves.closed == (True,) and curves.radius_mm == 0.2
    edges = np.roll(points, -1, axis=0) - points
    assert curves.length_mm == pytest.approx(np.linalg.norm(edges, axis=1).sum())
    del content["radius_mm"]
    assert parse_knots(content).radius_mm is None
