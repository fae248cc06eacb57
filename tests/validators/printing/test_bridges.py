"""Bridges and ledges of known length."""

import pytest
from printed_solids import BARE, PRINTER, leaning, run
from solids import blocks, bridge


@pytest.mark.parametrize("width", [3.0, 60.0])
def test_a_bridge_is_as_long_as_its_span(width: float) -> None:
    found = run(bridge(10.0, width), BARE)
    assert found["bridge"].measured == pytest.approx(10.0, abs=1e-9)
    assert found["bridge"].status == found["overhang"].status == "pass"
    assert found["islands"].measured == 0
    less = run(bridge(10.0, width), BARE.model_copy(update={"max_bridge_mm": 9.99}))
    assert less["bridge"].status == less["overhang"].status == "fail"
    assert less["overhang"].measured == pytest.approx(10 * width / 100, rel=1e-9)
    x, y, z = less["bridge"].at[0]
    assert 9 < x < 11 and 0 < y < width and z == pytest.approx(10.0)
    assert (
        run(bridge(10.0, width), PRINTER.model_copy(update={"max_bridge_mm": 1.0}))["bridge"].status
        == "pass"
    )


def test_a_ledge_counts_twice_and_is_no_bridge() -> None:
    ledge = blocks([0, 10, 14], [0, 20], [0, 10, 12], [[[1, 1]], [[0, 1]]])
    found = run(ledge, BARE)
    assert found["bridge"].measured == pytest.approx(8.0, abs=1e-9)
    assert found["bridge"].status == "pass" and found["overhang"].status == "fail"
    assert run(ledge, BARE.model_copy(update={"max_bridge_mm": 7.9}))["bridge"].status == "fail"


def test_a_slope_that_holds_itself_is_no_long_ledge() -> None:
    assert run(leaning(45.0), BARE)["bridge"].measured <= 1.0
