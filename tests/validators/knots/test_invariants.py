"""Invariants of diagrams: exact values, agreement of independent ways, and what never changes them."""

from __future__ import annotations

import itertools
from itertools import combinations

import numpy as np
import pytest
from knot_curves import (
    TREFOIL,
    WHITEHEAD,
    WORDS,
    Array,
    braid,
    diagram,
    figure_eight,
    mirror,
    move_randomly,
    powers,
    random_markov,
    ring,
    rotate,
    torus_knot,
)

from knotfab_validators.knots.alexander import (
    alexander_polynomial,
    colouring_number,
    colouring_remainder,
    jones_polynomial,
)
from knotfab_validators.knots.identity import identify
from knotfab_validators.knots.invariants import (
    UNKNOT,
    Disagreement,
    Floer,
    Invariants,
    determinant_and_signature,
    floer_homology,
    invariants,
)
from knotfab_validators.knots.names import Factor, braid_of, braid_word, candidates, known_knot
from knotfab_validators.knots.planar_diagram import (
    Laurent,
    Passage,
    PlanarDiagram,
    closed_braid,
    faces,
    from_passages,
    laurent,
    simplify,
)
from knotfab_validators.knots.projection import PRIMES, cusp_counts
from knotfab_validators.knots.reduction import general_position, reduce_polygons
from knotfab_validators.knots.rerouting import reroute


def test_values_of_the_trefoils_and_the_figure_eight() -> None:
    right = invariants(closed_braid(TREFOIL))
    assert powers(right.alexander) == {-1: 1, 0: -1, 1: 1}
    assert powers(right.jones) == {2: 1, 6: 1, 8: -1}  # t + t^3 - t^4, exponents doubled
    assert right.signature == -2 and right.hand == 1 and right.determinant == 3
    assert right.floer == Floer((((-1, -2), 1), ((0, -1), 1), ((1, 0), 1)))
    assert right.floer.genus == 1 and right.floer.fibred and right.floer.total == 3
    left = invariants(closed_braid([-1, -1, -1]))
    assert left == right.mirror() and left.hand == -1 and not left.fits(right)
    eight = invariants(closed_braid([1, -2, 1, -2]))
    assert powers(eight.alexander) == {-1: -1, 0: 3, 1: -1}
    assert powers(eight.jones) == {-4: 1, -2: -1, 0: 1, 2: -1, 4: 1}
    assert eight.hand == 0 and eight.mirror() == eight and eight.signature == 0


