"""Templates from formulas are the knots and links that they are called."""

from __future__ import annotations

import numpy as np
import pytest
from knot_judge import judge_type, linking_numbers

from examples.paper.curves import (
    circle,
    closed_braid,
    figure_eight,
    hopf_link,
    torus_knot,
    torus_link,
)
from knotfab.errors import InputError


@pytest.mark.parametrize(
    ("p", "q", "name"),
    [
        (2, 3, "right-handed 3_1"),
        (2, -3, "left-handed 3_1"),
        (3, 2, "right-handed 3_1"),
        (2, 7, "right-handed 7_1"),
        (3, 4, "right-handed 8_19"),
        (5, 1, "unknot"),
    ],
)
def test_torus_knots(p: int, q: int, name: str) -> None:
    assert judge_type(torus_knot(p, q))[0] == f"{name}, proved"


def test_circle_and_figure_eight() -> None:
    ring = circle(7.0, 50)
    assert np.linalg.norm(ring, axis=1) == pytest.approx(np.full(50, 7.0))
    assert judge_type(ring)[0] == "unknot, proved"
    assert judge_type(figure_eight(2.0))[0] == "4_1, proved"


def test_links() -> None:
    assert [abs(n) for n in linking_numbers(*hopf_link(3.0))] == [1]
    # every two of the components of T(n, n) are linked once, right-handedly with p, q > 0
    assert linking_numbers(*torus_link(3, 3)) == [1, 1, 1]
    assert linking_numbers(*torus_link(2, -4)) == [-2]
    assert len(closed_braid([1, 1])) == 2
    assert linking_numbers(*closed_braid([1, 1])) == [1]


@pytest.mark.parametrize("call", [(0, 3), (2, 4), (3, 0)])
def test_torus_knots_that_are_none(call: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="torus"):
        torus_knot(*call)


def test_a_torus_about_its_own_axis_and_empty_braids_are_refused() -> None:
    with pytest.raises(InputError, match="meets its own axis"):
        torus_knot(2, 3, major=1.0, minor=2.0)
    for word in ([], [1, 0]):
        with pytest.raises(InputError, match="must not be 0"):
            closed_braid(word)
    with pytest.raises(InputError, match="samples"):
        circle(1.0, 2)
