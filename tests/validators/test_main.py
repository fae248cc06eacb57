"""`python -m knotfab_validators`: requests on stdin, verdicts on stdout, until there are no more."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from validator_parts import circle

import knotfab_validators
from knotfab_validators.validate import validate

EMPTY = {k: None for k in ("part", "knots", "scene", "pictures_dir", "failures")} | {
    "skip": [],
    "processes": 1,
}


def answers(*requests: dict[str, Any]) -> list[dict[str, Any]]:
    done = subprocess.run(
        [sys.executable, "-m", "knotfab_validators", "--no-graphics"],
        input="".join(json.dumps({**EMPTY, **request}) + "\n" for request in requests),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")  # a parent that went away is no error
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_verdicts_are_those_of_validate_and_a_bad_file_is_one_sentence(tmp_path: Path) -> None:
    asked = [("pass", 0, 3.0), ("fail", 1, 41.0)]
    for status, _, radius in asked:
        knot = {"closed": True, "type": "unknot", "points": circle(90, 40.0).tolist()}
        content = {"schema": 1, "unit": "mm", "radius_mm": radius, "knots": [knot]}
        (tmp_path / f"{status}.json").write_text(json.dumps(content))
    (tmp_path / "part.stl").write_bytes(b"no mesh")
    *found, part, absent = answers(
        *({"knots": str(tmp_path / f"{status}.json")} for status, *_ in asked),
        {"part": str(tmp_path / "part.stl")},
        {"knots": str(tmp_path / "absent.json")},
    )
    for (status, code, _), verdict in zip(asked, found, strict=True):
        assert (verdict["status"], verdict["exit_code"]) == (status, code)
        here = json.loads(json.dumps(validate(None, tmp_path / f"{status}.json").to_dict()))
        assert verdict["checks"] == here["checks"] and verdict["views"] == here["views"] == []
        assert all(value >= 0 for value in verdict["seconds"].values())
    assert "part.stl" in part["error"] and "absent.json" in absent["error"]


@pytest.mark.slow
def test_a_request_without_files_leaves_every_loop_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that the first part that is validated waits for none."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (answer,) = answers({})
    assert answer["exit_code"] in (0, 3)
    kept = {path.name.partition("-")[0] for path in tmp_path.rglob("*.nbi")}
    sources = Path(knotfab_validators.__file__).parent.rglob("*.py")
    loops = {
        f"{path.stem}.{name}"
        for path in sources
        for name in re.findall(r"^@compiled\ndef (\w+)", path.read_text(), re.MULTILINE)
    }
    assert kept == loops and len(loops) > 10
