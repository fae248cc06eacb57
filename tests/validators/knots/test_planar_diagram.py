"""Diagrams: mirror images and simplifying change what they must, and nothing else."""

import pytest
from diagrams import TREFOIL, WORDS

from knotfab_validators.knots.alexander import (
    alexander_polynomial,
    colouring_number,
    colouring_remainder,
)
from knotfab_validators.knots.goeritz import determinant_and_signature
from knotfab_validators.knots.invariants import invariants
from knotfab_validators.knots.jones import jones_polynomial
from knotfab_validators.knots.planar_diagram import (
    Passage,
    closed_braid,
    faces,
    from_passages,
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
