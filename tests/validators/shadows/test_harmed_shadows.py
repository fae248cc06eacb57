"""The verdict's word is a person's on most of a hundred shadows, and never off by two words."""

from __future__ import annotations

import pytest

from knotfab_formats.verdict import WORDS
from tests.corpus.harmed_shadows import SIXTY, harmed, judge


@pytest.mark.study
def test_the_word_is_a_persons() -> None:
    off = [
        abs(WORDS.index(judge(wanted, shadow)[0]) - WORDS.index(person))
        for _, person, wanted, shadow in harmed()
    ]
    assert off[: len(SIXTY)].count(0) >= 56
    assert off[len(SIXTY) :].count(0) >= 33
    assert max(off) == 1
