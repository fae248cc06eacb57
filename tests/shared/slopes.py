"""Gradients against central differences, in double precision."""

from collections.abc import Callable

import numpy as np
import pytest

from knotfab.base.arrays import Array
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Felt, State


def state_at(points: Array, reach: float = 12.0) -> State:
    """The state of one closed polyline with vertices (N, 3), whose neighbours lie within `reach` mm."""
    rings = polylines_of_sizes((len(points),))
    return State.at(points, rings, find_neighbours(points, rings, reach, 6))


def assert_slope(
    call: Callable[[Array], Felt], points: Array, rel: float = 1e-5, step: float = 1e-6
) -> None:
    """That the gradient (n, 3) of `call` is what its number changes by, along five random ways."""
    draw = np.random.default_rng(4)
    _, slope = call(points)
    assert slope.shape == points.shape
    for _ in range(5):
        way = draw.normal(size=points.shape)
        change = (call(points + step * way)[0] - call(points - step * way)[0]) / (2 * step)
        size = float(np.linalg.norm(slope) * np.linalg.norm(way))
        assert float((slope * way).sum()) == pytest.approx(change, rel=rel, abs=1e-7 * size)
