"""Strands that run side by side for ever are given up, in a sentence, and not followed to the end."""

from __future__ import annotations

import pytest
from validator_parts import circle, tube

from knotfab_validators import strand_pairs
from knotfab_validators.clearance import check_clearance
from knotfab_validators.mesh import Mesh
from knotfab_validators.read_knots import Curves


def test_a_spike_of_a_centre_line_ends_in_a_required_check_that_was_not_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = circle(24, 20.0)
    mesh = Mesh(*tube(points, 3.0, 8))
    points[3, 2] = 100.0
    curves = Curves((points,), ("unknot",), (True,), 3.0)
    assert check_clearance(mesh, curves, 0.4).status == "pass"
    monkeypatch.setattr(strand_pairs, "MOST_MOVES", 10_000)
    check = check_clearance(mesh, curves, 0.4)
    assert check.status == "skipped" and check.required and "side by side" in check.detail
