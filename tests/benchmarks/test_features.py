"""The table of features: the quickest build of each row, and refusals that name the physical reason."""

from pathlib import Path

import pytest

from benchmarks.features import CELLS, ROWS, Cell, build_cell

# rows that other tests cover, at a lower cost than a whole build
ELSEWHERE = {
    "wall mount": "tests/pipeline/test_build.py",
    "desk stand": "tests/hold",
    "eyelet for a thread": "tests/hold/test_hang.py",
    "depth given": "tests/pipeline/test_build.py",
    "flat": "tests/pipeline/test_build.py",
    "slicing": "tests/part/test_slicer.py",
    "files for other tools": "tests/pipeline/test_piece.py",
    "subject of a photograph": "tests/picture/test_subject.py",
    "network (inn)": "tests/apps/paper/test_network_search.py",
    "network, then flow (inn+flow)": "tests/apps/paper/test_network_search.py",
    "region mesh": "tests/limits/test_region.py",
    "time budget": "tests/search/test_free_pose.py",
    "price of a limit": "tests/design/test_retries.py",
    "sparser filling": "tests/pipeline/test_build.py",
    "wire plan": "tests/apps/wire/test_plan.py",
    "view found in the search": "tests/search/test_free_pose.py",
}
assert all(Path(__file__).parents[2].joinpath(place).exists() for place in ELSEWHERE.values())
QUICKEST = [Cell(row, row.quickest) for row in ROWS if row.name not in ELSEWHERE]


@pytest.mark.build
@pytest.mark.parametrize("cell", QUICKEST, ids=lambda c: c.row.name)
def test_the_quickest_build_of_each_row(cell: Cell, tmp_path: Path) -> None:
    good, said = build_cell(cell, tmp_path)
    assert good, said


@pytest.mark.parametrize(
    "cell", [c for c in CELLS if c.refusal], ids=lambda c: f"{c.row.name}, {c.column}"
)
def test_a_refusal_names_the_physical_reason(cell: Cell, tmp_path: Path) -> None:
    good, said = build_cell(cell, tmp_path)
    assert good and said.startswith("refused: "), said
    assert not (tmp_path / "out").exists()
