"""The table of knots against its braids, and the names by which a knot may be promised."""

import pytest

from knotfab_formats.knot_names import BRAIDS, parse_knot_name
from knotfab_validators.knots.names import asked_knot, promised_knot


@pytest.mark.parametrize(
    ("promise", "names"),
    [
        ("unknot", {"unknot"}),
        ("0_1", {"unknot"}),
        ("Trivial knot", {"unknot"}),
        ("T(1, 7)", {"unknot"}),
        ("unknot#unknot", {"unknot"}),
        ("trefoil", {"right-handed 3_1", "left-handed 3_1"}),
        ("3_1", {"right-handed 3_1", "left-handed 3_1"}),
        ("right-handed trefoil", {"right-handed 3_1"}),
        ("Left-handed  3_1", {"left-handed 3_1"}),
        ("m3_1", {"left-handed 3_1"}),
        ("right-handed m3_1", {"right-handed 3_1"}),
        ("T(2,3)", {"right-handed 3_1", "left-handed 3_1"}),
        ("T(-2,3)", {"left-handed 3_1"}),
        ("T(4,3)", {"right-handed 8_19", "left-handed 8_19"}),
        ("right-handed T(3,7)", {"T(3,7)"}),
        ("T(3,7)", {"T(3,7)", "T(3,-7)"}),
        ("T(3,-7)", {"T(3,-7)"}),
        ("left-handed T(3,7)", {"T(3,-7)"}),
        ("figure-eight knot", {"4_1"}),
        ("left-handed 4_1", {"4_1"}),
        ("m4_1", {"4_1"}),
        ("granny", {"right-handed 3_1#3_1", "left-handed 3_1#3_1"}),
        ("m3_1 # m3_1", {"left-handed 3_1#3_1"}),
        ("square knot", {"3_1#m3_1"}),
        ("m3_1#3_1", {"3_1#m3_1"}),
        ("trefoil#figure-eight", {"right-handed 3_1#4_1", "left-handed 3_1#4_1"}),
        ("3_1#m5_2", {"3_1#m5_2", "m3_1#5_2"}),
        ("right-handed 3_1#m5_2", {"3_1#m5_2"}),
        ("left-handed 3_1#m5_2", {"m3_1#5_2"}),
        ("10_48", {"right-handed 10_48", "left-handed 10_48"}),
    ],
)
def test_names_that_are_understood(promise: str, names: set[str]) -> None:
    found = promised_knot(promise)
    assert {knot.name for knot in found.meant} == names and found.given
    assert found.unknot == (names == {"unknot"})


@pytest.mark.parametrize(
    "promise",
    [
        "12n_242",
        "9_50",
        "3_1#",
        "T(2,4)",
        "T(0,1)",
        "T(20,31)",
        "knot",
        "mm3_1",
        "#".join(["3_1"] * 13),
        "m" * 9999,
    ],
)
def test_names_that_are_not_understood(promise: str) -> None:
    found = promised_knot(promise)
    assert found.given and not found.meant and not found.unknot


@pytest.mark.parametrize("promise", ["", " ", "unknown", "Unknown", "?"])
def test_nothing_promised(promise: str) -> None:
    assert not promised_knot(promise).given


def test_torus_knots_beyond_the_table_have_hands() -> None:
    (right,) = promised_knot("right-handed T(3,7)").meant
    assert right.invariants.signature == -8 and right.invariants.hand == 1
    assert right.mirror().mirror() == right


@pytest.mark.parametrize(
    "asked",
    [
        *("", "Trivial", "0_1", "3_{1}", "trefoil", "left trefoil", "Right-handed  3_1", "m3_1"),
        *("left m3_1", "T( 2, 5 )", "left t(3,4)", "figure eight knot", "left 3_1#m5_2"),
        *("square", "left granny", "3_1 # 4_1", "stevedore"),
        *(f"{hand}{name}" for name in BRAIDS for hand in ("", "left ")),
    ],
)
def test_a_scene_may_ask_for_all_that_the_maker_ties(asked: str) -> None:
    """What the maker writes of it into knots.json is among what is meant."""
    made = {knot.name for knot in promised_knot(parse_knot_name(asked).promise).meant}
    assert made and made <= {knot.name for knot in asked_knot(asked).meant}


def test_a_hand_that_a_scene_asks_for_excludes_the_other() -> None:
    assert [knot.name for knot in asked_knot("left trefoil").meant] == ["left-handed 3_1"]
    assert [knot.name for knot in asked_knot("right 5_2").meant] == ["right-handed 5_2"]
    assert asked_knot("clover").meant == ()
