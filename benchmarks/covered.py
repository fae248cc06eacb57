"""How much of the product runs: in a default build, or in `make test` beside `make all-tests`.

`python -m benchmarks.covered --build` runs `build examples/heart.png --print --accuracy sketch` and prints
for each folder how many statements of function bodies it ran. `python -m benchmarks.covered` runs the
tests, then the studies, and prints how many of the lines that all of them reach those of `make test` do (half
an hour). Child processes count; loops that numba compiles cannot be followed, and are left out.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.lines import PRODUCT, ROOT
from benchmarks.measurement import run_study

SETTINGS = """[run]
source_pkgs = knotfab, knotfab_formats, knotfab_validators, knotfab_fixtures
parallel = true
patch = subprocess
data_file = {data}
sigterm = true
"""
# the copy that reads a picture is killed before coverage could write, so the build reads it itself
WHOLE = """import runpy
import knotfab.base.limited
knotfab.base.limited._is_copy = True
runpy.run_module("knotfab", run_name="__main__")
"""
BUILD = (
    "{whole} build examples/heart.png --print --accuracy sketch --skip slicer --quiet --out {out}"
)
TESTS = "-m pytest -q -n 2 --dist loadgroup -p no:cacheprovider"


def reach(command: list[str], place: Path) -> dict[str, set[int]]:
    """Run Python with these arguments; return the lines that it and its children ran, by file."""
    import coverage

    place.mkdir()
    settings = place / "settings"
    settings.write_text(SETTINGS.format(data=place / "data"))
    call = [sys.executable, "-m", "coverage", "run", f"--rcfile={settings}", *command]
    done = subprocess.run(call, cwd=ROOT, env={**os.environ, "PYTHONPATH": ""})
    if done.returncode:  # what a failed test reaches counts too
        print(f"{' '.join(command)} ended with {done.returncode}", file=sys.stderr)
    counted = coverage.Coverage(data_file=str(place / "data"), config_file=str(settings))
    counted.combine()
    data = counted.get_data()
    return {
        os.path.relpath(file, ROOT): set(data.lines(file) or ()) for file in data.measured_files()
    }


def statements(tree: ast.AST) -> Iterator[ast.stmt]:
    """Yield the statements of function bodies, but for docstrings and loops that numba compiles."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if any("compiled" in ast.unparse(mark) for mark in node.decorator_list):
            continue
        yield from _inner(node.body)


def _inner(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    for one in body:
        if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue  # walked by itself
        if isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant):
            continue
        yield one
        for block in ("body", "orelse", "finalbody"):
            yield from _inner(getattr(one, block, []))
        for handler in [*getattr(one, "handlers", []), *getattr(one, "cases", [])]:
            yield from _inner(handler.body)


def print_build() -> None:
    """Print for each folder how many of its statements a default build runs."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "out"
        whole = Path(place) / "whole.py"
        whole.write_text(WHOLE)
        ran = reach(BUILD.format(out=out, whole=whole).split(), Path(place) / "counted")
    whole: dict[str, list[int]] = {}
    for package in PRODUCT:
        for file in sorted((ROOT / package).rglob("*.py")):
            name = str(file.relative_to(ROOT))
            parts = name.split("/")
            key = "/".join(parts[:2]) if package == "knotfab" and len(parts) > 2 else package
            lines = [one.lineno for one in statements(ast.parse(file.read_text("utf-8")))]
            found = sum(line in ran.get(name, ()) for line in lines)
            for group in {key, package}:
                counts = whole.setdefault(group, [0, 0])
                counts[0], counts[1] = counts[0] + found, counts[1] + len(lines)
    for group, (found, count) in sorted(whole.items()):
        if count:
            print(f"{group:<22} {found:>6} of {count:>6} statements  {100 * found / count:3.0f} %")


def main(*, build: bool = False) -> None:
    """Print what runs."""
    if build:
        print_build()
        return
    with tempfile.TemporaryDirectory() as place:
        usual = reach([*TESTS.split(), "-m", "not study"], Path(place) / "usual")
        every = reach([*TESTS.split(), "-m", "study"], Path(place) / "studies")
    for name, lines in usual.items():
        every[name] = every.get(name, set()) | lines
    reached = sum(len(lines & usual.get(name, set())) for name, lines in every.items())
    all_lines = sum(map(len, every.values()))
    print(
        f"make test reaches {reached} of {all_lines} lines that make all-tests reaches: "
        f"{100 * reached / all_lines:.1f} %"
    )


if __name__ == "__main__":
    run_study(main)
