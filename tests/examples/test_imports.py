"""What examples, benchmarks and the paper's scripts import is there: no test runs all of them."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = [
    p for top in ("examples", "benchmarks", "paper") for p in sorted((ROOT / top).rglob("*.py"))
]
OWN = (
    "knotfab",
    "knotfab_validators",
    "knotfab_fixtures",
    "examples",
    "benchmarks",
    "paper",
    "tests",
)


def list_imports(path: Path) -> list[tuple[str, str]]:
    """(module, name) of every `from module import name` in a file, at whatever depth."""
    tree = ast.parse(path.read_text("utf-8"))
    return [
        (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in OWN
        for alias in node.names
    ]


def is_there(module: str, name: str) -> bool:
    """Tell whether a module has that name, or a submodule of it."""
    try:
        return hasattr(importlib.import_module(module), name) or bool(
            importlib.import_module(f"{module}.{name}")
        )
    except ModuleNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_every_name_that_a_script_imports_is_there(path: Path) -> None:
    missing = [pair for pair in list_imports(path) if not is_there(*pair)]
    assert missing == []


def test_a_name_that_is_gone_is_found(tmp_path: Path) -> None:
    script = tmp_path / "gone.py"
    script.write_text(
        "def f():\n    from knotfab.knots import Knots, gone\n    from knotfab.no import x\n"
    )
    found = [pair for pair in list_imports(script) if not is_there(*pair)]
    assert found == [("knotfab.knots", "gone"), ("knotfab.no", "x")]
