"""knots.json is read bit for bit, and everything that is no such file is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.files.knots import parse_knots, read_knots

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]]


def content(**changes: Any) -> dict[str, Any]:
    knot = {"closed": True, "type": "unknot", "points": SQUARE}
    return {"schema": 1, "unit": "mm", "radius_mm": 0.2, "knots": [knot], **changes}


def with_knot(**changes: Any) -> dict[str, Any]:
    return content(knots=[{"closed": True, "type": "unknot", "points": SQUARE, **changes}])


def test_points_come_back_bit_for_bit(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) * 100
    (tmp_path / "knots.json").write_text(json.dumps(with_knot(points=points.tolist(), type="3_1")))
    curves = read_knots(tmp_path / "knots.json")
    assert np.array_equal(curves.polygons[0], points)
    assert curves.types == ("3_1",) and curves.closed == (True,) and curves.radius_mm == 0.2
    edges = np.roll(points, -1, axis=0) - points
    assert curves.length_mm == pytest.approx(np.linalg.norm(edges, axis=1).sum())


def test_the_radius_may_be_absent() -> None:
    data = content()
    del data["radius_mm"]
    assert parse_knots(data).radius_mm is None


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ([], "object"),
        (content(schema=2), "schema"),
        (content(unit="inch"), "unit"),
        (content(radius_mm=-1), "radius_mm"),
        (content(radius_mm="2"), "radius_mm"),
        (content(radius_mm=float("nan")), "radius_mm"),
        (content(knots=[]), "at least one"),
        (content(knots=[7]), "knot 0 has no points"),
        (with_knot(points=SQUARE[:2]), "at least 3"),
        (with_knot(points=[[0, 0], [1, 0], [0, 1]]), "at least 3"),
        (with_knot(points=[[0, 0, 0], [1, 0], [0, 1, 0]]), "list of"),
        (with_knot(points="abc"), "list of"),
        (with_knot(points=[*SQUARE, [float("inf"), 0, 0]]), "point 4 is not finite"),
        (with_knot(points=[*SQUARE, SQUARE[0]]), "points 4 and 0 coincide"),
        (with_knot(points=[SQUARE[0], SQUARE[1], SQUARE[1], SQUARE[2]]), "points 1 and 2 coin"),
        (with_knot(points=[[1e308, 0, 0], [-1e308, 0, 0], [0, 1e308, 0]]), "beyond"),
        (with_knot(closed=0), "closed must be"),
        (with_knot(type=3), "type"),
    ],
)
def test_what_is_no_knots_file_is_refused(data: Any, says: str) -> None:
    with np.errstate(over="ignore"), pytest.raises(BadFile, match=says):
        parse_knots(data)


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "c.json").write_text("[" * 100_000)
    for name in ("a.json", "b.json", "c.json", "none.json"):
        with pytest.raises(BadFile, match=f"^{name}"):
            read_knots(tmp_path / name)
