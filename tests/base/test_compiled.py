"""What numba keeps on disk: it looks at the file of a loop, and at no other, for whether it is still true."""

from __future__ import annotations

import ast
import errno
import importlib
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

import knotfab
import knotfab_validators


def list_loops() -> Iterator[tuple[ModuleType, Dispatcher]]:
    """Every compiled function of both packages, in the module that defines it."""
    for package in (knotfab, knotfab_validators):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            path = Path(importlib.util.find_spec(found.name).origin or "")
            if not found.name.endswith("__main__") and "@compiled" in path.read_text("utf-8"):
                module = importlib.import_module(found.name)
                for value in vars(module).values():
                    if isinstance(value, Dispatcher) and value.py_func.__module__ == found.name:
                        yield module, value


LOOPS = {
    f"{module.__name__}.{loop.py_func.__name__}": (module, loop) for module, loop in list_loops()
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_uses_nothing_of_our_own_from_another_file(name: str) -> None:
    """A function or a number of another file would stay as it was when the loop was compiled."""
    module, loop = LOOPS[name]
    assert module.__file__ is not None
    tree = ast.parse(Path(module.__file__).read_text("utf-8"))
    own = ("knotfab", "knotfab_validators")
    brought = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in own
        for alias in node.names
    }
    assert not brought & set(loop.py_func.__code__.co_names)


@pytest.mark.slow
@pytest.mark.parametrize("package", ["knotfab.base", "knotfab_validators"])
def test_a_full_disk_keeps_no_loop_from_running(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def save(*_: object) -> None:
        tried.append(True)
        raise OSError(errno.ENOSPC, "No space left on device")

    def double(number: float) -> float:
        return 2.0 * number

    monkeypatch.setattr(IndexDataCacheFile, "save", save)
    module = importlib.import_module(f"{package}.compiled")
    monkeypatch.setattr(module, "_LOOPS", [], raising=False)
    assert module.compiled(double)(1.5) == 3.0
    assert tried


_IN_A_PROCESS_OF_ITS_OWN = """
import sys
import numpy as np
from numba.core.registry import cpu_target
from {package}.compiled import compiled
sys.path.insert(0, {folder!r})
import kept_loops
loops = [compiled(f) for f in (kept_loops.total, kept_loops.rows)]
assert loops[0](np.arange(4.0)) == 6.0
assert (loops[1](np.arange(4), 2) == np.array([[0, 1], [2, 3]])).all()
print(sum(sum(loop.stats.cache_hits.values()) for loop in loops), len(cpu_target.target_context._defns))
assert loops[0](np.arange(4)) == 6  # of integers: compiled now, after others were only loaded
"""
_LOOPS_IN_A_FILE = """
import math
import numpy as np
def total(numbers):
    found = 0.0
    for number in numbers:
        found += math.fabs(number)
    return found
def rows(numbers, width):
    return np.stack((numbers[:width], numbers[width:])) + np.zeros(1, np.int64)
"""


@pytest.mark.slow
@pytest.mark.parametrize("package", ["knotfab.base", "knotfab_validators"])
def test_what_is_kept_runs_without_the_tables_that_compiling_needs(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of functions whose code allocates, calls C and raises; and more can still be compiled afterwards."""
    (tmp_path / "kept_loops.py").write_text(_LOOPS_IN_A_FILE, "utf-8")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    code = _IN_A_PROCESS_OF_ITS_OWN.format(package=package, folder=str(tmp_path))
    said = [
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
        for _ in range(2)
    ]
    (compiled_hits, compiled_tables), (kept_hits, kept_tables) = said
    assert (compiled_hits, kept_hits) == ("0", "2")
    assert int(kept_tables) < int(compiled_tables) / 10
