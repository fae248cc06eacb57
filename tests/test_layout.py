"""Where tests stand, and what they may import: no study, as no study imports a test."""

from __future__ import annotations

from pathlib import Path

import pytest
from imports import imports_of

ROOT = Path(__file__).parents[1]
PACKAGES = ("knotfab", "examples")  # their folders are folders of tests/, too
OWN = {"validators": ROOT / "validators" / "knotfab_validators", "fixtures": ROOT / "fixtures"}


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
def test_no_test_imports_a_study_and_no_example_a_test() -> None:
    assert crossing("tests", "examples.studies") == []
    assert crossing("examples", "tests") == []


def test_a_file_that_crosses_is_named() -> None:
    # studies do import studies, so the scan must find some there
    assert "examples/studies/hard_cases.py" in crossing("examples/studies", "examples.studies")


@pytest.mark.parametrize(
    "line", ["from examples import studies", "import examples.studies.frontier"]
)
def test_the_scan_sees_a_study(line: str) -> None:
    assert any(f"{name}.".startswith("examples.studies.") for name in imports_of(line))


def test_every_folder_of_tests_is_one_of_a_package() -> None:
    folders = {p.parent.relative_to(ROOT / "tests") for p in (ROOT / "tests").rglob("test_*.py")}
    stray = []
    for folder in folders - {Path()}:
        top, *rest = folder.parts
        places = [OWN[top].joinpath(*rest)] if top in OWN else []
        places += [ROOT / package / folder for package in PACKAGES]
        if top == "examples":
            places.append(ROOT / folder)
        if not any(place.is_dir() for place in places):
            stray.append(str(folder))
    assert stray == []
