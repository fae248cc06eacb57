"""A braid is tightened to a short knot of its type."""

import pytest
from knot_judge import judge_type

from knotfab_formats.knots import BRAIDS
from paper.curves import closed_braid
from paper.tighten import tighten


@pytest.mark.slow
def test_tightening_a_braid_gives_a_short_knot_of_its_type() -> None:
    tight = tighten(closed_braid(BRAIDS["3_1"])[0])
    # the ropelength of the trefoil is 32.74 (radius 1): the polygon comes near from above
    assert 32.7 < tight.length < 34.0
    assert tight.gap >= 2.0 and tight.bend >= 1.0
    assert judge_type(tight.points)[0] == "right-handed 3_1, proved"
