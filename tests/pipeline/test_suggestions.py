"""Every refusal names an option that would do, and that option does: each suggestion is tried."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from knotfab.base.errors import SceneError
from knotfab.design import sentence
from knotfab.pipeline.options import options_from
from knotfab.pipeline.prepare import survey_pictures
from knotfab_formats.errors import KnotfabError

HERE = Path(__file__).parents[2] / "examples"
CAT, HEART, TEAPOT = (str(HERE / f"{name}.png") for name in ("cat", "heart", "teapot"))
# what is asked, and the option that the refusal names; its value, where it is not in the text
REFUSED: dict[str, tuple[tuple[str, ...], dict[str, object], str, str | None]] = {
    "too long": ((CAT,), {"max_hours": 3}, "size", None),
    "too heavy": ((CAT,), {"max_grams": 25}, "size", None),
    "too heavy, with a tube of its own": (
        (HEART,),
        {"max_grams": 30, "tube_radius": 2},
        "size",
        None,
    ),
    "no such nozzle": ((HEART,), {"nozzle": 3}, "nozzle", "0.6"),
    "no such printer": ((HEART,), {"printer": "prusa-mk5"}, "printer", r"prusa-mk\d"),
    "two sizes": ((HEART,), {"size": 100, "width": 90}, "size", "100"),
    "pegs for two pictures": ((HEART, TEAPOT), {"mount": "wall"}, "mount", None),
}


def refuse(pictures: tuple[str, ...], asked: dict[str, object]) -> KnotfabError | SceneError | None:
    try:
        return survey_pictures(pictures, options_from({"accuracy": "sketch", **asked})).refusal
    except KnotfabError as error:
        return error


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_refusal_suggests_does(case: str) -> None:
    pictures, asked, option, value = REFUSED[case]
    error = refuse(pictures, asked)
    assert error is not None and error.remedy
    if value is None:
        found = re.search(rf"--{option} ([\w.-]+)", error.remedy)
        assert found is not None, error.remedy
        value = found[1]
    elif not value.isdigit():
        found = re.search(value, error.remedy)
        assert found is not None, error.remedy
        value = found[0]
    kept = {key: given for key, given in asked.items() if key not in (option, "width")}
    given: object = float(value) if re.fullmatch(r"[\d.]+", value) else value
    assert refuse(pictures, {**kept, option: given}) is None


def test_a_piece_larger_than_the_bed_or_two_days_is_told_with_a_size_that_is_neither(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sentence, "_LONG_H", 8.0)  # a cat of 440 mm takes a day and a half

    def said(**asked: object) -> str:
        found = survey_pictures((CAT,), options_from({"accuracy": "sketch", **asked}))
        return "\n".join(sentence.describe(found))

    for size, words in ((600, "larger than"), (220, "two days")):
        told = said(size=size)
        assert words in told
        better = re.search(r"--size (\d+) would", told)
        assert better is not None
        assert words not in said(size=float(better[1]))
