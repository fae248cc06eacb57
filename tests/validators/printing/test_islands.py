"""What begins in mid-air, and what only seems to."""

import numpy as np
import pytest
from printed_solids import BARE, run
from solids import blocks, cone


def test_what_hangs_down_in_mid_air_is_an_island() -> None:
    filled = np.zeros((5, 1, 3))
    filled[:, :, 2] = filled[0] = filled[4] = 1
    filled[2, :, 1] = 1
    hanging = blocks([0, 5, 9, 11, 15, 20], [0, 10], [0, 6, 10, 12], filled)
    found = run(hanging, BARE)
    assert (found["islands"].measured, found["islands"].status) == (1, "fail")
    assert found["floating"].measured == 0 and found["floating"].status == "pass"
    x, _, z = found["islands"].at[0]
    assert 9 <= x <= 11 and z == pytest.approx(6.0)
    assert run(hanging)["islands"].status == "pass"


def test_a_leg_thinner_than_the_grid_still_holds() -> None:
    filled = np.zeros((5, 5, 4))
    filled[:, :, 0] = filled[:, :, 3] = filled[2, 2] = 1
    filled[[0, -1], :, 1] = filled[:, [0, -1], 1] = 1  # it stands in a tray
    line = [0.0, 2.0, 4.85, 5.15, 8.0, 10.0]  # between the axes at 4.75 and 5.25
    found = run(blocks(line, line, [0.0, 2.0, 3.0, 6.0, 8.0], filled), BARE)
    assert found["islands"].measured == 0


def test_a_cone_on_its_tip() -> None:
    standing = run(cone((20, 20, 0), 8.0, 12.0), BARE)
    assert standing["islands"].measured == standing["floating"].measured == 0
    aloft = run(cone((20.1, 20.2, 5), 8.0, 12.0), BARE)
    assert aloft["islands"].measured == aloft["floating"].measured == 1
    assert aloft["floating"].at[0] == pytest.approx((20.1, 20.2, 5))
    assert aloft["islands"].at[0] == pytest.approx((20.1, 20.2, 5), abs=0.8)
