"""The paper's renderers, losses and network on hard cases: bounded errors, nothing that is not finite."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from knotfab.search.network import CouplingNetwork
from knotfab.search.network.rigid import rotation
from tests.hard_cases.measure import distances
from tests.hard_cases.paper_rendering import applies, paper_error, printed_corners, printed_fails
from tests.hard_cases.rendering import render_cases

CASES = {case.name: case for case in render_cases() if applies(case)}


@pytest.mark.parametrize("balls", [True, False], ids=["ellipse", "capsule"])
@pytest.mark.parametrize("name", CASES)
def test_the_papers_renderers_are_within_their_condition(name: str, balls: bool) -> None:
    with torch.autograd.set_detect_anomaly(True):
        error, share, finite = paper_error(CASES[name], balls, most=100)
    assert finite
    assert share <= 1.0
    if CASES[name].real:
        assert error <= 1e-3


def test_the_printed_forms_serve_where_nothing_is_hard_and_fail_where_it_is() -> None:
    assert printed_fails(CASES["ordinary"]) == ""
    for name in ("one depth", "zero length", "towards the light", "sphere in sphere"):
        assert printed_fails(CASES[name]) == "not finite"
        assert bool(distances(CASES[name], torch.float64).s.isfinite().all())
    # in general place its corners lie on the true outline
    one, other = np.array([0.3, -0.2, 3.0]), np.array([-0.4, 0.3, 3.5])
    rays = np.concatenate([printed_corners(one, other, 0.01), np.ones((2, 1))], 1)
    miss = np.linalg.norm(np.cross(rays, one), axis=1) / np.linalg.norm(rays, axis=1)
    assert miss == pytest.approx([0.01, 0.01], rel=1e-4)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("weight", [1e-40, 1e3])
def test_a_network_of_64_layers_is_finite_there_and_back(weight: float, dtype: torch.dtype) -> None:
    # scales bounded by a hundredth a layer: 64 of them stay within a factor of two
    network = CouplingNetwork(64, 4, 3, log_scale=0.01, dtype=dtype)
    generator = torch.Generator().manual_seed(4)
    with torch.no_grad():
        for parameter in network.parameters():
            noise = torch.randn(parameter.shape, generator=generator, dtype=torch.float64)
            parameter.add_((weight * noise).to(dtype))
    points = torch.randn(6, 3, generator=generator, dtype=torch.float64).to(dtype)
    points[0] = 1e6
    points = points.requires_grad_()
    there = network(points)
    gradients = torch.autograd.grad(there.sum(), [points, *network.parameters()])
    with torch.no_grad():
        back = network.inverse(there)
    assert bool(there.isfinite().all()) and bool(back.isfinite().all())
    assert all(bool(g.isfinite().all()) for g in gradients)
    if weight <= 1e-3:
        size = points.detach().abs().amax(1, keepdim=True)
        off = ((back - points).detach().abs() / size).max()
        assert float(off) <= 64 * 16 * torch.finfo(dtype).eps


def test_rotations_at_and_near_half_a_turn_are_rotations() -> None:
    for turn in ([1e300, 0, 0], [1e18, 1e18, -1e18], [1e8, 1e-8, 0], [0, 0, 0], [5e-324, 0, 0]):
        t = torch.tensor(turn, dtype=torch.float64, requires_grad=True)
        with torch.autograd.set_detect_anomaly(True):
            r = rotation(t)
            (gradient,) = torch.autograd.grad((r * torch.arange(9.0).reshape(3, 3)).sum(), t)
        assert bool(gradient.isfinite().all())
        r = r.detach()
        assert torch.allclose(r @ r.T, torch.eye(3, dtype=torch.float64), atol=1e-14)
        assert float(torch.linalg.det(r)) == pytest.approx(1.0, abs=1e-14)
