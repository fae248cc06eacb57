"""What packages and examples may import, and how many lines there may be."""

from pathlib import Path

import pytest
from imports import imports_of

from benchmarks.lines import PRODUCT, count_lines, read_budget

ROOT = Path(__file__).parents[1]
PACKAGES = ("knotfab",)  # their folders are folders of tests/, too
SCRIPTS = ("examples", "benchmarks", "paper")  # each has one folder of tests, by its name
OWN = {
    "formats": ROOT / "formats" / "knotfab_formats",
    "validators": ROOT / "validators" / "knotfab_validators",
    "fixtures": ROOT / "fixtures",
}


def crossing(folder: str, barred: str) -> list[str]:
    """The files of a folder that import from the barred package."""
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    return [
        str(file.relative_to(ROOT))
        for file in files
        if any(f"{name}.".startswith(f"{barred}.") for name in imports_of(file.read_text("utf-8")))
    ]


@pytest.mark.slow
def test_no_example_imports_a_test() -> None:
    assert crossing("examples", "tests") == []


@pytest.mark.slow
@pytest.mark.parametrize("barred", ["examples", "benchmarks", "paper", "tests"])
def test_no_package_imports_a_script_or_a_test(barred: str) -> None:
    assert crossing("knotfab", barred) == crossing("validators", barred) == []
    assert crossing("formats", barred) == []


def test_a_file_that_crosses_is_named() -> None:
    # benchmarks do import the corpus of tests, so the scan must find some there
    assert "benchmarks/fuzz_files.py" in crossing("benchmarks", "tests")


@pytest.mark.parametrize("line", ["from benchmarks import frontier", "import benchmarks.frontier"])
def test_the_scan_sees_a_benchmark(line: str) -> None:
    assert any(f"{name}.".startswith("benchmarks.") for name in imports_of(line))


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="git tells which files count")
def test_no_more_lines_than_the_budget_allows() -> None:
    found, (product, everything) = count_lines(), read_budget()
    assert sum(found[folder] for folder in PRODUCT) <= product, "see CONTRIBUTING.md, make lines"
    assert sum(found.values()) <= everything, "see CONTRIBUTING.md, make lines"
