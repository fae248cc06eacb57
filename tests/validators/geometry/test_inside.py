"""Points lie inside or outside of closed and open surfaces."""

import numpy as np
import pytest
from solids import box, inward, together

from knotfab_validators.geometry.inside import surface_distance, winding_numbers

BLOCK = together(box((0, 0, 0), (10, 10, 10)), inward(box((3, 3, 3), (7, 7, 7))))
POINTS = np.array([[1.0, 5, 5], [5, 5, 5], [-2, 5, 5]])


@pytest.mark.parametrize("exact", [True, False])
def test_a_hollow_is_outside(exact: bool) -> None:
    winding = winding_numbers(POINTS, BLOCK, exact=exact)
    assert winding == pytest.approx([1, 0, 0], abs=1e-9 if exact else 0.01)
    assert winding_numbers(POINTS[:0], BLOCK, exact=exact).shape == (0,)


def test_distance_is_that_of_the_nearest_face() -> None:
    assert surface_distance(POINTS, BLOCK) == pytest.approx([1, 2, 2])
