"""Every good and broken part of the corpus, validated: who is rejected, by which check, and where.

`python -m examples.studies.corpus_table [--only WORD] [--render]`
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.corpus.broken import broken
from examples.corpus.case import READ, Broken, Good, Place
from examples.corpus.files import write
from examples.corpus.good import good
from knotfab_validators import Check, validate

__all__ = ["Row", "corpus_rows", "main", "row_of", "summary"]

NAMED = 5
"""Of the places that a check names, worst first, so many may be the one."""

NO_RENDERING = "shadow-render"  # the exact polygons alone decide about shadows


@dataclass(frozen=True)
class Row:
    """What came of one case.

    `meant` is empty for a good one. `right` says whether the meant check rejected the broken case,
    or no required check the good one; `failed` are the required checks that failed. `away_mm` is how far the
    nearest named place is from the fault, None where the fault has no place or none was named.
    """

    name: str
    meant: str
    right: bool
    failed: tuple[str, ...]
    away_mm: float | None
    within_mm: float | None
    said: str
    seconds: float

    @property
    def placed(self) -> bool | None:
        """Whether the place was named nearly enough; None where the fault has none."""
        if self.within_mm is None:
            return None
        return self.away_mm is not None and self.away_mm <= self.within_mm


def corpus_rows(
    cases: Iterable[Broken | Good] | None = None, skip: Sequence[str] = (NO_RENDERING,)
) -> list[Row]:
    """Write each case to a temporary folder and validate it there; all cases by default."""
    chosen: list[Broken | Good] = [*broken(), *good()] if cases is None else list(cases)
    rows = []
    with tempfile.TemporaryDirectory() as root:
        for number, case in enumerate(chosen):
            folder = Path(root) / str(number)
            folder.mkdir()
            rows.append(row_of(case, folder, skip))
    return rows


def row_of(case: Broken | Good, folder: Path, skip: Sequence[str] = (NO_RENDERING,)) -> Row:
    """One case, written to a folder that exists, and validated."""
    part = case.make()
    files = write(part, folder)
    start = time.perf_counter()
    checks: tuple[Check, ...] = ()
    refusal = ""
    try:
        checks = validate(files.part, files.knots, files.scene, skip=skip).checks
    except ValueError as error:
        refusal = str(error)
    seconds = time.perf_counter() - start
    bad = [c for c in checks if c.required and c.status != "pass"]
    failed = (READ,) if refusal else tuple(c.name for c in bad if c.status == "fail")
    if isinstance(case, Good):
        said = refusal or "; ".join(f"{c.name} {c.status}: {c.detail}" for c in bad)
        return Row(case.name, "", not said, failed, None, None, said, seconds)
    meant = next((c for c in checks if c.name == case.meant), None)
    right = case.meant in failed and case.says.lower() in refusal.lower()
    if refusal or meant is None:
        said = refusal or f"there is no check {case.meant}"
    else:
        said = f"{meant.status} {meant.measured}: {meant.detail}"
    if case.places is None:
        return Row(case.name, case.meant, right, failed, None, None, said, seconds)
    named = () if meant is None else meant.at[:NAMED]
    away = _distance(named, tuple(case.places(part)))
    return Row(case.name, case.meant, right, failed, away, case.within_mm, said, seconds)


def summary(rows: Sequence[Row]) -> dict[str, tuple[int, int]]:
    """Counts as (how many, of how many): broken ones rejected, places named, good ones rejected."""
    bad, fine = [r for r in rows if r.meant], [r for r in rows if not r.meant]
    placed = [r.placed for r in bad if r.placed is not None]
    return {
        "broken parts rejected by the check meant for it": (sum(r.right for r in bad), len(bad)),
        "faults named within the place's tolerance": (sum(placed), len(placed)),
        "good parts rejected": (sum(not r.right for r in fine), len(fine)),
    }


def main() -> int:
    """Print the table and its sums; 1 unless all is as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="cases whose name or check has this word")
    parser.add_argument("--render", action="store_true", help="render the shadows too")
    asked = parser.parse_args()
    every: list[Broken | Good] = [*broken(), *good()]
    chosen = [c for c in every if asked.only in f"{c.name} {getattr(c, 'meant', 'good')}"]
    rows = corpus_rows(chosen, () if asked.render else (NO_RENDERING,))
    for row in rows:
        verdict = (
            ("rejected" if row.right else "MISSED")
            if row.meant
            else ("" if row.right else "REJECTED")
        )
        place = "" if row.placed is None else _place(row)
        others = ", ".join(f for f in row.failed if f != row.meant)
        print(f"{row.name[:58]:58}  {row.meant or 'good':22}  {verdict:8}  {place:22}  {others}")
        if not row.right or row.placed is False:
            print(f"      {row.said[:200]}")
    sums = summary(rows)
    print()
    for name, (count, total) in sums.items():
        print(f"{name}: {count}/{total}")
    print(f"{sum(r.seconds for r in rows):.1f} s of validation")
    return int(not all(r.right and r.placed is not False for r in rows))


def _place(row: Row) -> str:
    if row.away_mm is None:
        return "NO PLACE"
    return f"{row.away_mm:.2f} mm of {row.within_mm:g}" + ("" if row.placed else " FAR")


def _distance(named: Sequence[Place], true: Sequence[Place]) -> float | None:
    """The least distance between a named and a true place."""
    if not named or not true:
        return None
    apart = np.array(named)[:, None] - np.array(true)[None]
    return float(np.linalg.norm(apart, axis=2).min())


if __name__ == "__main__":
    raise SystemExit(main())
