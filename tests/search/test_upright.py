"""The pull to stand: its slope is that of finite differences along the vertical, and nothing across."""

import numpy as np
import pytest
from slopes import assert_slope, state_at

from knotfab.base.arrays import Array
from knotfab.limits.terms import Felt
from knotfab.search.objective import Weights
from knotfab.search.upright import FLANK_DEG, Upright

UP = np.array([0.0, 0.6, 0.8])
SIDE = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])


def stand(heights: Array, size: float = 20.0) -> Array:
    """A circle in the plane across `UP`, with its vertices at these heights."""
    t = 2 * np.pi * np.arange(len(heights)) / len(heights)
    around = np.stack([np.cos(t), np.sin(t)], axis=1)
    return np.asarray(size * around @ SIDE + heights[:, None] * UP)


def felt(points: Array) -> Felt:
    return Upright(1.5, UP, 1.0, 15.0)(state_at(points, 1.0), Weights())


def zigzag(angle_deg: float, count: int = 120) -> Array:
    """Six arches of this angle about the circle of `stand`, their valleys on the floor."""
    run = 2 * 20.0 * np.sin(np.pi / count) * np.tan(np.radians(angle_deg))
    k = np.arange(count) % 20
    return np.asarray(1.0 + run * np.minimum(k, 20 - k))


def test_slope_along_the_vertical_is_that_of_its_number_and_none_is_across() -> None:
    heights = 6.0 + 7.0 * np.random.default_rng(0).normal(size=40)

    def call(h: Array) -> Felt:
        total, slope = felt(stand(h.ravel()))
        assert np.abs(slope @ SIDE.T).max() < 1e-12
        return total, (slope @ UP)[:, None]

    assert_slope(call, heights[:, None])


@pytest.mark.parametrize(
    ("heights", "lies_well"),
    [
        (np.full(120, 1.0), True),  # a ring on the floor
        (zigzag(FLANK_DEG + 0.5)[:120].clip(max=12.0), False),  # level tops
        (zigzag(FLANK_DEG - 6), False),
        (1.0 + zigzag(FLANK_DEG + 0.5), False),  # valleys above the floor
        (zigzag(FLANK_DEG + 0.5) * 2.0, False),  # above the top
        (zigzag(FLANK_DEG + 0.5), True),
    ],
)
def test_only_what_stands_in_steep_arches_or_lies_on_the_floor_feels_nothing(
    heights: Array, lies_well: bool
) -> None:
    points = stand(heights)
    points = points - (points @ UP - heights)[:, None] * UP
    assert (felt(points)[0] < 1e-9) == lies_well
