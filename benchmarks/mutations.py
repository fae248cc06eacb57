"""A mutation study of the validators: which changed comparisons and limits do the tests notice?

`python -m benchmarks.mutations [--module NAME ...] [--list]`: each mutant is one comparison or limit
of `knotfab_validators` changed in a copy of the package; the tests that belong to its module run
against the copy. Exit code 1 if one of them survives that is not excused in `mutation_excuses`.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from benchmarks.measurement import run_study
from benchmarks.mutation_excuses import excuse

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "validators" / "knotfab_validators"
TESTS = ROOT / "tests"
CORPUS = TESTS / "validators" / "test_corpus.py"

OTHER = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
MAKERS = {"Check", "at_least", "at_most", "_judge"}
CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*\Z")
SECONDS = 300  # a mutant that takes longer is noticed too


@dataclass(frozen=True)
class Mutant:
    """One change of one module: the bytes from `start` to `end` become `now`.

    `module` is its dotted name within the package; `subject` is what it changes, without line numbers:
    the text of the comparison, or the constant's name.
    """

    module: str
    line: int
    subject: str
    was: str
    now: str
    start: int
    end: int

    def apply(self, source: bytes) -> bytes:
        return source[: self.start] + self.now.encode() + source[self.end :]

    @property
    def file(self) -> Path:
        """The module's file within the package."""
        return Path(self.module.replace(".", "/") + ".py")

    def __str__(self) -> str:
        return f"{self.file}:{self.line}  {self.subject}  [{self.was} to {self.now}]"


def mutants_of(path: Path) -> list[Mutant]:
    """Mutants of one module: of the comparisons that decide a check, and of its numeric constants.

    A constant (a name in capitals, at the module's level) grows and shrinks by 1 %, a whole number
    by at least one. A comparison decides a check if it stands in a function that makes one, or if
    it names such a constant: `<` becomes `<=`, `>` becomes `>=`, and back.
    """
    source, module = path.read_bytes(), _module_of(path)
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))

    def offset(line: int | None, column: int | None) -> int:
        assert line is not None and column is not None
        return starts[line - 1] + column

    tree = ast.parse(source)
    constants = dict(_constants(tree))
    found = []
    for node in _deciding(tree, set(constants)):
        subject = " ".join(ast.unparse(node).split())
        for left, right in pairwise([node.left, *node.comparators]):
            begin = offset(left.end_lineno, left.end_col_offset)
            sign = re.search(rb"[<>]=?", source[begin : offset(right.lineno, right.col_offset)])
            if sign is not None:
                was, at = sign.group().decode(), begin + sign.start()
                line = left.end_lineno or 0
                found.append(Mutant(module, line, subject, was, OTHER[was], at, at + len(was)))
    for name, value in constants.items():
        begin = offset(value.lineno, value.col_offset)
        until = offset(value.end_lineno, value.end_col_offset)
        was = source[begin:until].decode()
        for now in _nearby(value, was):
            found.append(Mutant(module, value.lineno, name, was, now, begin, until))
    return sorted(set(found), key=lambda m: (m.start, m.now))


def _deciding(tree: ast.Module, constants: set[str]) -> Iterator[ast.Compare]:
    """The comparisons in functions that make a check, and those with one of the constants."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            inside = list(ast.walk(node))
            calls = {call.func for call in inside if isinstance(call, ast.Call)}
            makes = any(isinstance(f, ast.Name) and f.id in MAKERS for f in calls)
            for compare in inside:
                if isinstance(compare, ast.Compare) and (makes or _names(compare) & constants):
                    yield compare


def _names(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _constants(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Numeric constants of the module's level: a number, or what is computed from numbers."""
    for node in tree.body:
        target: ast.expr | None = None
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target = node.targets[0]
        elif isinstance(node, ast.AnnAssign):
            target = node.target
        value: ast.expr | None = getattr(node, "value", None)
        if value is None or not isinstance(target, ast.Name):
            continue
        if CONSTANT.match(target.id) and _numeric(value):
            yield target.id, value


def _numeric(value: ast.expr | None) -> bool:
    """Whether an expression is one number, though maybe computed."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return _numeric(value.operand)
    if isinstance(value, ast.BinOp):
        return _numeric(value.left) or _numeric(value.right)
    if isinstance(value, ast.Call):  # float(np.cos(...)) and the like
        known = _names(value.func) <= {"float", "np", "math"}
        return known and all(_numeric(argument) for argument in value.args)
    return False


def _nearby(value: ast.expr, was: str) -> Iterable[str]:
    try:
        number = ast.literal_eval(value)
    except ValueError:
        number = None
    if isinstance(number, int):
        step = max(1, round(abs(number) * 0.01))
        return str(number + step), str(number - step)
    return f"1.01 * ({was})", f"0.99 * ({was})"


def _module_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts)


def tests_of(module: str) -> list[Path]:
    """The test files of a module: its own, or those of its folder; those that import it; the corpus."""
    folder, _, name = module.rpartition(".")
    own = TESTS / "validators" / folder.replace(".", "/") / f"test_{name}.py"
    inside = re.escape(f"knotfab_validators.{folder}".rstrip("."))
    names = re.compile(rf"{inside}(\.| import .*\b){name}\b")
    others = [p for p in sorted(TESTS.rglob("test_*.py")) if names.search(p.read_text())]
    near = [own] if own.exists() else sorted(own.parent.glob("test_*.py")) if folder else []
    return list(dict.fromkeys([*near, *others, CORPUS]))


def _fails(package: Path, tests: list[Path]) -> bool:
    """Whether some test fails with the package of this folder; without tests none does."""
    if not tests:
        return False
    environment = {
        **os.environ,
        "PYTHONPATH": str(package.parent),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *map(str, tests)],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def main(*, module: tuple[str, ...] = (), list_: bool = False) -> int:
    """Run the study and print what survives."""
    paths = [
        path for path in sorted(PACKAGE.rglob("*.py")) if not module or _module_of(path) in module
    ]
    every = [mutant for path in paths for mutant in mutants_of(path)]
    excused = {mutant: reason for mutant in every if (reason := excuse(mutant))}
    left = [mutant for mutant in every if mutant not in excused]
    print(f"{len(every)} mutants of {len(paths)} modules, {len(excused)} of them excused")
    if list_:
        for mutant in every:
            print(f"{mutant}" + (f"  -- {excused[mutant]}" if mutant in excused else ""))
        return 0
    survivors, unsound = _study(left)
    for path in unsound:
        print(f"left out, since it fails without a mutant: {path.name}")
    print(f"{len(left) - len(survivors)}/{len(left)} mutants noticed by a test")
    for mutant in survivors:
        print(f"survived: {mutant}")
    return int(bool(survivors or unsound))


def _study(mutants: list[Mutant]) -> tuple[list[Mutant], list[Path]]:
    """The mutants that no test notices, and the test files that fail anyhow and had no say."""
    survivors = []
    sound: dict[Path, bool] = {}
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / PACKAGE.name
        shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
        for mutant in mutants:
            tests = tests_of(mutant.module)
            for test in tests:
                if test not in sound:
                    sound[test] = not _fails(copy, [test])
            file = copy / mutant.file
            source = file.read_bytes()
            file.write_bytes(mutant.apply(source))
            noticed = _fails(copy, [test for test in tests if sound[test]])
            file.write_bytes(source)
            print(f"{'noticed ' if noticed else 'SURVIVED'}  {mutant}", flush=True)
            if not noticed:
                survivors.append(mutant)
    return survivors, [test for test in sound if not sound[test]]


if __name__ == "__main__":
    run_study(main)
