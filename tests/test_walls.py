"""The walls between the packages, and what a light command may load."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import picture, square
from imports import imports_of

import knotfab_fixtures
import knotfab_validators

HEAVY = ("torch", "vtk", "vtkmodules", "pyvista", "cadquery", "OCP")
WALLS = {
    knotfab_validators: (
        "knotfab", "knotfab_fixtures", "torch", "cadquery", "OCP", "manifold3d", "trimesh",
    ),
    knotfab_fixtures: ("knotfab", "knotfab_validators", "torch"),
}  # fmt: skip


def behind(name: str, banned: tuple[str, ...]) -> bool:
    return any(name == b or name.startswith(b + ".") for b in banned)


@pytest.mark.parametrize("package", WALLS, ids=lambda p: p.__name__)
def test_no_file_imports_from_behind_the_wall(package: object) -> None:
    files = sorted(Path(str(package.__file__)).parent.rglob("*.py"))  # type: ignore[attr-defined]
    assert files
    for file in files:
        crossing = [
            n for n in imports_of(file.read_text(encoding="utf-8")) if behind(n, WALLS[package])
        ]  # type: ignore[index]
        assert not crossing, f"{file.name} imports {crossing}"


@pytest.mark.parametrize(
    "line",
    [
        "import torch.nn as nn",
        "from trimesh import boolean",
        "def f():\n    from knotfab.knots import Knots",
        "import importlib\nimportlib.import_module('manifold3d')",
    ],
)
def test_the_scan_sees_an_import(line: str) -> None:
    assert any(behind(n, WALLS[knotfab_validators]) for n in imports_of(line))


def test_a_namesake_is_no_import_from_behind_the_wall() -> None:
    names = imports_of("import knotfab_validators.check\nfrom .knotfab import x\nimport trimeshes")
    assert not any(behind(n, WALLS[knotfab_validators]) for n in names)


@pytest.mark.parametrize(
    "call",
    [
        ["-c", "import knotfab"],
        ["-m", "knotfab", "--help"],
        ["-m", "knotfab", "build", "--help"],
        ["-m", "knotfab", "build", "nowhere.png", "--accuracy", "superb"],
        ["-m", "knotfab", "printers"],
    ],
    ids=["import", "help", "build-help", "wrong-call", "printers"],
)
def test_a_light_command_loads_nothing_heavy(call: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *call],
        capture_output=True,
        encoding="utf-8",
        timeout=60,
    )
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines() if "|" in line}
    assert "knotfab" in loaded
    heavy = {name for name in loaded if behind(name, HEAVY)}
    assert not heavy, sorted(heavy)[:5]


# Runs a command in a process of its own and prints what that left in sys.modules.
REFUSED = """
import sys
from knotfab.cli.app import main
try:
    main(sys.argv[1:])
except SystemExit as left:
    print(*sys.modules, sep="\\n")
    sys.exit(left.code)
"""


@pytest.mark.parametrize(
    "call",
    [
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
    ],
    ids=" ".join,
)
def test_what_is_refused_loads_nothing_heavy(tmp_path: Path, call: list[str]) -> None:
    picture(tmp_path / "good.png", square())
    picture(tmp_path / "blank.png", np.zeros((64, 64), dtype=bool))
    (tmp_path / "words.png").write_text("I am no picture.")
    (tmp_path / "page.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="0"/>')
    (tmp_path / "search.toml").write_text("[search]\niterations = 10\n")
    done = subprocess.run(
        [sys.executable, "-c", REFUSED, *call], cwd=tmp_path, capture_output=True, encoding="utf-8"
    )
    assert done.returncode == 2 and done.stderr.startswith("knotfab: "), done.stderr
    loaded = done.stdout.split()
    assert "knotfab.cli.app" in loaded
    heavy = [name for name in loaded if behind(name, HEAVY)]
    assert not heavy, heavy[:5]


def test_the_scan_of_what_was_loaded_sees_torch() -> None:
    done = subprocess.run(
        [sys.executable, "-c", f"import torch\n{REFUSED}", "validate", "missing"],
        capture_output=True,
        encoding="utf-8",
    )
    assert any(behind(name, HEAVY) for name in done.stdout.split())


@pytest.mark.parametrize("folder", ["validators", "fixtures"])
def test_the_folders_are_no_packages(folder: str) -> None:
    """`validators` and `fixtures` are import names of packages that others publish."""
    assert not (Path(__file__).parents[1] / folder / "__init__.py").exists()
