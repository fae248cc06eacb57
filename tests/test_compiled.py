"""What numba keeps on disk: it looks at the file of a loop, and at no other, for whether it is still true."""

from __future__ import annotations

import ast
import errno
import importlib
import pkgutil
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
@pytest.mark.parametrize("package", ["knotfab", "knotfab_validators"])
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
