"""The word that a bending allows: it lowers a verdict, never raises one, and says why."""

from __future__ import annotations

import numpy as np
import pytest
from reports import recognition

from knotfab_validators.check import BadFile
from knotfab_validators.files.picture import Bent
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.shadows.verdict_rules import BENT, UNKNOWN, WORDS, judge_bending

SQUARE = np.ones((4, 4), dtype=bool)


def bent(rms: float, most: float, stretch: float) -> Bent:
    return Bent(SQUARE, rms, most, stretch, mirrored=False)


@pytest.mark.parametrize("number", range(3))
def test_each_figure_alone_lowers_the_word(number: int) -> None:
    for word, limits in BENT.items():
        at = judge_bending(recognition(word="faithful", reasons=[]), bent(*limits))
        assert at.word == word
        above = list(limits)
        above[number] *= 1.01
        lower = judge_bending(recognition(word="faithful", reasons=[]), bent(*above))
        assert WORDS.index(lower.word) == WORDS.index(word) + 1
        assert "picture bent by" in lower.reasons[-1]


def test_no_bending_makes_a_verdict_better() -> None:
    assert judge_bending(recognition(word=UNKNOWN, reasons=[]), bent(0, 0, 1)).word == UNKNOWN
    assert (
        judge_bending(recognition(word="coarse", reasons=[]), bent(0.03, 0.1, 2.5)).word == "coarse"
    )
    assert (
        judge_bending(recognition(word="good", reasons=[]), bent(0.01, 0.02, np.inf)).word
        == UNKNOWN
    )


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"mirrored": 1}, "true or false"),
        ({"bend_points": "0,0"}, "a list of as many"),
        ({"bend_points": ["0,0 " * 10 + "0,0"] * 14}, "15 rows of 11 pairs"),
        ({"bend_points": ["0,0 " * 10 + "0"] * 15}, "15 rows of 11 pairs"),
        ({"bend_points": ["0,0 " * 10 + "0,nan"] * 15}, "15 rows of 11 pairs"),
        ({"bend_points": ["0,0 " * 10 + "0,99999"] * 15}, "15 rows of 11 pairs"),
    ],
)
def test_what_no_build_writes_is_refused(keys: dict[str, object], why: str) -> None:
    with pytest.raises(BadFile, match=why):
        parse_scene({"views": [keys]})
