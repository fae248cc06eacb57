"""Where tests stand, and what packages and examples may import."""

from __future__ import annotations

from pathlib import Path

import pytest
from imports import imports_of

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


def test_every_folder_of_tests_is_one_of_a_package() -> None:
    folders = {p.parent.relative_to(ROOT / "tests") for p in (ROOT / "tests").rglob("test_*.py")}
    stray = []
    for folder in folders - {Path()}:
        top, *rest = folder.parts
        places = [OWN[top].joinpath(*rest)] if top in OWN else []
        places += [ROOT / package / folder for package in PACKAGES]
        if top in SCRIPTS:
            places.append(ROOT / folder)
        if not any(place.is_dir() for place in places):
            stray.append(str(folder))
    assert stray == []
