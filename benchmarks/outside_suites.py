"""Folders of other projects' files, each validated or previewed: what was read, refused, or told wrongly.

`python -m benchmarks.outside_suites DIR [--seconds 120]`, or `make outside-suites DIR=…`

Meshes and files of knots go through `knotfab validate`, pictures through `knotfab preview`. A folder or
file with MUSTPASS or MUSTFAIL in its name, as the 3MF Consortium's suites have it, says what is expected.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

MESHES = {".3mf", ".stl", ".obj", ".ply"}
PICTURES = {".png", ".gif", ".jpg", ".jpeg", ".bmp", ".webp", ".svg"}
TOLD = {0: "passes", 1: "a check fails", 2: "refused", 3: "unable", None: "out of time"}
Call = Literal["part", "knots", "picture"]


@dataclass(frozen=True)
class Outcome:
    """How one file ended: its exit code (None: out of time), what is expected, and the last sentence said."""

    path: Path
    suite: str
    code: int | None
    wanted: str
    said: str

    @property
    def wrong(self) -> bool:
        """True if it crashed, hung, or is not as its suite wants it.

        What must pass may fail a check: a good package need not hold a sound part. It must be read.
        """
        if self.code not in (0, 1, 2, 3):
            return True
        return (self.wanted == "pass" and self.code > 1) or (
            self.wanted == "fail" and self.code == 0
        )


def kind_of(path: Path) -> Call | None:
    """Return what a file is taken for, by the end of its name; None: it is passed over."""
    end = path.suffix.lower()
    if end == ".json":
        return "knots"
    return "part" if end in MESHES else "picture" if end in PICTURES else None


def list_files(root: Path) -> Iterator[Path]:
    """Yield all files below a folder that are looked at, in order; none whose name begins with a dot."""
    for path in sorted(root.rglob("*")):
        if path.is_file() and not path.name.startswith(".") and kind_of(path):
            yield path


def expected(path: Path) -> str:
    """Return "pass", "fail", or "" where no name says it; the innermost name decides."""
    for name in (path.name, *(folder.name for folder in path.parents)):
        plain = name.upper().replace("_", "").replace("-", "").replace(" ", "")
        if "MUSTPASS" in plain or "MUSTFAIL" in plain:
            return "pass" if "MUSTPASS" in plain else "fail"
    return ""


def call_command(path: Path, seconds: float) -> tuple[int | None, str]:
    """Return the exit code of the command for a file (None: out of time), and its last line."""
    kind = kind_of(path)
    picked = ["--knots", str(path)] if kind == "knots" else ["--", str(path)]
    with tempfile.TemporaryDirectory() as place:
        drawn = str(Path(place) / "drawn.png")
        call = ["preview", "--json", "--out"] if kind == "picture" else ["validate", "--failures"]
        command = [sys.executable, "-m", "knotfab", *call, drawn, *picked]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return None, ""
    lines = (done.stderr if done.returncode not in (0, 1) else done.stdout).strip().splitlines()
    return done.returncode, (
        lines[-1] if done.returncode not in (0, 1) else lines[0]
    ) if lines else ""


def run_all(
    root: Path, run: Callable[[Path], tuple[int | None, str]], say: Callable[[str], None] = print
) -> list[Outcome]:
    """Return each file below `root`; its suite is the folder below `root` that it lies in."""
    found = []
    for path in list_files(root):
        inner = path.relative_to(root).parts
        code, said = run(path)
        suite = inner[0] if len(inner) > 1 else "."
        found.append(Outcome(path, suite, code, expected(path.relative_to(root)), said))
        if found[-1].wrong:
            say(f"{path.relative_to(root)}: {TOLD.get(code, f'ends with {code}')}; {said}")
    return found


def table(outcomes: Sequence[Outcome]) -> str:
    """Return one row a suite: its files by how they ended, and how many of them wrongly."""
    words = [*TOLD.values(), "crashes"]
    rows = [["suite", "files", *words, "wrong"]]
    for suite in dict.fromkeys(o.suite for o in outcomes):
        own = [o for o in outcomes if o.suite == suite]
        count = Counter(TOLD.get(o.code, "crashes") for o in own)
        rows.append(
            [suite, str(len(own)), *(str(count[w]) for w in words), str(sum(o.wrong for o in own))]
        )
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=120.0, help="for each file")
    asked = parser.parse_args()
    if not asked.folder.is_dir():
        parser.error(f"{asked.folder} is no folder")
    outcomes = run_all(asked.folder, lambda path: call_command(path, asked.seconds))
    print(table(outcomes))
    return int(any(o.wrong for o in outcomes))


if __name__ == "__main__":
    sys.exit(main())
