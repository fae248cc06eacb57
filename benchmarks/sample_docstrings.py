"""Docstrings of the product drawn at random, for a reader who judges whether a person would write so.

`python -m benchmarks.sample_docstrings --seed 7` prints a hundred, each with its file and line.
"""

from __future__ import annotations

import ast
import random
from pathlib import Path

from benchmarks.lines import PRODUCT, ROOT
from benchmarks.measurement import run_study

KINDS = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def list_docstrings() -> list[tuple[Path, int, str, str]]:
    """List (file, line, name, docstring) of every module, class and function of the product."""
    found = []
    for path in sorted(p for folder in PRODUCT for p in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, KINDS) and (text := ast.get_docstring(node)):
                line = getattr(node, "lineno", 1)
                name = getattr(node, "name", path.stem)
                found.append((path.relative_to(ROOT), line, name, text))
    return found


def main(seed: int = 0, count: int = 100) -> None:
    """Print `count` docstrings drawn with `seed`."""
    every = list_docstrings()
    for path, line, name, text in random.Random(seed).sample(every, min(count, len(every))):
        print(f"{path}:{line} {name}\n    " + text.replace("\n", "\n    ") + "\n")
    print(f"{count} of {len(every)} docstrings")


if __name__ == "__main__":
    run_study(main)
