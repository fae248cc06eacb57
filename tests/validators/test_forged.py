"""Honest pieces on every holder pass, and some of those in `benchmarks.forgery_table` are rejected."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
from tables import some

from tests.corpus.drawn import drawn_forgeries
from tests.corpus.forged import Forged, forged, judge, judge_forged
from tests.corpus.forged_sequence import (
    Forge,
    forge_frame,
    forged_sequence,
    judge_frame,
    sequence_folder,
)
from tests.corpus.forging import HOLDERS, Held, write_held

EVERY = 8  # of the forgeries, so many are left to the table for each that is tried here
# one of each way to hold a piece: bars, a plate and feet; the frame of lamps has checks of its own
HONEST = {"stand", "outline plate", "lamp frame"}
FORGED = {
    "members thinned in all files",
    "dowel shortened a little",
    "member 0 cut off at its foot",
    "one of rods left out of all files",
    "void under a foot",
    "no bars in knots.json",
    "no bars in the scene",
}
BROUGHT = {  # as hostile people brought them
    ("outline plate", "a letter on the plate"),
    ("outline plate", "screw holes of 1 mm"),
    ("wall pegs", "a post on the plate"),
    ("drilled holes", "a collar on a dowel"),
}


@cache
def held(holder: str) -> Held:
    folder = Path(mkdtemp()) / "held"
    write_held(holder, folder)
    return Held.read(folder)


@pytest.mark.slow
@pytest.mark.parametrize(
    "holder", [pytest.param(h, marks=[pytest.mark.study] * (h not in HONEST)) for h in HOLDERS]
)
def test_an_honest_piece_passes(holder: str) -> None:
    assert judge(held(holder).folder) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            id=f"{case.holder}: {case.name}",
            # a hanger takes longest to plan; pegs have its forgery
            marks=[pytest.mark.study]
            * (not brought and (case.name not in FORGED or case.holder == "hang")),
        )
        for number, case in enumerate(forged())
        if (brought := (case.holder, case.name) in BROUGHT) or number % EVERY == 0
    ],
)
def test_a_forged_piece_is_rejected(case: Forged, tmp_path: Path) -> None:
    assert judge_forged(case, held(case.holder), tmp_path / "forged")


@pytest.mark.slow
@pytest.mark.parametrize("case", some(drawn_forgeries(69, 16), 4), ids=lambda case: case.name)
def test_a_drawn_forgery_is_rejected(case: Forged, tmp_path: Path) -> None:
    assert judge_forged(case, held(case.holder), tmp_path / "forged")


@pytest.mark.slow
@pytest.mark.parametrize("number", some([1, 2, 3], 3))
def test_an_honest_frame_passes(number: int) -> None:
    assert judge_frame(sequence_folder(), number) == ()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "forge"), some(list(forged_sequence())[::3], 2))
def test_a_forged_frame_is_rejected(name: str, forge: Forge, tmp_path: Path) -> None:
    assert judge_frame(forge_frame(forge, tmp_path / "forged")), name
