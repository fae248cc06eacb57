"""Knots by name are the knots that they are called, and every name says which knot it means."""

from __future__ import annotations

import numpy as np
import pytest
from knot_judge import judge_type

from knotfab.geometry.measures import bend_radii, strand_gap
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Limits
from knotfab.start.tie import load_knot
from knotfab_formats.errors import InputError
from knotfab_formats.knots import BRAIDS, parse_knot_name
from knotfab_formats.scene import SettledRegion
from knotfab_validators.knots.names import promised_knot
from paper.curves import closed_braid

UNIT = Limits(1.0, 0.0, 1.0, np.inf, SettledRegion(size_mm=(1e5, 1e5, 1e5)))


@pytest.mark.slow
@pytest.mark.parametrize("name", BRAIDS)
def test_every_named_knot_is_that_knot_and_fits_its_tube(name: str) -> None:
    points = load_knot(name)
    rings = polylines_of_sizes((len(points),))
    assert strand_gap(points, rings, UNIT.separation, 4.0).gap > 2.0
    assert bend_radii(points, rings).min() > 0.95
    sentence, verdict = judge_type(points, promise=parse_knot_name(name).promise)
    assert verdict in ("proved", "consistent"), sentence
    # the braid is of the same knot, by the same check
    assert judge_type(closed_braid(BRAIDS[name])[0], promise=parse_knot_name(name).promise)[
        1
    ] == verdict or (verdict == "consistent" or name in ("8_8", "8_16"))


@pytest.mark.parametrize("name", ["3_1", "5_2", "7_4", "8_19", "8_20"])
def test_a_mirrored_knot_is_left_handed(name: str) -> None:
    points = load_knot(name, mirrored=True)
    assert judge_type(points, promise=f"left-handed {name}")[1] in ("proved", "consistent")
    assert judge_type(points, promise=f"right-handed {name}")[1] == "refuted"


@pytest.mark.parametrize(
    ("asked", "promise"),
    [
        ("unknot", "unknot"),
        ("0_1", "unknot"),
        ("Trefoil", "right-handed 3_1"),
        ("left trefoil", "left-handed 3_1"),
        ("left-handed trefoil knot", "left-handed 3_1"),
        ("m3_1", "left-handed 3_1"),
        ("left figure-eight", "4_1"),
        ("T(3, 4)", "right-handed 8_19"),
        ("granny", "right-handed 3_1#3_1"),
        ("square", "3_1#m3_1"),
        ("4_1#m5_2", "left-handed 4_1#5_2"),
        ("right 6_3", "6_3"),
    ],
)
def test_names(asked: str, promise: str) -> None:
    name = parse_knot_name(asked)
    assert name.promise == promise
    assert promised_knot(name.promise).meant, "the validator understands it"
    assert len(promised_knot(name.promise).meant) == 1, "and it is one knot, of one hand"


@pytest.mark.parametrize(
    "asked", ["3_2", "9_1", "cat", "3_1#", "m", "left", "#", "3_1#" * 7 + "3_1"]
)
def test_unknown_names_say_what_is_known(asked: str) -> None:
    with pytest.raises(InputError) as error:
        parse_knot_name(asked)
    assert error.value.exit_code == 2
    assert "8_19" in str(error.value) or "at most" in str(error.value)