@pytest.mark.parametrize(("p", "q"), [(2, 7), (2, 13), (3, 4), (3, 5), (3, 10), (4, 5), (5, 6)])
def test_torus_knots_have_their_closed_forms(p: int, q: int) -> None:
    found = invariants(closed_braid(list(range(1, p)) * q))
    top = Laurent(0, (-1, *[0] * (p * q - 1), 1)) * Laurent(0, (-1, 1))
    bottom = Laurent(0, (-1, *[0] * (p - 1), 1)) * Laurent(0, (-1, *[0] * (q - 1), 1))
    assert found.alexander.shift((p - 1) * (q - 1) // 2) * bottom == top
    # t^((p-1)(q-1)/2) (1 - t^(p+1) - t^(q+1) + t^(p+q)) / (1 - t^2)
    assert found.jones is not None
    left = found.jones.shift(-(p - 1) * (q - 1)) * Laurent(0, (1, 0, 0, 0, -1))
    terms = {0: 1, 2 * (p + 1): -1, 2 * (q + 1): -1}
    terms[2 * (p + q)] = terms.get(2 * (p + q), 0) + 1
    assert powers(left) == terms
    assert found.floer is not None and found.floer.genus == (p - 1) * (q - 1) // 2


def test_links() -> None:
    hopf = closed_braid([1, 1])
    assert hopf.linking_numbers() == {(0, 1): 1} and powers(jones_polynomial(hopf)) == {
        1: -1,
        5: -1,
    }
    assert closed_braid([-1, -1]).linking_numbers() == {(0, 1): -1}
    whitehead = closed_braid(WHITEHEAD)
    assert whitehead.linking_numbers() == {}
    assert powers(alexander_polynomial(whitehead)) == {0: 1, 1: -3, 2: 3, 3: -1}
    assert colouring_number(whitehead) == 8
    rings = closed_braid([1, -2] * 3)
    assert rings.linking_numbers() == {} and colouring_number(rings) == 16
    assert powers(alexander_polynomial(rings)) == {0: 1, 1: -4, 2: 6, 3: -4, 4: 1}
    apart = closed_braid([1, 1, 1, 3, 3, 3])
    assert apart.pieces() == ((0,), (1,)) and not alexander_polynomial(apart)
    assert colouring_number(apart) == 0
    two = closed_braid([], strands=2)
    assert two.loops == (0, 1) and powers(jones_polynomial(two)) == {-1: -1, 1: -1}
    assert not alexander_polynomial(two) and colouring_number(two) == 0


@pytest.mark.parametrize("word", [TREFOIL, (1, -2, 1, -2), (1,), WORDS[-1]])
@pytest.mark.parametrize("seed", range(3))
def test_markov_moves_change_nothing(word: tuple[int, ...], seed: int) -> None:
    moved = random_markov(word, 60, seed)
    assert invariants(closed_braid(moved)) == invariants(closed_braid(word))
    (polygon,) = braid(moved)
    found = invariants(diagram(rotate(polygon, seed)))
    assert found == invariants(closed_braid(word))


def test_polygons_have_the_invariants_of_their_braids() -> None:
    for word in (TREFOIL, (-1, -1, -1), (1, -2, 1, -2), (1, 1, 1, 2, -1, 2), WORDS[-1]):
        (polygon,) = braid(word)
        for seed in range(3):
            assert invariants(diagram(rotate(polygon, seed))) == invariants(closed_braid(word))
        assert invariants(diagram(mirror(polygon))) == invariants(closed_braid(word)).mirror()
    for word in ((1, 1), (-1, -1), WHITEHEAD, (1, -2, 1, -2, 1, -2)):
        found = diagram(*braid(word))
        assert found.linking_numbers() == closed_braid(word).linking_numbers()
        assert colouring_number(found) == colouring_number(closed_braid(word))


def test_known_curves() -> None:
    assert invariants(diagram(torus_knot(2, 3))).hand == -1
    assert invariants(diagram(figure_eight())).determinant == 5
    assert invariants(diagram(torus_knot(3, 4))).determinant == 3
    assert invariants(diagram(ring())) == UNKNOT


def test_a_disagreement_is_never_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Floer((((-1, -1), 1), ((0, 0), 3), ((1, 1), 1)))
    module = "knotfab_validators.knots.invariants"
    monkeypatch.setattr(f"{module}.floer_homology", lambda *_: wrong)
    with pytest.raises(Disagreement, match="Floer"):
        invariants(closed_braid(TREFOIL))
    lopsided = Floer((((-1, -2), 1), ((0, -1), 1), ((1, 2), 1)))
    monkeypatch.setattr(f"{module}.floer_homology", lambda *_: lopsided)
    with pytest.raises(Disagreement, match="symmetric"):
        invariants(closed_braid(TREFOIL))
    monkeypatch.setattr(f"{module}.determinant_and_signature", lambda *_: (5, -2))
    with pytest.raises(Disagreement, match="Goeritz"):
        invariants(closed_braid(TREFOIL))


def test_sums_multiply() -> None:
    right, left = invariants(closed_braid(TREFOIL)), invariants(closed_braid([-1] * 3))
    granny, square = invariants(closed_braid([1] * 3 + [2] * 3)), right * left
    assert right * right == granny and not granny.fits(square)
    assert invariants(closed_braid([1] * 3 + [-2] * 3)) == square
    unknown = Invariants(granny.alexander, granny.signature, None, None)
    assert unknown.fits(granny) and granny.fits(unknown) and (unknown * right).jones is None


# Knot Floer homology is left out where its program cannot answer.


def test_floer_homology_is_left_out_where_it_would_take_too_long() -> None:
    one, much = Laurent(0, (1,)), Laurent(0, (2000,))
    assert floer_homology(closed_braid([1] * 25), much) is not None
    assert floer_homology(closed_braid([1] * 25), Laurent(0, (-2001,))) is None
    assert floer_homology(closed_braid([1] * 27), much) is None
    assert floer_homology(closed_braid([1] * 31), one) is not None
    assert floer_homology(closed_braid([1] * 33), one) is None
    assert floer_homology(closed_braid([1, 1]), one) is None  # a link
    assert floer_homology(closed_braid([1]), one) is None  # which the program refuses


# The Alexander polynomial by primes, against the same determinant over the rationals.


def test_the_polynomial_is_that_of_the_rational_matrix() -> None:
    """Modular arithmetic finds what plain expansion does, with large coefficients."""
    for word in (WORDS[0], WORDS[3], (1, 1, 1, -2, 1, -2, -2, 3, -2, 3)):
        plain = closed_braid(word)
        if len(plain.components) == 1:
            found = alexander_polynomial(plain)
            # Burau: det(1 - B(t)) (1 - t) / (1 - t^n) is Δ(t), checked at t = 2 up to sign and 2^k
            value = abs(burau(word, 2.0))
            exact = abs(
                sum(c * 2.0 ** (found.lowest + k) for k, c in enumerate(found.coefficients))
            )
            ratio = np.log2(value / exact)
            assert ratio == pytest.approx(round(ratio), abs=1e-9)


def burau(word: tuple[int, ...], t: float) -> float:
    n = max(map(abs, word)) + 1
    whole = np.eye(n)
    for letter in word:
        k = abs(letter) - 1
        step = np.eye(n)
        step[k : k + 2, k : k + 2] = [[1 - t, t], [1, 0]]
        whole = whole @ (step if letter > 0 else np.linalg.inv(step))
    minor = (np.eye(n) - whole)[1:, 1:]
    return float(np.linalg.det(minor) * (1 - t) / (1 - t**n))


# Representations in PSL(2, p): known values, and what they tell apart.


def diagram_of(name: str) -> PlanarDiagram:
    return reroute(closed_braid(braid_word(name)), enough=10)


def test_the_trefoils_longitude_is_its_meridian_to_minus_six() -> None:
    """This holds beside the one representation that commutes, where it is central but for its meridians."""
    for prime in PRIMES:
        found = cusp_counts(diagram_of("3_1"), prime)
        assert found is not None and found[0] == 1
        assert {k for k, n in enumerate(found) if n and k} == {6}


@pytest.mark.parametrize("name", ["4_1", "8_16", "9_35", "10_103"])
def test_counts_depend_on_the_knot_and_turn_in_a_mirror(name: str) -> None:
    tangled = reroute(closed_braid(random_markov(list(braid_word(name)), 30, seed=2)), enough=11)
    for prime in PRIMES:
        one = cusp_counts(diagram_of(name), prime)
        assert one is not None and one == cusp_counts(tangled, prime)
        assert cusp_counts(diagram_of(name).mirror(), prime) == (one[0], *one[:0:-1])


@pytest.mark.parametrize(
    "name", ["8_8", "8_16", "10_25", "10_40", "4_1#5_2", "10_48", "10_71", "10_91", "10_104"]
)
def test_what_all_other_invariants_take_for_one_is_told_apart(name: str) -> None:
    numbers = [tuple(map(int, factor.split("_"))) for factor in name.split("#")]
    factors = tuple(Factor(n, k, 0 if (n, k) == (4, 1) else 1) for n, k in numbers)
    knots = [k for k in candidates(known_knot(factors).invariants) if k.crossings <= 10]
    assert len(knots) == 2
    counts = [
        [cusp_counts(reroute(closed_braid(braid_of(knot)), enough=10), p) for p in PRIMES]
        for knot in knots
    ]
    assert all(one != other for one, other in combinations(counts, 2))


# Diagrams: mirror images and simplifying change what they must, and nothing else.


@pytest.mark.parametrize("word", WORDS)
def test_a_mirror_reverses_and_simplifying_changes_nothing(word: tuple[int, ...]) -> None:
    plain = closed_braid(word)
    small = simplify(plain)
    assert len(small.crossings) <= len(plain.crossings)
    assert small.components == plain.components
    assert small.linking_numbers() == plain.linking_numbers()
    value = jones_polynomial(plain)
    assert value is not None and jones_polynomial(small) == value
    assert jones_polynomial(plain.mirror()) == value.reverse()
    assert plain.mirror() == closed_braid([-k for k in word])
    assert colouring_number(plain) == colouring_number(small)
    assert alexander_polynomial(plain) == alexander_polynomial(small)
    if len(plain.components) == 1:
        found = invariants(plain)  # raises if Floer homology or Goeritz' matrix disagree
        assert invariants(plain.mirror()) == found.mirror()
        assert determinant_and_signature(plain) == (found.determinant, found.signature)
        assert colouring_number(plain) == colouring_remainder(found.determinant)


def test_a_crossing_where_the_diagram_falls_in_two_goes() -> None:
    """The program for Floer homology gives a wrong answer there."""
    # an isthmus joins one trefoil to the other
    over = [Passage(k, k % 2 == 0) for k in range(3)]
    under = [Passage(k, k % 2 == 1) for k in range(3)]
    one = [*over, *under]
    other = [Passage(p.crossing + 4, p.above) for p in one]
    joined = from_passages({0: [*one, Passage(3, True), *other, Passage(3, False)]}, [1] * 7)
    face = faces(joined)
    assert face[3, 0] == face[3, 2] or face[3, 1] == face[3, 3]
    small = simplify(joined)
    assert len(small.crossings) == 6
    right = invariants(closed_braid(TREFOIL))
    assert jones_polynomial(small) == jones_polynomial(joined)
    assert invariants(joined) == right * right


# Laurent polynomials: their text, and what is done with them.


def test_polynomials() -> None:
    one = laurent(-2, [0, 0, 1, -3, 1, 0])
    assert one == Laurent(0, (1, -3, 1)) and not laurent(3, [0, 0])
    assert one.text() == "t^2 - 3t + 1" and Laurent(-1, (-1, 3, -1)).text() == "-t + 3 - t^-1"
    assert Laurent(1, (-1, 0, 0, 0, -1)).text(half=True) == "-t^(5/2) - t^(1/2)"
    assert Laurent(0, ()).text() == "0" and Laurent(0, (1,)).text() == "1"
    assert Laurent(-1, (-1, 3, -1)).at_minus_one() == 5 and one.at_one() == -1
    for i, j in itertools.product(range(-2, 3), repeat=2):
        product = one.shift(i) * Laurent(0, (2, 1)).shift(j)
        assert powers(product) == {i + j: 2, i + j + 1: -5, i + j + 2: -1, i + j + 3: 1}


@pytest.mark.slow
def test_floer_homology_proves_an_unknot_that_was_not_reduced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    placed = general_position([move_randomly(ring(24, 2.0), 16, 1)])
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
