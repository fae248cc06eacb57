"""The flow's own arithmetic: the H1 gradient of each ring."""

from itertools import pairwise

import numpy as np
import pytest

from knotfab.search.flow import _precondition


@pytest.mark.parametrize("sigma", [0.0, 0.3, 2.3, 40.0])
def test_the_h1_gradient_solves_its_equation_on_each_ring(sigma: float) -> None:
    rng = np.random.default_rng(1)
    bounds = np.array([0, 1, 3, 6, 22, 119])
    gradient = rng.normal(size=(119, 3))
    found = _precondition(gradient, bounds, sigma)
    for begin, end in pairwise(bounds):
        own = np.eye(end - begin)
        bending = 2 * own - np.roll(own, 1, 0) - np.roll(own, -1, 0)
        exact = np.linalg.solve(
            own + sigma**2 * bending, (own - 0.25 * bending) @ gradient[begin:end]
        )
        np.testing.assert_allclose(found[begin:end], exact, rtol=1e-10, atol=1e-12)


def test_the_h1_gradient_keeps_what_moves_a_ring_as_a_whole() -> None:
    rng = np.random.default_rng(2)
    gradient = rng.normal(size=(50, 3))
    found = _precondition(gradient, np.array([0, 50]), 4.0)
    np.testing.assert_allclose(found.mean(0), gradient.mean(0), atol=1e-13)
    assert np.ptp(np.diff(found, axis=0)) < 0.3 * np.ptp(np.diff(gradient, axis=0))
