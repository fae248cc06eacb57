"""Forged and honest pieces on every holder, validated: who is rejected, and by which checks.

`python -m benchmarks.forgery_table [--only HOLDER]`
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from benchmarks.measurement import run_study
from knotfab_formats.verdict import SHADOWS
from tests.corpus.examine import validate_file
from tests.corpus.forged import forged, judge_forged
from tests.corpus.forging import Held
from tests.corpus.held import HOLDERS, write_held
from tests.corpus.honest import VARIATIONS, write_variation


def main(*, only: str = "") -> int:
    """Print the table, and the counts of each holder; 1 unless all forgeries are told and no honest piece."""
    told: Counter[str] = Counter()
    count: Counter[str] = Counter()
    honest: list[bool] = []

    def tell(holder: str, name: str, failed: Sequence[str], passed: str = "") -> None:
        print(f"{holder:15} {name:42} {' '.join(failed) or passed}", flush=True)

    with tempfile.TemporaryDirectory() as root:
        for holder in (h for h in HOLDERS if only in h):
            write_held(holder, Path(root) / holder)
            held = Held.read(Path(root) / holder)
            for name in VARIATIONS:
                files = write_variation(name, held.folder, Path(root) / "varied")
                checks = validate_file(*files, skip=SHADOWS).checks
                failed = [c.name for c in checks if c.required and c.status == "fail"]
                honest.append(not failed)
                tell(holder, name, failed)
            for case in (c for c in forged() if c.holder == holder):
                found = judge_forged(case, held, Path(root) / "forged")
                count[holder] += 1
                told[holder] += bool(found)
                tell(holder, case.name, found, "PASSED")
    for holder in count:
        print(f"{holder}: {told[holder]}/{count[holder]} forgeries told")
    alarms = len(honest) - sum(honest)
    print(f"all: {told.total()}/{count.total()}; {alarms} of {len(honest)} honest pieces rejected")
    return int(alarms > 0 or told != count)


if __name__ == "__main__":
    run_study(main)
