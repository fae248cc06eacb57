"""What numba keeps on disk: it looks at the file of a loop, and at no other, for whether it is still true."""

import ast
import gc
import importlib
import io
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numba
import pytest
from numba.core.dispatcher import Dispatcher

import knotfab
import knotfab_validators
from knotfab.base.progress import Progress


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


@pytest.mark.slow
def test_a_loop_uses_nothing_of_our_own_from_another_file() -> None:
    """A function or a number of another file would stay as it was when the loop was compiled."""
    seen = 0
    for module, loop in list_loops():
        assert module.__file__ is not None
        tree = ast.parse(Path(module.__file__).read_text("utf-8"))
        own = ("knotfab", "knotfab_validators")
        brought = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in own
            for alias in node.names
        }
        used = brought & set(loop.py_func.__code__.co_names)
        assert not used, f"{loop.py_func.__name__} of {module.__name__}"
        seen += 1
    assert seen > 50


@pytest.mark.slow
@pytest.mark.parametrize("package", ["knotfab.base.compiled", "knotfab_validators.arrays"])
def test_a_full_disk_or_no_place_to_write_keeps_no_loop_from_running(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is kept there already is used; else it is compiled for this process."""
    (tmp_path / "kept_loops.py").write_text("def double(number):\n    return 2.0 * number\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(numba.core.caching.config, "CACHE_DIR", str(tmp_path / "kept"))
    module = importlib.import_module(package)
    monkeypatch.setattr(module, "_LOOPS", [], raising=False)
    double = importlib.import_module("kept_loops").double

    def full(place: str) -> SimpleNamespace:
        return SimpleNamespace(free=0)

    def deny(*_: object, **__: object) -> None:
        raise RuntimeError("no locator available")

    for reason in (
        (module.shutil, "disk_usage", full),
        (numba.core.dispatcher, "FunctionCache", deny),
    ):
        with monkeypatch.context() as no_room:
            no_room.setattr(*reason)
            assert module.compiled(double)(1.5) == 3.0
            assert not list((tmp_path / "kept").rglob("*.nbi"))
    assert module.compiled(double)(1.5) == 3.0  # now there is room
    monkeypatch.setattr(module.shutil, "disk_usage", full)
    again = module.compiled(double)
    assert again(1.5) == 3.0 and sum(again.stats.cache_hits.values()) == 1
    sys.modules.pop("kept_loops")


@pytest.mark.slow
def test_a_build_tells_once_that_it_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meanwhile the garbage collector looks on more rarely; then it is left as it was."""
    for package in ("knotfab.base.compiled", "knotfab_validators.arrays"):
        importlib.import_module(package)
    told, quiet, usual = io.StringIO(), io.StringIO(), gc.get_threshold()
    seen: list[int] = []
    with Progress("auto", told), Progress("quiet", quiet) as progress:
        monkeypatch.setattr(progress, "say", lambda _: seen.append(gc.get_threshold()[0]))
        for number in (1.0, 2):
            assert numba.njit(lambda x: x + x)(number) == 2 * number
    assert told.getvalue().count("compiled") == 1 and not quiet.getvalue()
    assert len(seen) >= 2 and min(seen) > usual[0] and gc.get_threshold() == usual
    assert numba.njit(lambda x: x - x)(1.0) == 0.0
    assert told.getvalue().count("compiled") == 1
