"""Knot types: proofs on curves whose type is known, and promises that must be refuted."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from knot_curves import (
    WHITEHEAD,
    Array,
    borromean,
    braid,
    coil,
    curves,
    figure_eight,
    filling,
    mirror,
    move_randomly,
    random_markov,
    ring,
    rotate,
    seen_from_a_lamp,
    torus_knot,
    zigzag,
)
from tables import some

from knotfab_formats.verdict import Check
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.identity import Identity, identify
from knotfab_validators.knots.invariants import Floer
from knotfab_validators.knots.knot_types import knot_checks, knot_types
from knotfab_validators.knots.names import (
    Factor,
    braid_of,
    braid_word,
    is_amphichiral,
    known_knot,
    prime_names,
)
from knotfab_validators.knots.reduction import Budget, reduce_polygons
from knotfab_validators.validate import validate

SMALL = [name for name in prime_names() if int(name.split("_")[0]) <= 8]
LARGE = ["9_35", "9_42", "10_48", "10_132", "10_139", "10_161", "10_165"]
ALWAYS = {"3_1", "6_3", "8_19", "9_42", "10_161"}  # 6_3 is amphichiral, 8_19 not alternating
TABLE = [pytest.param(n, marks=() if n in ALWAYS else pytest.mark.study) for n in SMALL + LARGE]
pytestmark = pytest.mark.usefixtures("brief")


def check_knot_type(found: Curves) -> Check:
    return knot_checks(found)[0]


def check_linking(found: Curves) -> Check:
    return knot_checks(found)[1]


def found_of(polygon: Array, kind: str = "unknown") -> Check:
    return check_knot_type(curves(polygon, types=(kind,)))


Shape = str | Sequence[int] | Callable[[], Array]  # a knot of the table, a braid, or what makes it


def polygon_of(shape: Shape) -> Array:
    if callable(shape):
        return shape()
    return braid(braid_word(shape) if isinstance(shape, str) else shape)[0]


# --- proofs ---------------------------------------------------------------------------------


UNKNOTS: list[Shape] = [
    *(partial(ring, n) for n in (3, 4, 5, 100)),  # flat, however they lie
    *((lambda seed=seed: filling(4000, seed)) for seed in range(3)),  # no axis shows it
    *((lambda seed=seed: seen_from_a_lamp(filling(4000, seed))) for seed in range(3)),
    lambda: coil((0, 0, 11), (5, 0, 5), (0, 0, -1)),  # closed beside its axis
    lambda: coil((0, 0, 11), (0, 0, -1)),  # closed along it
    *(tuple(random_markov([1, -2, 3], 80, seed)) for seed in range(8)),
]


@pytest.mark.parametrize("number", range(len(UNKNOTS)))
def test_an_unknot_is_proved_however_it_lies(number: int) -> None:
    found = check_knot_type(curves(rotate(polygon_of(UNKNOTS[number]), number)))
    assert (found.status, found.measured, found.limit) == ("pass", "unknot, proved", "unknot")


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(range(4), 4))
def test_what_random_moves_tangle_is_told(seed: int) -> None:
    tangled = move_randomly(ring(60, 2.0), 20, seed)
    assert found_of(tangled, "unknot").measured == "unknot, proved"
    trefoil = move_randomly(braid((1, 1, 1))[0] / 2, 20, seed)
    assert found_of(trefoil, "unknot").measured == "right-handed 3_1, proved"


def test_the_reduction_alone_suffices_where_a_projection_would() -> None:
    assert reduce_polygons([filling(1500, 7)]).vertices == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(range(3), 3))
def test_rejects_a_small_trefoil_tied_into_a_big_tangle(seed: int) -> None:
    """A knot replaces one stretch of some 4000 vertices, on the comb's free side."""
    tangle = filling(4000, seed)
    stretch = np.flatnonzero((tangle[:, 0] == 0) & (np.abs(tangle[:, 1] - 46) < 3))
    t = np.linspace(-2.1, 2.1, 60)
    along, aside, up = t**3 - 3 * t, t**4 - 4 * t**2, t**5 / 5 - 2 * t  # an open trefoil
    middle = tangle[stretch].mean(axis=0)
    knot = middle + np.column_stack([0.5 * (aside - 2), -0.8 * along, 0.3 * up])
    tied = np.concatenate([tangle[: stretch[0]], knot, tangle[stretch[-1] + 1 :]])
    found = check_knot_type(curves(rotate(tied, seed)))
    assert found.status == "fail" and str(found.measured).endswith("handed 3_1, proved")
    near = np.linalg.norm(rotate(knot, seed)[:, None] - np.array(found.at), axis=2).min()
    assert near < 1e-3
    assert check_knot_type(curves(rotate(tied, seed), types=("3_1",))).status == "pass"
    assert check_knot_type(curves(rotate(tangle, seed))).status == "pass"


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLE)
def test_knots_of_the_table_are_recognised_with_their_hands(name: str) -> None:
    (polygon,) = braid(braid_word(name))
    even = is_amphichiral(name)
    right, left = (name, name) if even else (f"right-handed {name}", f"left-handed {name}")
    for seed, (shape, expected) in enumerate([(polygon, right), (mirror(polygon), left)]):
        for copy in (rotate(shape, seed), zigzag(rotate(shape, seed + 5), 4, seed)):
            found = found_of(copy)
            assert found.status == "pass" and found.limit is None
            assert found.measured == f"{expected}, proved"
        assert found_of(shape, name).status == "pass"
        other = "left-handed" if seed == 0 else "right-handed"
        wrong = found_of(shape, f"{other} {name}")
        assert wrong.status == ("pass" if even else "fail")


