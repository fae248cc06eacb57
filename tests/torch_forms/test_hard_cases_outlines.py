"""The outline renderers on hard cases, with their bounded errors, and the closed forms as printed."""

import numpy as np
import pytest
import torch

from benchmarks.hard.measure import distances
from benchmarks.hard.paper_rendering import applies, paper_error, printed_corners, printed_fails
from benchmarks.hard.rendering import render_cases

pytestmark = pytest.mark.slow

CASES = {case.name: case for case in render_cases(samples=5_000) if applies(case)}


@pytest.mark.parametrize("balls", [True, False], ids=["ellipse", "capsule"])
@pytest.mark.parametrize("name", CASES)
def test_the_papers_renderers_are_within_their_condition(name: str, balls: bool) -> None:
    with torch.autograd.set_detect_anomaly(True):
        error, share, finite = paper_error(CASES[name], balls, most=100)
    assert finite
    assert share <= 1.0
    if CASES[name].real:
        assert error <= 1e-3


def test_the_printed_forms_serve_only_where_nothing_is_hard() -> None:
    assert printed_fails(CASES["ordinary"]) == ""
    for name in ("one depth", "zero length", "towards the light", "sphere in sphere"):
        assert printed_fails(CASES[name]) == "not finite"
        assert bool(distances(CASES[name], torch.float64).s.isfinite().all())
    # in general place its corners lie on the true outline
    one, other = np.array([0.3, -0.2, 3.0]), np.array([-0.4, 0.3, 3.5])
    rays = np.concatenate([printed_corners(one, other, 0.01), np.ones((2, 1))], 1)
    miss = np.linalg.norm(np.cross(rays, one), axis=1) / np.linalg.norm(rays, axis=1)
    assert miss == pytest.approx([0.01, 0.01], rel=1e-4)
