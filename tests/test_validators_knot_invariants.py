"""Invariants of diagrams: exact values, agreement of independent ways, and what never changes them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from knot_curves import (
    WHITEHEAD,
    Array,
    braid,
    figure_eight,
    mirrored,
    random_markov,
    ring,
    torus_knot,
    turned,
)

from knotfab_validators.alexander import (
    alexander_polynomial,
    colouring_number,
    colouring_remainder,
)
from knotfab_validators.floer import Floer, floer_homology
from knotfab_validators.goeritz import determinant_and_signature
from knotfab_validators.jones import jones_polynomial
from knotfab_validators.knot_invariants import UNKNOT, Disagreement, Invariants, invariants
from knotfab_validators.knot_reduction import general_position
from knotfab_validators.planar_diagram import (
    Passage,
    PlanarDiagram,
    closed_braid,
    faces,
    from_passages,
    simplified,
)
from knotfab_validators.polynomial import Laurent, laurent
from knotfab_validators.projection import diagram_of, seen_from

TREFOIL = (1, 1, 1)


def diagram(*polygons: Array) -> PlanarDiagram:
    placed = general_position(polygons)
    assert placed is not None
    found = diagram_of(placed, most=2000)
    assert found is not None
    return found


def powers(value: Laurent | None) -> dict[int, int]:
    assert value is not None
    return {value.lowest + k: c for k, c in enumerate(value.coefficients) if c}


def test_values_of_the_trefoils_and_the_figure_eight() -> None:
    right = invariants(closed_braid(TREFOIL))
    assert powers(right.alexander) == {-1: 1, 0: -1, 1: 1}
    assert powers(right.jones) == {2: 1, 6: 1, 8: -1}  # t + t^3 - t^4, exponents doubled
    assert right.signature == -2 and right.hand == 1 and right.determinant == 3
    assert right.floer == Floer((((-1, -2), 1), ((0, -1), 1), ((1, 0), 1)))
    assert right.floer.genus == 1 and right.floer.fibred and right.floer.total == 3
    left = invariants(closed_braid([-1, -1, -1]))
    assert left == right.mirrored() and left.hand == -1 and not left.fits(right)
    eight = invariants(closed_braid([1, -2, 1, -2]))
    assert powers(eight.alexander) == {-1: -1, 0: 3, 1: -1}
    assert powers(eight.jones) == {-4: 1, -2: -1, 0: 1, 2: -1, 4: 1}
    assert eight.hand == 0 and eight.mirrored() == eight and eight.signature == 0


@pytest.mark.parametrize(("p", "q"), [(2, 7), (2, 13), (3, 4), (3, 5), (3, 10), (4, 5), (5, 6)])
def test_torus_knots_have_their_closed_forms(p: int, q: int) -> None:
    found = invariants(closed_braid(list(range(1, p)) * q))
    top = Laurent(0, (-1, *[0] * (p * q - 1), 1)) * Laurent(0, (-1, 1))
    bottom = Laurent(0, (-1, *[0] * (p - 1), 1)) * Laurent(0, (-1, *[0] * (q - 1), 1))
    assert found.alexander.shifted((p - 1) * (q - 1) // 2) * bottom == top
    # t^((p-1)(q-1)/2) (1 - t^(p+1) - t^(q+1) + t^(p+q)) / (1 - t^2)
    assert found.jones is not None
    left = found.jones.shifted(-(p - 1) * (q - 1)) * Laurent(0, (1, 0, 0, 0, -1))
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


WORDS = [
    *[
        tuple(np.random.default_rng(s).choice([-3, -2, -1, 1, 2, 3], 14).tolist())
        for s in range(24)
    ],
    TREFOIL,
    (1, 1, 1, -2, -1, -1, -1, -2),
]


@pytest.mark.parametrize("word", WORDS)
def test_a_mirror_reverses_and_simplifying_changes_nothing(word: tuple[int, ...]) -> None:
    plain = closed_braid(word)
    small = simplified(plain)
    assert len(small.crossings) <= len(plain.crossings)
    assert small.components == plain.components
    assert small.linking_numbers() == plain.linking_numbers()
    value = jones_polynomial(plain)
    assert value is not None and jones_polynomial(small) == value
    assert jones_polynomial(plain.mirrored()) == value.reversed()
    assert plain.mirrored() == closed_braid([-k for k in word])
    assert colouring_number(plain) == colouring_number(small)
    assert alexander_polynomial(plain) == alexander_polynomial(small)
    if len(plain.components) == 1:
        found = invariants(plain)  # raises if Floer homology or Goeritz' matrix disagree
        assert invariants(plain.mirrored()) == found.mirrored()
        assert determinant_and_signature(plain) == (found.determinant, found.signature)
        assert colouring_number(plain) == colouring_remainder(found.determinant)


@pytest.mark.parametrize("word", [TREFOIL, (1, -2, 1, -2), (1,), WORDS[-1]])
@pytest.mark.parametrize("seed", range(3))
def test_markov_moves_change_nothing(word: tuple[int, ...], seed: int) -> None:
    moved = random_markov(word, 60, seed)
    assert invariants(closed_braid(moved)) == invariants(closed_braid(word))
    (polygon,) = braid(moved)
    found = invariants(diagram(turned(polygon, seed)))
    assert found == invariants(closed_braid(word))


def test_a_crossing_where_the_diagram_falls_in_two_goes() -> None:
    """The program for Floer homology gives a wrong answer there."""
    # one trefoil, an isthmus, the other trefoil
    over = [Passage(k, k % 2 == 0) for k in range(3)]
    under = [Passage(k, k % 2 == 1) for k in range(3)]
    one = [*over, *under]
    other = [Passage(p.crossing + 4, p.above) for p in one]
    joined = from_passages({0: [*one, Passage(3, True), *other, Passage(3, False)]}, [1] * 7)
    face = faces(joined)
    assert face[3, 0] == face[3, 2] or face[3, 1] == face[3, 3]
    small = simplified(joined)
    assert len(small.crossings) == 6
    right = invariants(closed_braid(TREFOIL))
    assert jones_polynomial(small) == jones_polynomial(joined)
    assert invariants(joined) == right * right


def test_polygons_have_the_invariants_of_their_braids() -> None:
    for word in (TREFOIL, (-1, -1, -1), (1, -2, 1, -2), (1, 1, 1, 2, -1, 2), WORDS[-1]):
        (polygon,) = braid(word)
        for seed in range(3):
            assert invariants(diagram(turned(polygon, seed))) == invariants(closed_braid(word))
        assert invariants(diagram(mirrored(polygon))) == invariants(closed_braid(word)).mirrored()
    for word in ((1, 1), (-1, -1), WHITEHEAD, (1, -2, 1, -2, 1, -2)):
        found = diagram(*braid(word))
        assert found.linking_numbers() == closed_braid(word).linking_numbers()
        assert colouring_number(found) == colouring_number(closed_braid(word))


def test_known_curves() -> None:
    assert invariants(diagram(torus_knot(2, 3))).hand == -1
    assert invariants(diagram(figure_eight())).determinant == 5
    assert invariants(diagram(torus_knot(3, 4))).determinant == 3
    assert invariants(diagram(ring())) == UNKNOT


def test_linking_numbers_agree_with_gauss_integral() -> None:
    found = []
    for seed in range(20):
        one, other = np.random.default_rng(seed).normal(size=(2, 14, 3))
        found.append(diagram(one, other).linking_numbers().get((0, 1), 0))
        assert found[-1] == pytest.approx(gauss(one, other), abs=1e-9)
    assert min(found) < 0 < max(found)


def gauss(one: Array, other: Array) -> float:
    """Gauss' double integral over all pairs of edges, each in closed form as a solid angle."""
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None]
    normals = [np.cross(c - a, d - a), np.cross(d - a, d - b)]
    normals += [np.cross(d - b, c - b), np.cross(c - b, c - a)]
    unit = [n / np.linalg.norm(n, axis=2, keepdims=True) for n in normals]
    angle = sum(
        np.arcsin(np.clip((unit[k] * unit[(k + 1) % 4]).sum(axis=2), -1, 1)) for k in range(4)
    )
    sign = np.sign((np.cross(d - c, b - a) * (c - a)).sum(axis=2))
    return float((angle * sign).sum() / (4 * np.pi))


