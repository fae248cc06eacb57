"""Every good and broken part of the corpus, validated: who is rejected, by which check, and where.

`python -m benchmarks.corpus_table [--only WORD] [--render]`
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.measurement import run_study
from tests.corpus.broken import broken
from tests.corpus.case import Broken, Good
from tests.corpus.good import good
from tests.corpus.judge import NO_RENDERING, Row, judge_case


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
            rows.append(judge_case(case, folder, skip))
    return rows


def summary(rows: Sequence[Row]) -> dict[str, tuple[int, int]]:
    """Return counts as (how many, of how many): broken ones rejected, places named, good ones rejected."""
    bad, fine = [r for r in rows if r.meant], [r for r in rows if not r.meant]
    placed = [r.placed for r in bad if r.placed is not None]
    return {
        "broken parts rejected by the check meant for it": (sum(r.right for r in bad), len(bad)),
        "faults named within the place's tolerance": (sum(placed), len(placed)),
        "good parts rejected": (sum(not r.right for r in fine), len(fine)),
    }


def main(*, only: str = "", render: bool = False) -> int:
    """Print the table and its sums; 1 unless all is as it must be."""
    every: list[Broken | Good] = [*broken(), *good()]
    chosen = [c for c in every if only in f"{c.name} {getattr(c, 'meant', 'good')}"]
    rows = corpus_rows(chosen, () if render else (NO_RENDERING,))
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


if __name__ == "__main__":
    run_study(main)
