"""The table of knots against its braids, and the names by which a knot may be promised."""

import pytest

from knotfab_formats.knots import BRAIDS, parse_knot_name
from knotfab_validators.knots.invariants import UNKNOT, invariants
from knotfab_validators.knots.names import (
    Factor,
    asked_knot,
    braid_word,
    candidates,
    is_amphichiral,
    known_knot,
    prime_names,
    promised_knot,
)
from knotfab_validators.knots.planar_diagram import closed_braid


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


# The table of knots: complete, with the invariants of its braids, and recognised from them.


# Determinants in Rolfsen's table up to 8 crossings, as printed there.
DETERMINANTS = {
    3: (3,), 4: (5,), 5: (5, 7), 6: (9, 11, 13), 7: (7, 11, 13, 15, 17, 19, 21),
    8: (13, 17, 17, 19, 21, 23, 23, 25, 25, 27, 27, 29, 29, 31, 33, 35, 37, 45, 3, 9, 15),
}  # fmt: skip


# KnotInfo has these braids; most are other words than the table's.
ELSEWHERE = {
    "5_2": (1, 1, 1, 2, -1, 2), "6_1": (1, 1, 2, -1, -3, 2, -3), "6_2": (1, 1, 1, -2, 1, -2),
    "7_4": (1, 1, 2, -1, 2, 2, 3, -2, 3), "7_7": (-1, 2, -1, 2, -3, 2, -3),
    "8_3": (1, 1, 2, -1, -3, 2, -3, -4, 3, -4), "8_8": (-1, -1, -1, -2, 1, 3, -2, 3, 3),
    "8_17": (1, 1, -2, 1, -2, 1, -2, -2), "8_20": (1, 1, 1, -2, -1, -1, -1, -2),
    "8_21": (1, 1, 1, 2, -1, -1, 2, 2), "9_35": (1, 1, 2, -1, 2, 2, 3, -2, -2, 4, -3, 2, 4, 3),
    "9_42": (-1, -1, -1, 2, 1, 1, -3, 2, -3), "10_67": (1, 1, 1, 3, -4, 2, 3, -4, -2, -2, 3, 2, -1, 2),
    "10_104": (-1, -1, -1, 2, 2, -1, 2, -1, 2, 2), "10_112": (-1, -1, -1, 2, -1, 2, -1, 2, -1, 2),
    "10_161": (1, 1, 1, 2, -1, 2, 1, 1, 2, 2), "10_162": (-1, -1, -2, 1, 1, -2, -2, -1, 3, -2, 3),
    "10_165": (-1, -1, -2, 1, 3, -2, 1, -2, -3, -3, -2),
}  # fmt: skip


TWINS = [
    {"8_8", "10_129"},
    {"8_16", "10_156"},
    {"9_12", "4_1#5_2"},
    {"10_25", "10_56"},
    {"10_40", "10_103"},
]


NO_HAND = {"10_48", "10_71", "10_91", "10_104"}  # chiral, and no invariant here sees it


def factor(name: str, hand: int = 1) -> Factor:
    crossings, number = map(int, name.split("_"))
    return Factor(crossings, number, 0 if is_amphichiral(name) else hand)


def test_the_table_is_complete() -> None:
    counts = [sum(name.startswith(f"{n}_") for name in prime_names()) for n in range(3, 11)]
    assert counts == [1, 1, 2, 3, 7, 21, 49, 165]  # OEIS A002863
    found = [
        sum(name.startswith(f"{n}_") and is_amphichiral(name) for name in prime_names())
        for n in (4, 6, 8, 10)
    ]
    assert found == [1, 1, 5, 13]  # OEIS A052401


MORE = [pytest.param(n, 1, marks=pytest.mark.study) for n in (9, 10)]


@pytest.mark.parametrize(
    ("crossings", "every"), [*((n, 1) for n in range(3, 9)), (9, 5), (10, 11), *MORE]
)
def test_the_invariants_are_those_of_the_braids(crossings: int, every: int) -> None:
    """So Alexander polynomial and Floer homology agree for all of them, too."""
    for name in [n for n in prime_names() if n.startswith(f"{crossings}_")][::every]:
        found = invariants(closed_braid(braid_word(name)))
        known = known_knot((factor(name),)).invariants
        assert found == known, name
        mirror = invariants(closed_braid([-k for k in braid_word(name)]))
        assert mirror == known.mirror() == known_knot((factor(name, -1),)).invariants or (
            is_amphichiral(name) and mirror == known
        )
        assert known.hand == (0 if is_amphichiral(name) or name in NO_HAND else 1)
        assert (mirror == known) == (is_amphichiral(name) or name in NO_HAND)


def test_determinants_are_those_of_rolfsens_table() -> None:
    for crossings, values in DETERMINANTS.items():
        for number, value in enumerate(values, start=1):
            knot = known_knot((factor(f"{crossings}_{number}"),))
            assert knot.invariants.determinant == value


@pytest.mark.parametrize("name", ELSEWHERE)
def test_braids_from_elsewhere_are_recognised(name: str) -> None:
    found = invariants(closed_braid(ELSEWHERE[name]))
    names = {x.name for knot in candidates(found) for x in knot.factors}
    assert name in names and len({len(k.factors) for k in candidates(found)}) == 1


def test_few_knots_of_ten_crossings_are_not_told_apart() -> None:
    pairs = set()
    singles = [(factor(name),) for name in prime_names()]
    for factors in [*singles, (factor("4_1"), factor("5_2"))]:
        knots = candidates(known_knot(factors).invariants)
        names = {knot.name for knot in knots if knot.crossings <= 10}
        assert known_knot(factors).name in names
        if len(names) > 1:
            pairs.add(frozenset(names))
    twins = {frozenset(f"right-handed {name}" for name in pair) for pair in TWINS}
    both = {frozenset({f"right-handed {name}", f"left-handed {name}"}) for name in NO_HAND}
    assert pairs == twins | both


def test_candidates() -> None:
    assert [knot.name for knot in candidates(UNKNOT)] == ["unknot"]
    square = known_knot((factor("3_1"), factor("3_1", -1)))
    assert [knot.name for knot in candidates(square.invariants)] == ["3_1#m3_1"]
    eight = known_knot((factor("8_20"),))  # with the Alexander polynomial of the square
    assert eight.invariants.alexander == square.invariants.alexander
    assert [knot.name for knot in candidates(eight.invariants)] == ["right-handed 8_20"]
    nine = invariants(closed_braid([1] * 9 + [-2] * 3))
    assert [knot.name for knot in candidates(nine)] == ["m3_1#9_1"]


def test_known_sums_have_names() -> None:
    factors = (Factor(3, 1, -1), Factor(4, 1, 0), Factor(5, 2, 1))
    assert known_knot(factors).name == "m3_1#4_1#5_2"
    assert known_knot(factors).mirror().name == "3_1#4_1#m5_2"
