"""Forged and honest pieces on every holder, and frames, validated: who is rejected, and by which checks.

`python -m benchmarks.forgery_table [--only HOLDER] [--seed N --count 300 | --honest 100]`: drawn, with a seed
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

from benchmarks.measurement import run_study
from knotfab_formats.verdict import SHADOWS
from tests.corpus.drawn import drawn_forgeries
from tests.corpus.forged import (
    VARIATIONS,
    Vary,
    drawn_variations,
    forged,
    judge_forged,
    write_variation,
)
from tests.corpus.forged_sequence import (
    forge_frame,
    forged_sequence,
    judge_frame,
    plain_frame,
    sequence_folder,
)
from tests.corpus.forging import HOLDERS, Held, write_held
from tests.corpus.judge import validate_file


def main(*, only: str = "", seed: int | None = None, count: int = 300, honest: int = 0) -> int:
    """Print the table, and the counts of each holder; 1 unless all forgeries are told and no honest piece.

    With a seed no frame is forged, and of honest pieces `honest` are drawn. Required checks that no forgery
    made fail are named, so that edits are missing there.
    """
    told: Counter[str] = Counter()
    tried: Counter[str] = Counter()
    tripped: Counter[str] = Counter()
    required: set[str] = set()
    passed: list[bool] = []
    drawn = [] if seed is None else drawn_forgeries(seed, 0 if honest else count)
    varied = drawn_variations(seed or 0, honest)

    def tell(holder: str, name: str, failed: Sequence[str], fine: str = "") -> None:
        print(f"{holder:15} {name:42} {' '.join(failed) or fine}", flush=True)

    def count_told(holder: str, name: str, found: Sequence[str]) -> None:
        tried[holder] += 1
        told[holder] += bool(found)
        tripped.update(found)
        tell(holder, name, found, "PASSED")

    def vary(
        holder: str, name: str, vary: Vary, files: tuple[Path, Path], skip: Collection[str]
    ) -> None:
        checks = validate_file(*write_variation(vary, *files), skip=skip).checks
        required.update(c.name for c in checks if c.required and c.status == "pass")
        failed = [c.name for c in checks if c.required and c.status == "fail"]
        passed.append(not failed)
        tell(holder, name, failed)

    with tempfile.TemporaryDirectory() as root:
        into = Path(root) / "varied"
        for holder in (h for h in HOLDERS if only in h):
            write_held(holder, Path(root) / holder)
            held = Held.read(Path(root) / holder)
            named = (
                VARIATIONS
                if seed is None
                else {"as it is": lambda _: None} | varied.get(holder, {})
            )
            for name, way in named.items():
                vary(holder, name, way, (held.folder, into), SHADOWS)
            cases = forged() if seed is None else drawn
            for case in (c for c in cases if c.holder == holder):
                count_told(holder, case.name, judge_forged(case, held, Path(root) / "forged"))
        if only in "sequence" and seed is None:
            for number in (1, 2, 3):
                passed.append(not (failed := judge_frame(sequence_folder(), number)))
                tell("sequence", f"frame {number}", failed)
            frame = plain_frame(2, Path(root) / "frame")
            for name, way in VARIATIONS.items():
                vary("sequence", name, way, (frame, into), {"shadow-render"})
            for name, forge in forged_sequence():
                found = judge_frame(forge_frame(forge, Path(root) / "forged"))
                count_told("sequence", name, found)
    for holder in tried:
        print(f"{holder}: {told[holder]}/{tried[holder]} forgeries told")
    for check, times in tripped.most_common(40):
        print(f"{times:5} {check[:100]}")
    if tried:
        print(
            f"checks that no forgery made fail: {', '.join(sorted(required - set(tripped))) or 'none'}"
        )
    alarms = len(passed) - sum(passed)
    print(f"all: {told.total()}/{tried.total()}; {alarms} of {len(passed)} honest pieces rejected")
    return int(alarms > 0 or told != tried)


if __name__ == "__main__":
    run_study(main)
