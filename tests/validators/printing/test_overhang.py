"""Overhangs and the support under them, of solids whose numbers are known."""

import numpy as np
import pytest
from printed_solids import BARE, PRINTER, leaning, run
from scipy.spatial.transform import Rotation
from solids import box, move, table, together

from knotfab_validators.printing.overhang import above


@pytest.mark.parametrize("level", [-1.0, 0.0, 0.3, 0.6, 1.1, 2.0, 3.0])
def test_the_share_of_a_triangle_above_a_level(level: float) -> None:
    samples = np.random.default_rng(0).dirichlet([1, 1, 1], 200_000) @ [0.0, 0.6, 2.0]
    share = above(np.array([[0.6, 2.0, 0.0]]), level)[0]
    assert share == pytest.approx((samples > level).mean(), abs=0.005)


def test_the_share_of_level_edges_is_exact() -> None:
    z = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    assert above(z, 0.5).tolist() == [0.75, 0.25, 1.0]


def test_the_overhang_begins_beyond_the_limit() -> None:
    assert run(leaning(45.0), BARE)["overhang"].measured == 0.0
    assert run(leaning(45.0), BARE)["overhang"].status == "pass"
    found = run(leaning(45.2), BARE)["overhang"]
    # all of the underside but what belongs to the first layer
    area = 20 * (10 - 0.201) / np.cos(np.radians(45.2)) / 100
    assert found.status == "fail" and found.measured == pytest.approx(area, rel=1e-6)
    assert (
        run(leaning(45.2), BARE.model_copy(update={"max_overhang_deg": 45.2}))["overhang"].status
        == "pass"
    )
    assert run(leaning(45.2))["overhang"].required is False


def test_a_table_needs_a_box_of_support() -> None:
    found = run(table())
    assert found["overhang"].measured == pytest.approx(3.84, rel=1e-9)
    assert (found["overhang"].status, found["overhang"].limit) == ("pass", None)
    assert found["support_volume"].measured == pytest.approx(3.84, rel=1e-9)
    fits = PRINTER.model_copy(update={"max_support_cm3": 3.8400001})
    assert run(table(), fits)["support_volume"].status == "pass"
    tight = run(table(), fits.model_copy(update={"max_support_cm3": 3.839}))["support_volume"]
    assert (tight.status, tight.required) == ("fail", True)
    assert (
        run(table(), BARE.model_copy(update={"max_support_cm3": 1.0}))["support_volume"].required
        is False
    )


def test_support_stands_on_the_surface_below() -> None:
    plate = box((-10, -10, 0), (30, 30, 4))
    legless = move(table(), shift=(0, 0, 0))
    found = run(together(plate, move(legless, shift=(0, 0, 5))))["support_volume"]
    # the leg's own underside hangs 1 mm above the plate, the top 11 mm
    assert found.measured == pytest.approx((16 * 1 + 384 * 11) / 1000, rel=0.02)


def test_a_slope_off_the_grid_is_supported_within_its_error() -> None:
    found = run(move(leaning(60.0), Rotation.from_euler("z", 0.3).as_matrix(), (10, 5, 0)))
    shift = 10 * np.tan(np.radians(60))
    assert found["support_volume"].measured == pytest.approx(shift * 10 / 2 * 20 / 1000, rel=0.02)
