"""What packages and examples may import."""

from pathlib import Path

import pytest
from imports import imports_of

ROOT = Path(__file__).parents[1]


def imported(folder: str) -> set[str]:
    """The packages that the files of a folder import."""
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    names = set().union(*(imports_of(file.read_text("utf-8")) for file in files))
    return {name.partition(".")[0] for name in names}


@pytest.mark.slow
def test_no_package_imports_a_script_or_a_test_and_no_example_a_test() -> None:
    for folder in ("knotfab", "validators", "formats", "fixtures"):
        assert not imported(folder) & {"examples", "benchmarks", "paper", "tests"}
    assert "tests" not in imported("examples")
    assert "tests" in imported("benchmarks")  # the corpus: the scan finds what there is
