"""Diagrams: mirror images and simplifying change what they must, and nothing else."""

from __future__ import annotations

import itertools

import pytest
from diagrams import TREFOIL, WORDS, powers

from knotfab_validators.knots.alexander import (
    alexander_polynomial,
    colouring_number,
    colouring_remainder,
    jones_polynomial,
)
from knotfab_validators.knots.invariants import determinant_and_signature, invariants
from knotfab_validators.knots.planar_diagram import (
    Laurent,
    Passage,
    closed_braid,
    faces,
    from_passages,
    laurent,
    simplify,
)


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