def test_a_direction_in_which_a_sign_is_uncertain_is_left_aside() -> None:
    cross = np.array([[-1.0, 0, 0], [1, 0, 0], [1, 2, 1], [0, 2, 1], [0, -2, 1], [-1, -2, 0.5]])
    assert seen_from([cross], np.array([0.0, 0.0, 1.0])) is not None
    for hit in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):  # along an edge
        assert seen_from([cross], np.array(hit)) is None
    over = cross.copy()
    over[3:5, 0] = 1.0  # three edges through one point of the picture
    assert seen_from([over], np.array([0.0, 0.0, 1.0])) is None
    assert diagram_of([np.random.default_rng(0).normal(size=(200, 3))], most=100) is None


def test_the_alexander_polynomial_is_that_of_the_matrix_over_the_rationals() -> None:
    """A check of the modular arithmetic against plain expansion, with large coefficients."""
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


def test_a_disagreement_is_never_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Floer((((-1, -1), 1), ((0, 0), 3), ((1, 1), 1)))
    module = "knotfab_validators.knot_invariants"
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


def test_floer_homology_is_left_out_where_it_would_take_too_long() -> None:
    one, much = Laurent(0, (1,)), Laurent(0, (2000,))
    assert floer_homology(closed_braid([1] * 25), much) is not None
    assert floer_homology(closed_braid([1] * 25), Laurent(0, (-2001,))) is None
    assert floer_homology(closed_braid([1] * 27), much) is None
    assert floer_homology(closed_braid([1] * 31), one) is not None
    assert floer_homology(closed_braid([1] * 33), one) is None
    assert floer_homology(closed_braid([1, 1]), one) is None  # a link
    assert floer_homology(closed_braid([1]), one) is None  # which the program refuses


