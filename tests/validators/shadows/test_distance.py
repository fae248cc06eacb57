"""Distances on a grid are those of scipy's exact transform."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from knotfab_validators.shadows.distance import depth_in


@pytest.mark.parametrize("share", [0.02, 0.5, 0.97, 0.9995])
@pytest.mark.parametrize("shape", [(1, 40), (40, 1), (33, 57), (80, 61)])
def test_the_depth_is_exact(share: float, shape: tuple[int, int]) -> None:
    mask = np.random.default_rng(7).random(shape) < share
    mask[0, -1] = False
    np.testing.assert_array_equal(depth_in(mask), distance_transform_edt(mask))
    np.testing.assert_array_equal(depth_in(mask.T), distance_transform_edt(mask.T))


def test_with_nothing_outside_it_is_the_diagonal() -> None:
    assert (depth_in(np.ones((3, 4), dtype=bool)) == 5.0).all()
    assert not depth_in(np.zeros((3, 4), dtype=bool)).any()
