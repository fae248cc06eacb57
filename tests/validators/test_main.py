"""`python -m knotfab_validators`: a request on stdin, a verdict on stdout."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from validator_parts import circle

from knotfab_validators.validate import validate

EMPTY = {k: None for k in ("part", "knots", "scene", "pictures_dir", "failures", "only")} | {
    "skip": []
}


def answer(request: dict[str, Any]) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "knotfab_validators", "--no-graphics"],
        input=json.dumps({**EMPTY, **request}) + "\n",
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    found: dict[str, Any] = json.loads(line)
    return found


@pytest.mark.parametrize(("radius", "status", "code"), [(3.0, "pass", 0), (41.0, "fail", 1)])
def test_the_verdict_is_that_of_validate(
    radius: float, status: str, code: int, tmp_path: Path
) -> None:
    file = tmp_path / "knots.json"
    knot = {"closed": True, "type": "unknot", "points": circle(90, 40.0).tolist()}
    file.write_text(json.dumps({"schema": 1, "unit": "mm", "radius_mm": radius, "knots": [knot]}))
    found = answer({"knots": str(file)})
    assert found["status"] == status and found["exit_code"] == code
    here = json.loads(json.dumps(validate(None, file).to_dict()))
    assert found["checks"] == here["checks"] and found["views"] == here["views"] == []
    assert all(value >= 0 for value in found["seconds"].values())


def test_a_bad_file_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(b"no mesh")
    assert "part.stl" in answer({"part": str(tmp_path / "part.stl")})["error"]
    assert "absent.json" in answer({"knots": str(tmp_path / "absent.json")})["error"]


def test_a_parent_that_went_away_is_no_error() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "knotfab_validators", "--no-graphics"],
        input="",
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
