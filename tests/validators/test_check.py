"""Checks pass on the right side of their limit, and never on NaN."""

from __future__ import annotations

import json
import math

import pytest

from knotfab_formats.errors import plain
from knotfab_validators.check import at_least, at_most, skip_check


@pytest.mark.parametrize(
    ("measured", "limit", "low", "high"),
    [
        (1.0, 2.0, "fail", "pass"),
        (2.0, 2.0, "pass", "pass"),
        (3.0, 2.0, "pass", "fail"),
        (math.nan, 2.0, "fail", "fail"),
        (1.0, math.nan, "fail", "fail"),
        (1.0, None, "pass", "pass"),
        (math.nan, None, "fail", "fail"),
    ],
)
def test_a_limit_is_kept_or_not(measured: float, limit: float | None, low: str, high: str) -> None:
    assert at_least("x", measured, limit, "mm", "").status == low
    assert at_most("x", measured, limit, "mm", "").status == high


def test_a_tolerance_is_no_part_of_the_limit() -> None:
    check = at_most("x", 1.0005, 1.0, "mm", "", tolerance=1e-3)
    assert check.status == "pass" and check.limit == 1.0
    assert at_most("x", 1.002, 1.0, "mm", "", tolerance=1e-3).status == "fail"
    assert at_least("x", 0.998, 1.0, "mm", "", tolerance=1e-3).status == "fail"


def test_a_check_is_plain_data() -> None:
    check = at_least("x", 1, 2, "mm", "why", required=False, at=[(0, 1, 2)])
    assert json.loads(json.dumps(plain(check))) == {
        "name": "x",
        "status": "fail",
        "required": False,
        "measured": 1.0,
        "limit": 2.0,
        "unit": "mm",
        "detail": "why",
        "at": [[0.0, 1.0, 2.0]],
    }
    assert not skip_check("x", "nothing to measure").required
