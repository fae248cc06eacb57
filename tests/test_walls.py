"""The walls between the packages, and what a light command may load."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import knotfab_fixtures
import knotfab_validators

HEAVY = ("torch", "vtk", "vtkmodules", "pyvista", "cadquery", "OCP")
WALLS = {
    knotfab_validators: (
        "knotfab", "knotfab_fixtures", "torch", "cadquery", "OCP", "manifold3d", "trimesh",
    ),
    knotfab_fixtures: ("knotfab", "knotfab_validators", "torch"),
}  # fmt: skip


def imports_of(source: str) -> set[str]:
    """Every absolute name that a file imports, wherever in it the import stands."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        elif (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name | ast.Attribute)
            and (getattr(node.func, "id", None) or getattr(node.func, "attr", None))
            in ("import_module", "__import__")
            and node.args
            and isinstance(node.args[0], ast.Constant)
        ):
            found.add(str(node.args[0].value))
    return found


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
    ],
    ids=["import", "help", "build-help", "wrong-call"],
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


@pytest.mark.parametrize("folder", ["validators", "fixtures"])
def test_the_folders_are_no_packages(folder: str) -> None:
    """`validators` and `fixtures` are import names of packages that others publish."""
    assert not (Path(__file__).parents[1] / folder / "__init__.py").exists()
