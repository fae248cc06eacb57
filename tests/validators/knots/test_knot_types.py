"""Knot types: proofs on curves whose type is known, and promises that must be refuted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from knot_curves import (
    WHITEHEAD,
    Array,
    borromean,
    braid,
    curves,
    figure_eight,
    mirror,
    random_markov,
    ring,
    rotate,
    torus_knot,
    zigzag,
)
from tables import some

from knotfab_formats.verdict import Check
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.identity import identify
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
from knotfab_validators.knots.reduction import general_position, may_pierce, reduce_polygons
from knotfab_validators.validate import validate

SMALL = [name for name in prime_names() if int(name.split("_")[0]) <= 8]
LARGE = ["9_35", "9_42", "10_48", "10_132", "10_139", "10_161", "10_165"]


def check_knot_type(found: Curves) -> Check:
    return knot_checks(found)[0]


def check_linking(found: Curves) -> Check:
    return knot_checks(found)[1]


def found_of(polygon: Array, kind: str = "unknown") -> Check:
    return check_knot_type(curves(polygon, types=(kind,)))


def filling(n: int, seed: int, rows: int = 24) -> Array:
    """A comb that fills a square: simple from above, at a random smooth depth; so an unknot."""
    rng = np.random.default_rng(seed)
    corners = [(0.0, 0.0)]
    for k in range(rows):
        corners += [(8.0, k * 4.0), (100.0, k * 4.0)][:: 1 if k % 2 == 0 else -1]
    corners += [(0.0, corners[-1][1]), (0.0, 0.0)]
    path = np.array(corners)
    length = np.concatenate([[0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
    s = np.linspace(0, length[-1], n, endpoint=False)
    angle = 2 * np.pi * s / length[-1]
    waves = [rng.normal() * np.cos(k * angle + rng.uniform(0, 7)) for k in range(1, 60)]
    depth = np.sum(waves, axis=0)
    flat = [np.interp(s, length, path[:, 0]), np.interp(s, length, path[:, 1])]
    return np.column_stack([*flat, 30 * depth / depth.std()])


def seen_from_a_lamp(points: Array, distance: float = 150.0) -> Array:
    """A projective map of space, so that the curve is simple from one point and from no side."""
    return np.column_stack([points[:, :2] * (1 - points[:, 2:] / distance), points[:, 2]])


# --- proofs ---------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [3, 4, 5, 100])
def test_a_flat_polygon_is_an_unknot_however_it_lies(n: int) -> None:
    for seed in range(3):
        found = check_knot_type(curves(rotate(ring(n), seed)))
        assert (found.status, found.measured, found.limit) == ("pass", "unknot, proved", "unknot")


@pytest.mark.parametrize("seed", range(3))
def test_a_tangle_of_4000_vertices_is_proved_to_be_an_unknot(seed: int) -> None:
    """Crossings in every projection along an axis: it takes the reduction to see it."""
    for tangle in (rotate(filling(4000, seed), seed), seen_from_a_lamp(filling(4000, seed))):
        found = check_knot_type(curves(tangle))
        assert (found.status, found.measured) == ("pass", "unknot, proved")


def test_the_reduction_alone_suffices_where_a_projection_would() -> None:
    assert reduce_polygons([filling(1500, 7)]).vertices == 0


def test_a_coil_closed_beside_or_along_its_axis_is_an_unknot() -> None:
    s = np.linspace(0, 1, 400)
    turns = 2 * np.pi * 12 * s
    coil = np.column_stack([np.cos(turns), np.sin(turns), 10 * s])
    for back in ([[0.0, 0, 11], [5, 0, 5], [0, 0, -1]], [[0.0, 0, 11], [0, 0, -1]]):
        closed = rotate(np.concatenate([coil, back]), 1)
        assert check_knot_type(curves(closed)).measured == "unknot, proved"


def test_unlinks_are_proved() -> None:
    apart = curves(ring(), rotate(ring(), 1) + np.array([3.0, 0, 0]), ring() * 0.5)
    for kind, linking in (knot_checks(apart),):
        assert (kind.status, kind.measured, kind.limit) == ("pass", "unknot, proved", "unknot")
        assert (linking.status, linking.measured, linking.limit) == ("pass", 0.0, 0.0)
        assert linking.detail == "all are apart from each other, proved"
    halves = [rotate(filling(1000, 1), 2), rotate(filling(1000, 2) + np.array([0, 0, 60.0]), 2)]
    above = knot_checks(curves(halves[0], halves[1] + np.array([0.13, 0.17, 300])))
    assert [check.status for check in above] == ["pass", "pass"]
    assert above[0].measured == "unknot, proved" and above[1].detail.endswith("proved")


# --- promises that must be refuted ----------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_rejects_a_trefoil_promised_as_an_unknot(seed: int) -> None:
    named = (
        (torus_knot(2, 3), "left-handed 3_1, proved"),
        (figure_eight(), "4_1, proved"),
        (torus_knot(2, 5), "left-handed 5_1, proved"),
    )
    for knot, name in named:
        found = check_knot_type(curves(rotate(knot, seed)))
        assert found.status == "fail" and found.required and found.name == "knot_type"
        assert found.measured == name


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
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


def test_rejects_an_unknot_promised_as_a_trefoil() -> None:
    found = check_knot_type(curves(rotate(ring(), 1), types=("trefoil",)))
    assert found.status == "fail" and found.measured == "unknot, proved"
    other = check_knot_type(curves(figure_eight(), types=("trefoil",)))
    assert other.status == "fail" and other.measured == "4_1, proved"


def test_rejects_polygons_that_touch() -> None:
    crossing = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    assert check_knot_type(curves(crossing)).status == "fail"
    touching = ring(100) + np.array([2.0, 0, 0])  # vertices of both at (1, 0, 0)
    assert check_knot_type(curves(ring(100), touching)).status == "fail"


# --- what a knot is --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", some(SMALL + LARGE, 4))
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


def test_small_diagrams_prove_where_invariants_alone_do_not() -> None:
    """8_8 and 10_129 have the same invariants; a diagram of fewer than ten crossings decides."""
    (eight,) = braid((-1, -1, -1, -2, 1, 3, -2, 3, 3))
    found = found_of(eight, "8_8")
    assert found.status == "pass" and str(found.measured).endswith("8_8, proved")
    assert "crossings, and no other knot of so few has its invariants" in found.detail
    assert found_of(eight, "10_129").status == "fail"
    (ten,) = braid(braid_word("10_129"))
    other = found_of(ten, "10_129")
    assert other.status == "pass" and other.measured == "right-handed 10_129, proved"
    assert "nor its representations in PSL(2, p)" in other.detail
    assert found_of(ten, "8_8").status == "fail"


def test_representations_tell_apart_what_homology_does_not() -> None:
    """They do so, too, for curves whose diagrams are not shown to have ten crossings; none is proved."""
    for name, other in (("10_156", "8_16"), ("10_103", "10_40"), ("10_91", "left-handed 10_91")):
        knot = braid(braid_word(name))[0]
        assert found_of(knot, f"right-handed {name}").status == "pass"
        assert found_of(knot, other).status == "fail"


@pytest.mark.slow
def test_sums_beyond_the_table_are_proved_summand_by_summand() -> None:
    word = braid_of(known_knot((Factor(6, 2, 1), Factor(6, 3, 0))))
    found = found_of(zigzag(rotate(braid(word)[0], 4), 3, 1), "6_2#6_3")
    assert found.measured == "right-handed 6_2#6_3, proved" and "summands" in found.detail
    assert found_of(braid(word)[0], "m6_2#6_3").status == "fail"


@pytest.mark.parametrize(
    ("word", "name", "why"),
    [
        ((1, 1, 1), "right-handed 3_1", "genus 1 and fibred"),
        ((-1, -1, -1), "left-handed 3_1", "genus 1 and fibred"),
        ((1, -2, 1, -2), "4_1", "genus 1 and fibred"),
        ((1,) * 5, "right-handed 5_1", "Floer homology of T(2,5)"),
        ((-1,) * 5, "left-handed 5_1", "Floer homology of T(2,5)"),
        ((1, 1, 1, 2, 2, 2), "right-handed 3_1#3_1", "a diagram of 6 crossings"),
        ((-1, -1, -1, -2, -2, -2), "left-handed 3_1#3_1", "a diagram of 6 crossings"),
        ((1, 1, 1, -2, -2, -2), "3_1#m3_1", "a diagram of 6 crossings"),
        ((1, 1, 1, -2, 3, -2, 3), "right-handed 3_1#4_1", "a diagram of 7 crossings"),
    ],
)
def test_what_is_proved_and_why(word: tuple[int, ...], name: str, why: str) -> None:
    (polygon,) = braid(word)
    found = found_of(rotate(polygon, 3))
    assert found.measured == f"{name}, proved" and why in found.detail
    assert "Jones" in found.detail and "signature" in found.detail


@pytest.mark.slow
def test_knots_beyond_the_table() -> None:
    found = found_of(rotate(torus_knot(3, 7, 600), 1))
    assert found.status == "pass" and "not a knot of the table (determinant 1)" in found.detail
    for kind, status in (("T(3,-7)", "pass"), ("right-handed T(3,7)", "fail")):
        found = found_of(rotate(torus_knot(3, 7, 600), 1), kind)
        assert found.status == status
        assert found.measured == ("not a " if status == "fail" else "") + kind + (
            ", consistent" if status == "pass" else ""
        )


# --- promises that must be refuted, by hand and among twins ----------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "promise", "measured"),
    [
        ((-1, -1, -1), "right-handed trefoil", "left-handed 3_1, proved"),
        ((1, 1, 1), "left-handed trefoil", "right-handed 3_1, proved"),
        ((1, 1, 1), "m3_1", "right-handed 3_1, proved"),
        ((1, 1, 1, 2, 2, 2), "square", "right-handed 3_1#3_1, proved"),
        ((1, 1, 1, 2, 2, 2), "m3_1#m3_1", "right-handed 3_1#3_1, proved"),
        ((1, 1, 1, -2, -2, -2), "granny", "3_1#m3_1, proved"),
        ((1, 1, 1, -2, -2, -2), "8_20", "3_1#m3_1, proved"),
        ((1, 1, 1, -2, -1, -1, -1, -2), "3_1#m3_1", "left-handed 8_20, proved"),
        ((1, 1, 1, -2, -1, -1, -1, -2), "right-handed 8_20", "left-handed 8_20, proved"),
        ((1, 1, 1, 1, 1), "unknot", "right-handed 5_1, proved"),
        ((1, -2, 1, -2), "5_1", "4_1, proved"),
        ((1,) * 13, "unknot", "not an unknot"),
        ((1,) * 13, "9_1", "not a 9_1"),
    ],
)
def test_rejects(word: tuple[int, ...], promise: str, measured: str) -> None:
    (polygon,) = braid(word)
    found = found_of(rotate(polygon, 2), promise)
    assert (found.status, found.measured, found.required) == ("fail", measured, True)
    assert f"promised as {promise}" in found.detail and found.limit == promise
    assert 1 <= len(found.at) <= 20
    gaps = [np.linalg.norm(rotate(polygon, 2) - np.array(p), axis=1).min() for p in found.at]
    assert max(gaps) < 1e-3


def test_a_twin_by_all_polynomials_is_told_by_floer_homology() -> None:
    """10_132 has the Alexander and Jones polynomials of 5_1."""
    (polygon,) = braid(braid_word("10_132"))
    found = found_of(polygon, "5_1")
    assert found.status == "fail" and str(found.measured).endswith("handed 10_132, proved")


# --- unknots that are hard to see ------------------------------------------------------------


def move_randomly(polygon: Array, rounds: int, seed: int) -> Array:
    """A random walk of triangle moves: vertices swept to far places where no edge is in the way."""
    rng = np.random.default_rng(seed)
    at = polygon.copy()
    n = len(at)
    for i in np.concatenate([rng.permutation(n) for _ in range(rounds)]):
        a, b, c = at[i - 1], at[i], at[(i + 1) % n]
        target = b + rng.normal(0, 0.7, 3)
        others = np.flatnonzero((np.arange(n) != i) & (np.arange(n) != (i - 1) % n))
        p, q = at[others], at[(others + 1) % n]
        corners = [[np.broadcast_to(x, p.shape) for x in (end, b, target)] for end in (a, c)]
        if not any(may_pierce(u, v, w, p, q).any() for u, v, w in corners):
            at[i] = target
    return at


@pytest.mark.slow
@pytest.mark.parametrize("seed", some(range(4), 2))
def test_unknots_tangled_by_random_moves_are_proved(seed: int) -> None:
    tangled = move_randomly(ring(60, 2.0), 40, seed)
    assert found_of(tangled, "unknot").measured == "unknot, proved"
    trefoil = move_randomly(braid((1, 1, 1))[0] / 2, 40, seed)
    assert found_of(trefoil, "unknot").measured == "right-handed 3_1, proved"


@pytest.mark.parametrize("seed", range(8))
def test_unknots_from_random_markov_moves_are_proved(seed: int) -> None:
    (polygon,) = braid(random_markov([1, -2, 3], 80, seed))
    assert found_of(rotate(polygon, seed), "unknot").measured == "unknot, proved"


@pytest.mark.slow
def test_floer_homology_proves_an_unknot_that_was_not_reduced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    placed = general_position([move_randomly(ring(40, 2.0), 40, 1)])
    assert placed is not None
    monkeypatch.setattr(
        "knotfab_validators.knots.identity.reduce_polygons",
        lambda polygons, **_: reduce_polygons([]) if not polygons else Unreduced(polygons),
    )
    monkeypatch.setattr("knotfab_validators.knots.projection.simplify", lambda diagram: diagram)
    monkeypatch.setattr("knotfab_validators.knots.identity.reroute", lambda diagram, **_: diagram)
    found = identify(placed[0])
    assert [knot.name for knot in found.knots] == ["unknot"] and found.proved
    assert found.reason == "knot Floer homology of rank 1"


class Unreduced:
    def __init__(self, polygons: list[Array]) -> None:
        self.polygons, self.vertices = tuple(polygons), sum(map(len, polygons))


# --- links ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
def test_links_promised_as_unlinks_are_rejected(seed: int) -> None:
    hopf = check_linking(curves(*[rotate(p, seed) for p in braid((1, 1))]))
    assert (hopf.name, hopf.status, hopf.required) == ("linking", "fail", True)
    assert (hopf.measured, hopf.limit) == (1.0, 0.0)
    assert hopf.detail == "knots 0 and 1 are linked, number +1" and len(hopf.at) == 1
    left = check_linking(curves(*[rotate(p, seed) for p in braid((-1, -1, -1, -1))]))
    assert left.measured == 2.0 and "number -2" in left.detail
    whitehead = check_linking(curves(*[rotate(p, seed) for p in braid(WHITEHEAD)]))
    assert whitehead.status == "fail" and whitehead.measured == "linked, with linking number 0"
    assert "knots 0 and 1 are linked, proved" in whitehead.detail
    rings = check_linking(curves(*[rotate(p, seed) for p in borromean()]))
    assert rings.status == "fail" and "knots 0 and 1 and 2 are linked, proved" in rings.detail
    types = check_knot_type(curves(*borromean()))
    assert types.status == "pass" and types.measured == "unknot, proved"


def test_the_nearest_places_of_linked_rings() -> None:
    one = ring(200, 10.0)
    other = ring(200, 10.0)[:, [0, 2, 1]] + [19.5, 0, 0]  # through (9.5, 0, 0)
    found = check_linking(curves(one, other, ring() + [0, 0, 50.0]))
    assert found.detail.startswith("knots 0 and 1 are linked")
    assert found.at == (pytest.approx((9.75, 0, 0), abs=0.01),)


def test_a_link_with_alexander_polynomial_0_is_told_by_jones() -> None:
    """A third ring beside a Whitehead link makes it a split link."""
    rings = braid(WHITEHEAD)
    beside = ring(40, 3.0) + [12.0, 0, 0]
    found = check_linking(curves(*rings, beside))
    assert found.status == "fail" and "knots 0 and 1 are linked, proved" in found.detail


def test_links_that_are_apart_are_proved_so() -> None:
    knots = [torus_knot(2, 3), torus_knot(2, 5) + [9.0, 0, 0], figure_eight() + [0, 9.0, 0]]
    found = check_linking(curves(*[k @ rotate(np.eye(3), 1) for k in knots]))
    assert (found.status, found.measured) == ("pass", 0.0)
    assert found.detail == "all are apart from each other, proved"
    # a braid whose closure is an unlink in disguise
    word = random_markov([2, -2], 0, 0)
    pair = [1, 1, -1, 2, -1, 1, -2, -1]
    for braided in (word, pair):
        links = braid(braided)
        assert check_linking(curves(*links)).detail == "all are apart from each other, proved"


def test_one_curve_is_not_linked() -> None:
    found = check_linking(curves(ring()))
    assert (found.status, found.measured) == ("pass", 0.0)
    assert found.detail == "there is only one closed curve"


@pytest.mark.slow
def test_a_link_that_cannot_be_told_is_skipped_and_required() -> None:
    one, other = np.random.default_rng(0).normal(size=(2, 700, 3))
    kind, linking = knot_checks(curves(one, other))
    assert kind.status == "skipped" and kind.required and "too many crossings" in kind.detail
    assert linking.status == "skipped" and linking.required and linking.measured is None


# --- what cannot be told ----------------------------------------------------------------------


def test_a_promise_that_is_not_understood_is_skipped() -> None:
    found = found_of(torus_knot(2, 3), "12n_242")
    assert found.status == "skipped" and not found.required
    assert "left-handed 3_1, proved" in found.detail and "not understood" in found.detail


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


def test_nothing_promised() -> None:
    for kind in ("unknown", "", "?"):
        found = found_of(torus_knot(2, 3), kind)
        assert (found.status, found.measured) == ("pass", "left-handed 3_1, proved")
        assert found.limit is None


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
def test_large_knots_end_in_time_and_say_so() -> None:
    rng = np.random.default_rng(3)
    steps = rng.normal(size=(6_000, 3))
    walk = np.cumsum(steps - steps.mean(axis=0), axis=0)
    found = found_of(walk)
    assert found.status == "skipped" and not found.required
    assert found.detail.startswith("not found (too many crossings left")
    promised = found_of(walk, "unknot")  # refuted all the same, by its determinant modulo a prime
    assert promised.status == "fail" and promised.measured == "not an unknot"
    hopeless = found_of(rng.normal(size=(5_000, 3)), "unknot")
    assert hopeless.status == "skipped" and hopeless.required
    assert hopeless.detail == "not found: too tangled"


def test_polygons_that_touch_say_where() -> None:
    cross = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]])
    for found in knot_checks(curves(cross, ring() + 9)):
        assert found.status == "fail" and found.required
        assert found.at[0] == pytest.approx((1, 1, 0), abs=1e-6)


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
    large = found_of(torus_knot(2, 13, 600), "T(2,13)")
    assert large.measured == "T(2,13), consistent"


def test_known_sums_have_names() -> None:
    factors = (Factor(3, 1, -1), Factor(4, 1, 0), Factor(5, 2, 1))
    assert known_knot(factors).name == "m3_1#4_1#5_2"
    assert known_knot(factors).mirror().name == "3_1#4_1#m5_2"
