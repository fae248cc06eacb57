"""Honest pieces on every holder pass, and some of those in `benchmarks.forgery_table` are rejected."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
from tables import some

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


@cache
def held(holder: str) -> Held:
    folder = Path(mkdtemp()) / "held"
    write_held(holder, folder)
    return Held.read(folder)


@pytest.mark.slow
@pytest.mark.parametrize("holder", some(HOLDERS, 2))
def test_an_honest_piece_passes(holder: str) -> None:
    assert judge(held(holder).folder, quick=False) == ()


@pytest.mark.slow
@pytest.mark.parametrize("case", some(forged()[::EVERY], 2), ids=lambda c: f"{c.holder}: {c.name}")
def test_a_forged_piece_is_rejected(case: Forged, tmp_path: Path) -> None:
    assert judge_forged(case, held(case.holder), tmp_path / "forged")


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_honest_frame_passes(number: int) -> None:
    assert judge_frame(sequence_folder(), number) == ()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "forge"), some(list(forged_sequence())[::3], 2))
def test_a_forged_frame_is_rejected(name: str, forge: Forge, tmp_path: Path) -> None:
    assert judge_frame(forge_frame(forge, tmp_path / "forged")), name