TREFOIL, LEFT, GRANNY, SQUARE = (1,) * 3, (-1,) * 3, (1, 1, 1, 2, 2, 2), (1, 1, 1, -2, -2, -2)
TWENTY = (1, 1, 1, -2, -1, -1, -1, -2)  # 8_20, with the Alexander polynomial of the square knot
EIGHT = (-1, -1, -1, -2, 1, 3, -2, 3, 3)  # 8_8, with the invariants of 10_129
SEVEN, THIRTEEN = (-1, -2) * 7, (1,) * 13  # T(3,-7) and T(2,13)
SUM = braid_of(known_knot((Factor(6, 2, 1), Factor(6, 3, 0))))  # beyond the table
TRIPLE = braid_of(known_knot((Factor(3, 1, -1), Factor(3, 1, 1), Factor(7, 4, 1))))  # 13 crossings
DEAR = (SEVEN, THIRTEEN, SUM)  # seconds each
FIBRED, FIVE, FALLS = "genus 1 and fibred", "Floer homology of T(2,5)", "a diagram of {} crossings"
ALONE = "and no other knot of so few has its invariants"
BY_PSL = "nor its representations in PSL(2, p)"
# curve, what is promised of it, and the check's status, measure and reason
JUDGED: list[tuple[Shape, str, str, str, str]] = [
    (TREFOIL, "unknown", "pass", "right-handed 3_1, proved", FIBRED),
    (LEFT, "unknown", "pass", "left-handed 3_1, proved", FIBRED),
    (LEFT, "", "pass", "left-handed 3_1, proved", FIBRED),
    (LEFT, "?", "pass", "left-handed 3_1, proved", FIBRED),
    ((1, -2, 1, -2), "unknown", "pass", "4_1, proved", FIBRED),
    ((1,) * 5, "unknown", "pass", "right-handed 5_1, proved", FIVE),
    ((-1,) * 5, "unknown", "pass", "left-handed 5_1, proved", FIVE),
    (GRANNY, "unknown", "pass", "right-handed 3_1#3_1, proved", FALLS.format(6)),
    ((*LEFT, -2, -2, -2), "unknown", "pass", "left-handed 3_1#3_1, proved", FALLS.format(6)),
    (SQUARE, "unknown", "pass", "3_1#m3_1, proved", FALLS.format(6)),
    ((1, 1, 1, -2, 3, -2, 3), "unknown", "pass", "right-handed 3_1#4_1, proved", FALLS.format(7)),
    (EIGHT, "8_8", "pass", "left-handed 8_8, proved", ALONE),
    ("10_129", "10_129", "pass", "right-handed 10_129, proved", BY_PSL),
    ("10_156", "right-handed 10_156", "pass", "right-handed 10_156, proved", BY_PSL),
    ("10_103", "right-handed 10_103", "pass", "right-handed 10_103, proved", BY_PSL),
    ("10_91", "right-handed 10_91", "pass", "right-handed 10_91, proved", BY_PSL),
    (SUM, "6_2#6_3", "pass", "right-handed 6_2#6_3, proved", "summands, each proved"),
    (TRIPLE, "3_1#m3_1#7_4", "pass", "3_1#m3_1#7_4, proved", "summands, each proved"),
    (TRIPLE, "3_1#3_1#7_4", "fail", "3_1#m3_1#7_4, proved", ""),
    (SEVEN, "T(3,-7)", "pass", "T(3,-7), consistent", ""),
    (SEVEN, "unknown", "pass", "not a knot of the table (determinant 1)", ""),
    (LEFT, "12n_242", "skipped", "left-handed 3_1, proved", "is not understood"),
    # promises that must be refuted, by hand and among twins
    (LEFT, "unknot", "fail", "left-handed 3_1, proved", ""),
    ((1, -2, 1, -2), "unknot", "fail", "4_1, proved", ""),
    ((1,) * 5, "unknot", "fail", "right-handed 5_1, proved", ""),
    (ring, "trefoil", "fail", "unknot, proved", ""),
    ((1, -2, 1, -2), "trefoil", "fail", "4_1, proved", ""),
    (LEFT, "right-handed trefoil", "fail", "left-handed 3_1, proved", ""),
    (TREFOIL, "left-handed trefoil", "fail", "right-handed 3_1, proved", ""),
    (TREFOIL, "m3_1", "fail", "right-handed 3_1, proved", ""),
    (GRANNY, "square", "fail", "right-handed 3_1#3_1, proved", ""),
    (GRANNY, "m3_1#m3_1", "fail", "right-handed 3_1#3_1, proved", ""),
    (SQUARE, "granny", "fail", "3_1#m3_1, proved", ""),
    (SQUARE, "8_20", "fail", "3_1#m3_1, proved", ""),
    (TWENTY, "3_1#m3_1", "fail", "left-handed 8_20, proved", ""),
    (TWENTY, "right-handed 8_20", "fail", "left-handed 8_20, proved", ""),
    ((1, -2, 1, -2), "5_1", "fail", "4_1, proved", ""),
    ("10_132", "5_1", "fail", "right-handed 10_132, proved", ""),  # the same polynomials
    (EIGHT, "10_129", "fail", "left-handed 8_8, proved", ""),
    ("10_129", "8_8", "fail", "right-handed 10_129, proved", ""),
    ("10_156", "8_16", "fail", "right-handed 10_156, proved", ""),
    ("10_103", "10_40", "fail", "right-handed 10_103, proved", ""),
    ("10_91", "left-handed 10_91", "fail", "right-handed 10_91, proved", ""),
    (SUM, "m6_2#6_3", "fail", "right-handed 6_2#6_3, proved", ""),
    (SEVEN, "right-handed T(3,7)", "fail", "not a right-handed T(3,7)", ""),
    (THIRTEEN, "unknot", "fail", "not an unknot", ""),
    (THIRTEEN, "9_1", "fail", "not a 9_1", ""),
]


