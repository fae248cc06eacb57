"""Forged and honest pieces on every holder, validated: who is rejected, and by which checks.

`python -m benchmarks.forgery_table [--only HOLDER]`
"""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path

from benchmarks.measurement import run_study
from tests.corpus.forged import forged, judge, judge_forged
from tests.corpus.forging import Held
from tests.corpus.held import HOLDERS, write_held


def main(*, only: str = "") -> int:
    """Print the table, and the counts of each holder; 1 unless all forgeries are told and no honest piece."""
    told: Counter[str] = Counter()
    count: Counter[str] = Counter()
    alarms = 0
    with tempfile.TemporaryDirectory() as root:
        for holder in (h for h in HOLDERS if only in h):
            write_held(holder, Path(root) / holder)
            held = Held.read(Path(root) / holder)
            failed = judge(held.folder, quick=False)
            alarms += bool(failed)
            print(
                f"{holder:15} {'as it was written':42} {'REJECTED ' if failed else ''}{' '.join(failed)}"
            )
            for case in (c for c in forged() if c.holder == holder):
                failed = judge_forged(case, held, Path(root) / "forged")
                count[holder] += 1
                told[holder] += bool(failed)
                print(f"{holder:15} {case.name:42} {' '.join(failed) or 'PASSED'}", flush=True)
    for holder in count:
        print(f"{holder}: {told[holder]}/{count[holder]} forgeries told")
    print(f"all: {told.total()}/{count.total()}; {alarms} honest pieces rejected")
    return int(alarms > 0 or told != count)


if __name__ == "__main__":
    run_study(main)
