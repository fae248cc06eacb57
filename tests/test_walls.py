"""What a light command may load; the walls between the packages are import-linter's (`make lint`)."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import picture, square

HEAVY = ("torch", "vtk", "vtkmodules", "pyvista", "cadquery", "OCP")

# Runs commands one after the other in a process of its own, and tells what of the heavy each loaded.
RUN = """
import json, sys
import knotfab
knotfab.Scene, knotfab.InputError, knotfab.Knots
from knotfab.cli.app import main
told = [["import", None, [m for m in HEAVY if m in sys.modules]]]
for call in json.loads(sys.argv[1]):
    code = None
    try:
        main(call)
    except SystemExit as left:
        code = left.code
    told.append([" ".join(call), code, [m for m in HEAVY if m in sys.modules]])
import knotfab.pipeline  # starts its validators before it loads what it needs itself
told.append(["import", None, [m for m in HEAVY if m in sys.modules]])
print(json.dumps(told), file=sys.__stderr__)
"""
LIGHT = [["--help"], ["build", "--help"], ["printers"]]
REFUSED = [
    ["build", "nowhere.png", "--accuracy", "superb"],
    ["build", "missing.png"],
    ["build", "blank.png"],
    ["build", "words.png"],
    ["build", "good.png", "missing.png"],
    ["build", "text: "],
    ["build", "page.svg"],
    ["build", "good.png", "--tube-radius", "thick"],
    ["build", "good.png", "--time-budget", "soon"],
    ["build", "good.png", "--printer", "nonsense"],
    ["build", "good.png", "--skip", "everything"],
    ["build", "good.png", "--font", "DejaVu Sans"],
    ["build", "good.png", "--knot", "9_99"],
    ["build", "good.png", "--scene", "missing.toml"],
    ["build", "good.png", "--scene", "search.toml"],
    ["build", "--sequence", "good.png"],
    ["build"],
    ["tradeoff", "missing.png"],
    ["tradeoff", "blank.png", "--accuracy", "draft"],
    ["validate", "missing"],
]


def run(folder: Path, calls: list[list[str]], before: str = "") -> list[tuple[str, int, list[str]]]:
    """Of each call its exit code, and what heavy libraries are loaded after it."""
    code = f"{before}\nHEAVY = {HEAVY!r}\n{RUN}"
    done = subprocess.run(
        [sys.executable, "-c", code, json.dumps(calls)],
        cwd=folder,
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return [tuple(told) for told in json.loads(done.stderr.splitlines()[-1])]


@pytest.mark.slow
def test_a_light_command_and_what_is_refused_load_nothing_heavy(tmp_path: Path) -> None:
    picture(tmp_path / "good.png", square())
    picture(tmp_path / "blank.png", np.zeros((64, 64), dtype=bool))
    (tmp_path / "words.png").write_text("I am no picture.")
    (tmp_path / "page.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="0"/>')
    (tmp_path / "search.toml").write_text("[search]\niterations = 10\n")
    told = run(tmp_path, [*LIGHT, *REFUSED])
    for call, code, heavy in told:
        assert not heavy, f"{call} loads {heavy}"
        assert code == (0 if call.split() in LIGHT else None if call == "import" else 2), call


@pytest.mark.slow
def test_what_was_loaded_is_seen(tmp_path: Path) -> None:
    for _, _, heavy in run(tmp_path, [["validate", "missing"]], "import torch"):
        assert heavy == ["torch"]


@pytest.mark.parametrize("folder", ["validators", "fixtures"])
def test_the_folders_are_no_packages(folder: str) -> None:
    """`validators` and `fixtures` are import names of packages that others publish."""
    assert not (Path(__file__).parents[1] / folder / "__init__.py").exists()
