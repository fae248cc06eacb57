"""The table of exact thicknesses and of convergence says what it promises."""

import numpy as np
import pytest

from tests.corpus.thicknesses import ThicknessRow, convergence_rows, thickness_rows


def test_every_polygon_has_its_exact_thickness() -> None:
    rows = thickness_rows()
    assert len(rows) > 20
    assert [row for row in rows if not row.holds] == []
    assert not ThicknessRow("off by a millionth", 3, 1.0, 1.000001).holds
    assert not ThicknessRow("not a number", 3, 1.0, float("nan")).holds


@pytest.mark.slow
def test_sampled_curves_converge_at_the_order_of_the_sampling() -> None:
    rows = convergence_rows()
    assert [row for row in rows if not row.holds] == []
    assert {row.expected for row in rows} == {1, 2}
    assert all(np.diff(row.relative_errors).max() < 0 for row in rows)
