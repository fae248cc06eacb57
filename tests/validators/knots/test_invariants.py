"""Invariants of diagrams: exact values, agreement of independent ways, and what never changes them."""

from __future__ import annotations

import pytest
from diagrams import TREFOIL, WORDS, diagram, powers
from knot_curves import (
    WHITEHEAD,
    braid,
    figure_eight,
    mirror,
    random_markov,
    ring,
    rotate,
    torus_knot,
)

from knotfab_validators.knots.alexander import (
    alexander_polynomial,
    colouring_number,
    jones_polynomial,
)
from knotfab_validators.knots.invariants import (
    UNKNOT,
    Disagreement,
    Floer,
    Invariants,
    floer_homology,
    invariants,
)
from knotfab_validators.knots.planar_diagram import Laurent, closed_braid


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
