"""Verdicts as a build has them."""

from __future__ import annotations

from concurrent.futures import Future
from itertools import permutations
from typing import Any

from knotfab.verify.verifier import Answer


def answer(*names: str) -> Future[dict[str, Any]]:
    """What a process answers that measured these checks."""
    found: Future[dict[str, Any]] = Future()
    checks = [{"name": name, "status": "pass", "required": True} for name in names]
    found.set_result({"checks": checks, "views": [], "seconds": {}})
    return found


def test_a_report_lists_checks_in_one_order_however_they_were_measured() -> None:
    names = ("shadow", "centre_line", "mesh_closed", "region", "thing of tomorrow")
    (order,) = {
        tuple(check["name"] for check in Answer(answer(*some)).result()["checks"])
        for some in permutations(names)
    }
    assert set(order) == set(names) and order[-1] == "thing of tomorrow"
