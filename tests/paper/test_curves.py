"""Closed braids are the links that they are called; test_corpus has the other curves judged."""

import pytest
from knot_judge import linking_numbers

from knotfab_formats.errors import InputError
from paper.curves import closed_braid


def test_two_positive_letters_are_a_right_handed_hopf_link() -> None:
    assert linking_numbers(*closed_braid([1, 1])) == [1]
    assert linking_numbers(*closed_braid([-1, -1, -1, -1])) == [-2]


@pytest.mark.parametrize("word", [[], [1, 0]])
def test_a_braid_of_no_letters_is_refused(word: list[int]) -> None:
    with pytest.raises(InputError, match="must not be 0"):
        closed_braid(word)
