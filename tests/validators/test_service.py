"""What the worker of the validators answers: verdicts, whole or of two halves."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from validator_parts import circle

from knotfab.base.pool import Workers
from knotfab_validators.validate import validate

EMPTY = {k: None for k in ("part", "knots", "scene", "pictures_dir", "failures")} | {"skip": []}


@pytest.fixture(scope="module")
def validators() -> Iterator[Workers]:
    with Workers("knotfab_validators.service", "geometry") as workers:
        yield workers


@pytest.mark.slow
def test_verdicts_are_validates_and_a_bad_file_is_one_sentence(
    validators: Workers, tmp_path: Path
) -> None:
    asked = [("pass", 0, 3.0), ("fail", 1, 41.0)]
    for status, _, radius in asked:
        knot = {"closed": True, "type": "unknot", "points": circle(90, 40.0).tolist()}
        content = {"schema": 1, "unit": "mm", "radius_mm": radius, "knots": [knot]}
        (tmp_path / f"{status}.json").write_text(json.dumps(content))
    (tmp_path / "part.stl").write_bytes(b"no mesh")
    files = [{"knots": str(tmp_path / f"{status}.json")} for status, *_ in asked]
    files += [{"part": str(tmp_path / "part.stl")}, {"knots": str(tmp_path / "absent.json")}]
    *found, part, absent = (
        validators.answer({**EMPTY, **named, "piece": f"{k}"}) for k, named in enumerate(files)
    )
    for (status, code, _), verdict in zip(asked, found, strict=True):
        assert (verdict["status"], verdict["exit_code"]) == (status, code)
        here = json.loads(json.dumps(validate(None, tmp_path / f"{status}.json").to_dict()))
        assert verdict["checks"] == here["checks"] and verdict["views"] == here["views"] == []
        assert all(value >= 0 for value in verdict["seconds"].values())
    assert "part.stl" in part["error"] and "absent.json" in absent["error"]