@pytest.fixture
def once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Identify a curve once for all that is promised of it."""
    kept: dict[bytes, Identity] = {}

    def identify_once(polygon: Array, budget: Budget) -> Identity:
        return kept.get(polygon.tobytes()) or kept.setdefault(
            polygon.tobytes(), identify(polygon, budget)
        )

    monkeypatch.setattr("knotfab_validators.knots.knot_types.identify", identify_once)


@pytest.mark.usefixtures("once")
@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(shape, marks=[pytest.mark.slow] * (shape in DEAR))
        for shape in dict.fromkeys(row[0] for row in JUDGED)
    ],
)
def test_what_is_proved_of_a_curve_and_its_promises(shape: Shape) -> None:
    polygon = rotate(polygon_of(shape), 2)
    for promise, status, measured, why in (row[1:] for row in JUDGED if row[0] == shape):
        found = found_of(polygon, promise)
        assert found.name == "knot_type"
        assert (promise, found.status, found.measured) == (promise, status, measured)
        assert why in found.detail and (shape is ring or "Jones" in found.detail)
        assert found.limit == (None if promise in ("unknown", "", "?") else promise)
        assert found.required == (status != "skipped")
        assert (f"promised as {promise}" in found.detail) == (status == "fail")
        assert bool(found.at) == (status == "fail" and shape is not ring) and len(found.at) <= 20
        for place in found.at:
            assert np.linalg.norm(polygon - np.array(place), axis=1).min() < 1e-3


# --- links ------------------------------------------------------------------------------------


APART, LINKED = "all are apart from each other, proved", "knots 0 and 1 are linked, proved"
HALVES = [rotate(filling(1000, 1), 2), rotate(filling(1000, 2) + np.array([0, 0, 60.0]), 2)]
# curves, the check's measure and what it says; a number of 0 alone passes
LINKS: dict[str, tuple[Callable[[], list[Array]], object, str]] = {
    "Hopf": (lambda: braid((1, 1)), 1.0, "knots 0 and 1 are linked, number +1"),
    "twice, left": (lambda: braid((-1,) * 4), 2.0, "number -2"),
    "Whitehead": (lambda: braid(WHITEHEAD), "linked, with linking number 0", LINKED),
    # a ring beside a Whitehead link makes its Alexander polynomial 0; Jones tells it
    "Whitehead and a ring": (
        lambda: [*braid(WHITEHEAD), ring(40, 3.0) + [12.0, 0, 0]],
        "linked, with linking number 0",
        LINKED,
    ),
    "Borromean": (
        borromean,
        "linked, with linking number 0",
        "knots 0 and 1 and 2 are linked, proved",
    ),
    "one curve": (lambda: [ring()], 0.0, "there is only one closed curve"),
    "rings": (lambda: [ring(), rotate(ring(), 1) + [3.0, 0, 0], ring() * 0.5], 0.0, APART),
    "combs": (lambda: [HALVES[0], HALVES[1] + [0.13, 0.17, 300]], 0.0, APART),
    "knots": (
        lambda: [torus_knot(2, 3), torus_knot(2, 5) + [9.0, 0, 0], figure_eight() + [0, 9.0, 0]],
        0.0,
        APART,
    ),
    # braids whose closures are unlinks in disguise
    "cancelled": (lambda: braid(random_markov([2, -2], 0, 0)), 0.0, APART),
    "disguised": (lambda: braid([1, 1, -1, 2, -1, 1, -2, -1]), 0.0, APART),
}


@pytest.mark.parametrize("name", LINKS)
def test_what_is_linked_and_what_is_apart(name: str) -> None:
    make, measured, said = LINKS[name]
    for seed in range(2):
        types, found = knot_checks(curves(*[rotate(one, seed) for one in make()]))
        assert (found.name, found.required, found.limit) == ("linking", True, 0.0)
        assert (found.status, found.measured) == ("fail" if measured else "pass", measured)
        assert said in found.detail and len(found.at) == bool(measured)
        assert (types.measured == "unknot, proved") == (name != "knots")


def test_the_nearest_places_of_linked_rings() -> None:
    one = ring(200, 10.0)
    other = ring(200, 10.0)[:, [0, 2, 1]] + [19.5, 0, 0]  # through (9.5, 0, 0)
    found = check_linking(curves(one, other, ring() + [0, 0, 50.0]))
    assert found.detail.startswith("knots 0 and 1 are linked")
    assert found.at == (pytest.approx((9.75, 0, 0), abs=0.01),)


def test_a_link_that_cannot_be_told_is_skipped_and_required(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for limit in ("MOST_SEEN", "MOST_COUNTED", "MOST_CROSSINGS"):
        monkeypatch.setattr(f"knotfab_validators.knots.identity.{limit}", 50)
    one, other = np.random.default_rng(0).normal(size=(2, 100, 3))
    kind, linking = knot_checks(curves(one, other))
    assert kind.status == "skipped" and kind.required and "too many crossings" in kind.detail
    assert linking.status == "skipped" and linking.required and linking.measured is None


# --- what cannot be told ----------------------------------------------------------------------


PROMISES = {  # what knots.json promises of a trefoil: status, and whether curves alone must keep it
    "unknot": ("fail", True),
    "trefoyl": ("fail", True),
    "left-handed 3_1": ("pass", False),
    "12n_242": ("skipped", False),
    "unknown": ("pass", False),
    "": ("fail", False),  # taken for an unknot, but nobody promised it
}


@pytest.mark.parametrize("promise", PROMISES)
def test_curves_alone_keep_what_their_file_promises(promise: str, tmp_path: Path) -> None:
    status, required = PROMISES[promise]
    knot = {"closed": True, "type": promise, "points": torus_knot(2, 3).tolist()}
    held = {"schema": 1, "unit": "mm", "knots": [knot]}
    (tmp_path / "knots.json").write_text(json.dumps(held))
    verdict = validate(None, tmp_path / "knots.json")
    (kind,) = (check for check in verdict.checks if check.name == "knot_type")
    assert (kind.status, kind.required) == (status, required)
    assert verdict.exit_code == (1 if required else 0)


def test_open_curves_are_left_out() -> None:
    line = ring()[:40] * 3
    mixed = Curves(
        (line, torus_knot(2, 3), ring() + 9), ("unknot", "3_1", "unknot"), (False, True, True), 1.0
    )
    kind, linking = knot_checks(mixed)
    assert kind.status == "pass" and kind.measured == "left-handed 3_1, proved, unknot, proved"
    assert "knot 1: left-handed 3_1" in kind.detail
    for found in (kind, linking):
        assert "open curves have no type and are left out: 0" in found.detail
    hopf = replace(
        mixed,
        polygons=(line, ring(200), ring(200)[:, [0, 2, 1]] + [1.0, 0, 0]),
        types=("unknot",) * 3,
    )
    assert check_linking(hopf).detail.startswith("knots 1 and 2 are linked")
    alone = Curves((line,), ("unknot",), (False,), 1.0)
    assert [c.status for c in knot_checks(alone)] == ["skipped", "skipped"]
    assert not knot_checks(alone)[0].required and knot_types(alone).knots == ()


@pytest.mark.slow
@pytest.mark.usefixtures("once")
def test_large_knots_end_in_time_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    steps = rng.normal(size=(6_000, 3))
    walk = np.cumsum(steps - steps.mean(axis=0), axis=0)
    found = found_of(walk)
    assert found.status == "skipped" and not found.required
    assert found.detail.startswith("not found (too many crossings left")
    promised = found_of(walk, "unknot")  # refuted all the same, by its determinant modulo a prime
    assert promised.status == "fail" and promised.measured == "not an unknot"
    few = partial(Budget, 1000)
    monkeypatch.setattr("knotfab_validators.knots.reduction.Budget", few)
    hopeless = found_of(rng.normal(size=(500, 3)), "unknot")
    assert hopeless.status == "skipped" and hopeless.required
    assert hopeless.detail == "not found: too tangled"


def test_polygons_that_touch_say_where() -> None:
    cross = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    touching = ring(100) + np.array([2.0, 0, 0])  # vertices of both at (1, 0, 0)
    for polygons, at in (((cross, ring() + 9), (1, 1, 0)), ((ring(100), touching), (1, 0, 0))):
        for found in knot_checks(curves(*polygons)):
            assert found.status == "fail" and found.required
            assert found.at[0] == pytest.approx(at, abs=1e-6)


def test_methods_that_disagree_fail_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Floer((((-1, -1), 1), ((0, 0), 3), ((1, 1), 1)))
    monkeypatch.setattr("knotfab_validators.knots.invariants.floer_homology", lambda *_: wrong)
    for kind in ("3_1", "unknown"):
        found = found_of(torus_knot(2, 3), kind)
        assert (found.status, found.measured) == ("fail", "not found")
        assert "the two methods disagree" in found.detail


@pytest.mark.slow
def test_without_floer_homology_names_stay_consistent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("knotfab_validators.knots.invariants.floer_homology", lambda *_: None)
    found = found_of(torus_knot(2, 3), "3_1")
    assert (
        found.measured == "left-handed 3_1, proved" and "a diagram of 3 crossings" in found.detail
    )
    assert "no Floer homology" in found.detail
    large = found_of(torus_knot(2, 11, 500), "T(2,11)")
    assert large.measured == "T(2,11), consistent"