def test_sums_multiply() -> None:
    right, left = invariants(closed_braid(TREFOIL)), invariants(closed_braid([-1] * 3))
    granny, square = invariants(closed_braid([1] * 3 + [2] * 3)), right * left
    assert right * right == granny and not granny.fits(square)
    assert invariants(closed_braid([1] * 3 + [-2] * 3)) == square
    unknown = Invariants(granny.alexander, granny.signature, None, None)
    assert unknown.fits(granny) and granny.fits(unknown) and (unknown * right).jones is None


def test_polynomials() -> None:
    one = laurent(-2, [0, 0, 1, -3, 1, 0])
    assert one == Laurent(0, (1, -3, 1)) and not laurent(3, [0, 0])
    assert one.text() == "t^2 - 3t + 1" and Laurent(-1, (-1, 3, -1)).text() == "-t + 3 - t^-1"
    assert Laurent(1, (-1, 0, 0, 0, -1)).text(half=True) == "-t^(5/2) - t^(1/2)"
    assert Laurent(0, ()).text() == "0" and Laurent(0, (1,)).text() == "1"
    assert Laurent(-1, (-1, 3, -1)).at_minus_one() == 5 and one.at_one() == -1
    for i, j in itertools.product(range(-2, 3), repeat=2):
        product = one.shifted(i) * Laurent(0, (2, 1)).shifted(j)
        assert powers(product) == {i + j: 2, i + j + 1: -5, i + j + 2: -1, i + j + 3: 1}
